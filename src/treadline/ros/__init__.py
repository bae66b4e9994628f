"""The graph of the paper's Fig. 7: blocks of the mission as nodes over a ``Transport``.

``block_nodes`` are the nodes, each a thin wrapper of a block; ``lockstep`` runs all of them in one process, with the same commands
as ``mission.loop``; ``node_process`` runs one of them in a process of its own, over ``ros1`` or, in ``ros2/treadline_ros2``, rclpy.
"""
