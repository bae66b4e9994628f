"""The graph of the paper's Fig. 7: blocks of the mission as nodes over a ``Transport``.

``shells`` are the nodes, each a thin coat over a block; ``lockstep`` turns them in one process, with the very commands of
``mission.loop``; ``process`` turns one of them in a process of its own, over ``ros1`` or ``zenoh``.
"""
