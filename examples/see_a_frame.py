"""Draw one noisy frame of a stair, read the heading from it, and say what lies ahead."""

import sys

import numpy as np

from treadline.angles import DEG
from treadline.perception import StairDetector
from treadline.sim.camera import Recipe, draw_view

seed = int(sys.argv[1]) if len(sys.argv) > 1 else 1
view = draw_view(np.random.default_rng(seed), Recipe(scenes=("up",), heading_deg=(-30.0, 30.0)))
sight = StairDetector().look(view.frame, view.gravity_C)
if not sight.accepted:
    sys.exit(f"no heading: {sight.reason}")

print(f"heading {sight.heading_rad / DEG:+.2f}° ± {1.96 * sight.sigma_rad / DEG:.2f}° (95 %)")
print(f"truth   {view.stair.heading_rad / DEG:+.2f}°")

ahead = sight.stair_map
print(f"a flight {ahead.direction}: rise {1e3 * ahead.rise_m:.0f} mm, run {1e3 * ahead.run_m:.0f} mm, {ahead.slope_rad / DEG:.1f}°")
print("nosings ahead at", ", ".join(f"{x:.2f}" for x in ahead.nosings_B[:, 0]), "m" + (", then it ends" if ahead.ends else ""))
for side, metres in (("left", ahead.left_wall_m), ("right", ahead.right_wall_m)):
    print(f"{side}: " + ("nothing seen" if metres is None else f"a wall {metres:.2f} m from the middle"))
