"""Rows of the tables ``sensors`` and ``conditions`` of ``perception.py``."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scenes import View, ViewRecipe, draw_view
from scenes.bad_pixels import HOLE_FILLINGS
from scenes.known_answers import AS_BUILT
from scenes.recipe import ALONE
from scenes.scores import LEAST_SHARE

LIFELIKE: dict[str, float] = {"grain_px": 1.2, "warp_px": 0.03, "worn_m": 0.006} | AS_BUILT
"""Imperfections of real frames: spatially correlated noise, residual distortion after calibration, uneven steps."""
UNEVEN = ("tread_tilt_deg", "nosing_yaw_jitter_deg", "rise_jitter_m", "run_jitter_m")
"""Sizes of ``LIFELIKE`` that belong to the stair: nosings whose ends are off by 3 mm are turned by 0.2° over 1.2 m."""
UNEVEN_TIMES = (1.0 / 3.0, 4.0 / 3.0)
"""Range of the factor on ``UNEVEN`` of one stair: rises of 1 mm, as of precast steps, to 4 mm. With 3.1 mm the largest and the
smallest of ten rises differ by 9.5 mm, the limit of IBC 1011.5.4; DIN 18065 allows ±5 mm."""
WARPS_PX = (0.01, 0.1)
"""Range of the warp of one camera [px of Kinect 1 disparity]. Two Kinects 1 had 0.07 and 0.08 px (evidence 0012); 0.1 px is 9 mm at
2 m, within the 11 mm of an Azure Kinect (Tölgyessy et al., Sensors 21, 2021) and the 2 % of the D435 data sheet."""
ROLLING: dict[str, object] = {"readout_s": 0.03, "speed_m_s": (0.1, 0.3), "turn_rate_deg_s": 8.0}
"""Rolling shutter of a Kinect 1 on a chair that drives and rocks: at 1 Hz, an amplitude of 1.8° has rates of 8°/s RMS."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One row of a table."""

    label: str
    recipe: dict[str, Any] = field(default_factory=dict)
    method: Literal["paper", "robust"] = "robust"
    taken_off_deg: float = 0.0
    knows_down: bool = True
    least_share: float = LEAST_SHARE
    """Least share of the image that the stair covers in a frame that counts."""
    is_lifelike: bool = False
    """Whether each frame has another uneven stair and another camera with a warp of its own."""

    def recipe_of(self, seed: int) -> ViewRecipe:
        """Return the recipe of one frame; what the row itself sets has precedence over what is drawn."""
        if not self.is_lifelike:
            return ViewRecipe(**self.recipe)
        rng = np.random.default_rng([seed, len(LIFELIKE)])
        times, warp_px = (float(np.exp(rng.uniform(*np.log(limits)))) for limits in (UNEVEN_TIMES, WARPS_PX))
        drawn = LIFELIKE | {name: times * LIFELIKE[name] for name in UNEVEN} | {"warp_px": warp_px}
        # Worn nosings are not supported with some shapes of steps.
        dropped = {"worn_m"} if any("worn_m" in others and name in self.recipe for name, others in ALONE.items()) else set()
        return ViewRecipe(**{name: value for name, value in (drawn | self.recipe).items() if name not in dropped})

    def views(self, seeds: range) -> Iterator[View]:
        """Yield the frames that count, one for each seed."""
        for seed in seeds:
            view = draw_view(np.random.default_rng(seed), self.recipe_of(seed))
            if view.stair is None or view.stair.share >= self.least_share:
                yield view


def fixed(value: float) -> tuple[float, float]:
    """Return the range that holds one value."""
    return (value, value)


