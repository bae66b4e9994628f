"""Live view and replay of runs in a browser: ``treadline view``.

``opening`` makes a session of a target, ``server`` serves the page behind an access check, and ``app`` shows the instant under the
cursor. A worker process runs the simulation and never waits for the viewer; its signals make a ``playback.Recording`` grow.
"""
