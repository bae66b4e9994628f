"""The paper's experiments, and recordings processed again.

Contract: ``reproduce.reproduce_paper`` (in Gazebo, ``gazebo.reproduce_in_gazebo``) runs a ``plan.ReproducePlan``;
``replay.replayed_run`` processes a recording again. Figures have the paper's numbers: ``fig05``, ``_fig08_to_fig10`` (and Table
II), ``fig11``, ``as_printed`` (the printed controller, Table I).
"""
