"""Live view and replay of runs in a browser: ``treadline view``.

A worker process runs the simulation and never waits for the viewer (``worker``); a ``Tape`` collects what happened; a session moves
a cursor over the tape; scene and panels show the instant under the cursor. The server checks token, Host and Origin of every
request before the page or a WebSocket is served (``access``).
"""
