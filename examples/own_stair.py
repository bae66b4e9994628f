"""Measure your own stair: is it feasible, and what would help? Then simulate it."""

import treadline as tl

stair = {"rise_m": 0.165, "run_m": 0.29, "steps": 7, "width_m": 1.1, "friction": [0.75, 0.6], "rise_jitter_m": 0.002}
mine = tl.Scenario.model_validate({"stair": stair, "chair": {"payload_kg": 70.0}, "sensors": {"camera": "statistical"}})
print(tl.check(mine))
run = tl.climb(mine, seed=1)
print(run)
print("largest slide down the flight:", round(run.scores.roll_back_m, 3), "m; columns of the time series:", *run.series)
