"""Simulate one traversal, print its scores and draw it: python examples/climb_and_plot.py [run.svg]."""

import sys

import treadline as tl

short = tl.Scenario.model_validate({"stair": {"steps": 6, "landing_m": 3.0}, "sensors": {"camera": "statistical"}})
run = tl.climb(short, seed=2)
print(run)
figure = run.plot()
print(f"{len(figure.axes)} panels; largest pitch {run.series['pitch_deg'].max():.1f}°")
if len(sys.argv) > 1:
    figure.savefig(sys.argv[1])
