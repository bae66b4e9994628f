"""Campaigns: many simulated traversals sampled from stated distributions, run on many processes, and summarised.

``spec`` reads what is sampled, ``sampling`` places run k in the unit cube, ``pool`` and ``cluster`` execute, ``journal``
records finished runs, ``summary`` evaluates. The function that simulates a run is passed in; this package has no simulator.
"""
