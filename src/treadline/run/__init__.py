"""One simulated run: resolved once, driven to its end, scored by ground truth, recorded in its folder.

Contract: ``resolve.resolve`` gives a ``Setup``; ``episode.run_episode`` drives it and ``recorded_run.recorded_run`` also writes the
run folder, both return an ``episode.Traverse`` with ``run_scores.Scores``. ``excitation_run.excite`` drives with random belt speeds
for the identification. ``scene_log.SceneLog`` adds the scene to a log.
"""
