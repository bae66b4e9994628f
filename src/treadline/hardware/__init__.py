"""A real chair behind the ``Plant`` port: links to its drives and sensors, and the guard in a process of its own.

Contract: ``ports`` holds the protocols and values that a driver of another chair implements.
"""
