"""Live view and replay of runs in a browser: ``treadline view`` and ``treadline demo``.

``opening`` makes a session of a target, ``demonstration`` that of the demo, ``server`` serves the page behind an access check, and
``app`` shows the instant under the cursor. A worker process runs the simulation and never waits for the viewer; its signals make a
``playback.Recording`` grow.
"""
