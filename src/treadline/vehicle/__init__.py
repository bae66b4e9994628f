"""Geometry and statics of stair, tracks, chair and seat.

Contract: ``staircase`` and ``stair_solids`` (the stair), ``bodies`` (the chair as one tree, from which the plant writes MJCF,
``urdf`` URDF and ``sdf`` SDF), ``start_pose``, ``verdict`` (``check``) with its parts ``tracks``,
``tip_over_margin``, ``loading`` (true and assumed load), ``linkage`` (the seat), ``quasi_static`` (steering by Coulomb friction
alone), ``comfort``, and ``appearance`` (meshes, drawn only).
"""
