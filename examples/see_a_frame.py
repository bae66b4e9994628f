"""Render one noisy depth image of a stair, detect the stair in it, and print what lies ahead."""

import sys

import treadline as tl
from treadline.core.angles import DEG
from treadline.plant.sensors.camera import stair_frames

seed = int(sys.argv[1]) if len(sys.argv) > 1 else 1
headings = (-30.0 * DEG, 30.0 * DEG)
(view,) = stair_frames(tl.Scenario(), sensor="kinect1", count=1, seed=seed, heading_rad=headings)
found = tl.detect_stair(view.frame.depth_m, view.frame.camera, view.gravity_C)
print(found)
if not found.accepted:
    sys.exit(1)
print(f"truth   {view.truth['heading_deg']:+.2f}°")

ahead = found.stair_map
print("nosings ahead at", ", ".join(f"{x:.2f}" for x, _, _ in ahead.nosings_B), "m" + (", then it ends" if ahead.ends else ""))
for side, metres in (("left", ahead.left_wall_m), ("right", ahead.right_wall_m)):
    print(f"{side}: " + ("nothing seen" if metres is None else f"a wall {metres:.2f} m from the middle"))