def sensor_cases() -> Iterator[Case]:
    """Yield the rows of the table of sensors."""
    for rows in (240, 480):
        size = f"{rows * 4 // 3}×{rows}"
        yield Case(label=f"Kinect 1, {size}", recipe={"height_px": rows})
        yield Case(label=f"Kinect 1 with edge holes, {size}", recipe={"height_px": rows, "edge_holes": True})
        open_risers = {"height_px": rows, "edge_holes": True, "open_risers": True}
        yield Case(label=f"Kinect 1 with edge holes, open risers, {size}", recipe=open_risers)
        yield Case(label=f"Kinect 1, noise 50 % above, {size}", recipe={"height_px": rows, "sigma_px": 0.075})
    yield Case(label="Kinect 2, 512×424", recipe={"sensor": "kinect2"})
    for rows in (288, 576):
        yield Case(label=f"time of flight with multipath, {rows * 10 // 9}×{rows}", recipe={"sensor": "tof", "height_px": rows})
    yield Case(label="time of flight with multipath, sensor known", recipe={"sensor": "tof", "sensor_known": True})
    for sensor in ("d435", "d455"):
        for sigma in (0.05, 0.08, 0.12):
            yield Case(label=f"{sensor.upper()}, {sigma:g} px, 640×480", recipe={"sensor": sensor, "sigma_px": sigma})
    yield Case(label="D435, 0.12 px, sensor known", recipe={"sensor": "d435", "sigma_px": 0.12, "sensor_known": True})
    yield Case(label="D435, 0.08 px, 320×240", recipe={"sensor": "d435", "height_px": 240})
    yield Case(label="D435, 0.08 px, open risers", recipe={"sensor": "d435", "open_risers": True})
    yield Case(label="D435, 0.08 px, facing down", recipe={"sensor": "d435", "scenes": ("down",)})
    for sensor in ("kinect1", "d455"):
        for distance in (2.0, 3.0, 4.0, 5.0):
            far = {"sensor": sensor, "scenes": ("foot",), "place_m": fixed(distance), "pitch_deg": fixed(10.0), "height_px": 480}
            # From 5 m a flight 1 m wide covers 5 % of the image.
            yield Case(label=f"{sensor}, {distance:.0f} m before the flight, camera 10° down", recipe=far, least_share=0.01)


def pixel_cases() -> Iterator[Case]:
    """Yield the rows of the table of bad pixels: missing at random or in blotches, filled by the driver, and mixed at edges."""
    for share in (0.2, 0.4, 0.6, 0.8):
        for rows in (240, 480):
            yield Case(label=f"{share:.0%} missing, {rows * 4 // 3}×{rows}", recipe={"missing": share, "height_px": rows})
    yield Case(label="60 % missing, D435", recipe={"sensor": "d435", "missing": 0.6})
    yield Case(label="60 % missing, facing down", recipe={"scenes": ("down",), "missing": 0.6})
    for share in (0.33, 0.6):
        yield Case(label=f"{share:.0%} missing in blotches", recipe={"holes": share})
    for filling in HOLE_FILLINGS[1:]:
        holed = {"edge_holes": True, "holes": 0.2, "hole_filling": filling}
        yield Case(label=f"a fifth in blotches, filled from the {filling}", recipe=holed)
        yield Case(label=f"60 % missing, filled from the {filling}", recipe={"missing": 0.6, "hole_filling": filling})
        yield Case(label=f"D435, filled from the {filling}", recipe={"sensor": "d435", "hole_filling": filling})
    for share in (0.3, 0.8):
        recipe = {"sensor": "tof", "height_px": 288, "flying": share}
        yield Case(label=f"time of flight, {share:.0%} of the edges flying", recipe=recipe)


def condition_cases() -> Iterator[Case]:
    """Yield the rows of the table of conditions: each is a kind of stair, motion or mount that breaks an assumption."""
    yield Case(label="plain")
    yield Case(label="with what real ones add", recipe=LIFELIKE)
    yield Case(label="facing down, with what real ones add", recipe=LIFELIKE | {"scenes": ("down",)})
    yield Case(label="open risers", recipe={"open_risers": True})
    for band in (15, 30):
        recipe = {"open_risers": True, "edge_holes_m": band / 1e3}
        yield Case(label=f"open risers, {band} mm without depth at each edge", recipe=recipe)
    yield Case(label="closed risers, 30 mm without depth at each nosing", recipe={"edge_holes_m": 0.03})
    yield Case(label="grating treads", recipe={"treads": "grating"})
    yield Case(label="glass treads", recipe={"treads": "glass"})
    yield Case(label="glass treads with strips", recipe={"treads": "glass_strips"})
    yield Case(label="carpet runner, 8 mm", recipe={"runner": True})
    for bow in (2, 5, -5, 15):
        yield Case(label=f"nosings bowed by {bow} cm", recipe={"bow_m": fixed(bow / 100.0)})
    yield Case(label="rolling shutter, 0.1 to 0.3 m/s, 8°/s RMS", recipe=ROLLING)
    yield Case(label="45 cm wide, open at both sides", recipe={"width_m": fixed(0.45), "walls": ("none",)})
    yield Case(label="1.0 to 1.6 m wide, open at both sides", recipe={"walls": ("none",)})
    for roll in (1, 3, 5):
        yield Case(label=f"mount rolled by {roll}°", recipe={"mount_roll_error_deg": fixed(float(roll))})
    yield Case(label="mount pitched by 3°", recipe={"mount_pitch_error_deg": fixed(3.0)})
    yield Case(label="gravity not known", knows_down=False)
    yield Case(label="rise and run uneven, σ 8 mm", recipe={"rise_jitter_m": 0.008, "run_jitter_m": 0.008})
