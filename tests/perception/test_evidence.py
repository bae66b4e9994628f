"""Evidence of a stair: what two steps can reach, what a repetition adds, and what a series of frames remembers."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from scenes import ViewRecipe, draw_view

from treadline.core.camera_images import DepthSensor
from treadline.perception import StairDetector
from treadline.perception._lattice_kernels import best_lattice
from treadline.perception._plane_segmentation import surface_blocks
from treadline.perception._stair_shape import Placed, spacing
from treadline.perception._step_parts import seed_points

# Literals, so that a changed value in the code is detected here.
EVIDENCE = 5.0
UNCONFIRMED = 3.4

RISE, RUN = 0.17, 0.29
EMPTY = np.full((320, 240), np.nan)
AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


def tread_row(step: int, *, rise: float = RISE, run: float = RUN, front: bool = True) -> list[float]:
    """Return a tread of a perfect stair whose first nosing lies 1 m ahead and 0.9 m below the camera."""
    x, z = 1.0 + step * run, -0.9 + step * rise
    return [z, 0.007**2, x, 0.015**2 if front else np.inf, 0.0, np.inf, -0.5, 0.5, x + 0.02, x + run - 0.02]


def riser_row(step: int, *, rise: float = RISE, run: float = RUN) -> list[float]:
    x, z = 1.0 + step * run, -0.9 + step * rise
    return [x, 0.01**2, z, 0.009**2, z - rise, 0.009**2, -0.5, 0.5, z - rise + 0.02, z - 0.02]


def evidence(treads: list[list[float]], risers: list[list[float]], nearness: Float[np.ndarray, "w h"] = EMPTY) -> float:
    tread_table, riser_table = np.array(treads).reshape(-1, 10), np.array(risers).reshape(-1, 10)
    found = best_lattice(
        seed_points(tread_table, riser_table),
        tread_table,
        riser_table,
        nearness,
        (285.0, 285.0, 159.5, 119.5),
        AXES,
        np.empty(len(treads), dtype=np.int64),
        np.empty(len(treads), dtype=np.bool_),
        np.empty(len(risers), dtype=np.int64),
    )
    return float(found[0])


def test_two_steps_however_well_they_fit_are_unconfirmed() -> None:
    """Test: two treads with their risers, of average measures, without any error. Expected result: less than a stair needs."""
    two = evidence([tread_row(0), tread_row(1)], [[*riser_row(0)[:4], 0.0, np.inf, *riser_row(0)[6:]], riser_row(1)])
    assert UNCONFIRMED < two < EVIDENCE


def test_each_repetition_adds_evidence() -> None:
    """Test: three to six steps. Expected result: a stair, by 3 nats or more for each height and place that is added."""
    found = [evidence([tread_row(k) for k in range(n)], [riser_row(k) for k in range(n)]) for n in (3, 4, 5, 6)]
    assert found[0] > EVIDENCE
    assert np.diff(found).min() > 3.0


@pytest.mark.parametrize("known_top", [False, True], ids=["its ends unknown", "its top seen"])
def test_a_wall_behind_open_steps_is_no_riser(known_top: bool) -> None:
    """Test: three steps, and a wall at the place of a fourth riser, seen two rises above it. Expected result: the evidence of three
    steps; a riser between its tread and its nosing adds to it."""
    treads, risers = [tread_row(k) for k in range(3)], [riser_row(k) for k in range(3)]
    x, z = riser_row(3)[0], riser_row(3)[2]
    unknown = [x, 0.01**2, 0.0, np.inf, 0.0, np.inf, -0.5, 0.5]
    # The wall goes on from the foot of the riser to above its nosing, or both of its ends are cut off.
    top = [z + 2.0 * RISE, 0.009**2, z - RISE, 0.009**2] if known_top else [0.0, np.inf, 0.0, np.inf]
    wall = [*unknown[:2], *top, *unknown[6:], z - RISE if known_top else z + 1.5 * RISE, z + 2.0 * RISE]
    three = evidence(treads, risers)
    assert evidence(treads, [*risers, wall]) == pytest.approx(three, abs=1e-9)
    assert evidence(treads, [*risers, [*unknown, z - 0.15, z - 0.02]]) > three + 1.0


def test_a_missing_step_in_view_costs_what_it_should() -> None:
    """Test: steps 0, 1 and 3; at step 2 the image shows nothing, or the floor. Expected result: a stair; 3 nats less."""
    treads, risers = [tread_row(k) for k in (0, 1, 3)], [riser_row(k) for k in (0, 1, 3)]
    hidden = evidence(treads, risers)
    floor = np.full((320, 240), np.nan)
    rows = (np.arange(240) - 119.5) / 285.0
    # The floor lies 1.07 m below the camera: inverse depth is linear in the row.
    floor[:, rows > 0.05] = (rows[rows > 0.05] / 1.07)[None, :]
    seen = evidence(treads, risers, floor)
    assert hidden > EVIDENCE
    # All steps are then seen through, the present ones as well: the image is no stair's.
    assert hidden - seen >= 3.0


@pytest.mark.parametrize(
    ("alone_m", "accumulated_m", "least", "most"),
    [(0.0, 0.0, 0.0, 0.2), (0.003, 0.0, 0.2, 1.0), (0.002, 0.002, 0.6, 1.4), (0.0, 0.003, 1.0, 2.5)],
)
def test_the_spacing_of_steps_has_a_true_interval(alone_m: float, accumulated_m: float, least: float, most: float) -> None:
    """Test: 400 draws of six steps that deviate alone, by uneven spacings, or both.

    Expected result: with both the error over its deviation has a mean square near 1; six steps hardly show which of the two it is,
    so that either alone has a smaller or a larger one. Without the accumulation it is 7 for uneven spacings.
    """
    rng, strains, steps = np.random.default_rng(7), [], np.arange(6)
    for _ in range(400):
        heights = RISE * steps + np.cumsum(accumulated_m * rng.standard_normal(6))
        heights += alone_m * rng.standard_normal(6) + 0.0001 * rng.standard_normal(6)
        part = Placed(steps, heights, np.full(6, 1e-8), shared_m=np.zeros((6, 1)), common_m=np.zeros((6, 1)))
        found = spacing([part], (0.17, 0.035))
        strains.append((found.mean_m - RISE) / found.sigma_m)
    assert least <= np.mean(np.square(strains)) < most


@pytest.mark.parametrize(("sensor", "distance_m"), [("kinect1", 3.0), ("d455", 2.5)])
def test_rise_and_run_far_away_are_in_their_intervals(sensor: str, distance_m: float) -> None:
    """Test: ten flights far away, whose treads cover few rows. Expected result: errors of a mean square below 1.6 of the declared.

    With the tilt of the treads by pixels of adjacent risers left out, it is 6 to 28 for the slope.
    """
    far = {"sensor": sensor, "scenes": ("foot",), "place_m": (distance_m, distance_m), "pitch_deg": (10.0, 10.0), "height_px": 480}
    strains = []
    for seed in range(10):
        view = draw_view(np.random.default_rng(seed), ViewRecipe(**far))
        shape, stair = StairDetector().look(view.frame, view.gravity_C).shape, view.stair
        if shape is not None and stair is not None:
            strains.append(
                [
                    (shape.slope_rad - stair.slope_rad) / shape.slope_sigma_rad,
                    (shape.rise_m - stair.rise_m) / shape.rise_sigma_m,
                    (shape.run_m - stair.run_m) / shape.run_sigma_m,
                ]
            )
    assert len(strains) >= 8
    assert np.mean(np.square(strains), axis=0).max() < 1.6


def test_a_frame_of_two_steps_counts_after_one_that_confirmed_the_flight() -> None:
    """Test: a frame of two steps alone; after a frame of the same stair with more; 11 s later. Expected result: no, yes, no."""
    detector, alone = StairDetector(), StairDetector()
    whole = draw_view(np.random.default_rng(31_001), ViewRecipe(scenes=("up",)))
    confirmed = detector.see(whole.frame, whole.gravity_C)
    assert confirmed.measurement is not None
    depth = whole.frame.depth_m.copy()
    sight = None
    # Rows from the top are covered until two steps are left.
    for rows in range(20, 220, 4):
        depth[:rows] = np.nan
        frame = type(whole.frame)(t_s=1.0, rgb=whole.frame.rgb, depth_m=depth.copy(), camera=whole.frame.camera)
        sight = alone.look(frame, whole.gravity_C)
        if sight.unconfirmed:
            break
    assert sight.unconfirmed
    assert sight.heading_rad is not None
    assert alone.see(frame, whole.gravity_C).measurement is None
    assert detector.see(frame, whole.gravity_C).measurement is not None
    late = type(frame)(t_s=11.1, rgb=frame.rgb, depth_m=frame.depth_m, camera=frame.camera)
    assert detector.see(late, whole.gravity_C).measurement is None


@pytest.mark.parametrize(("sensor", "measures_range"), [("tof", True), ("kinect2", True), ("kinect1", False), ("auto", False)])
def test_the_kind_of_sensor_named_in_the_camera_file_decides_what_it_measures(sensor: DepthSensor, measures_range: bool) -> None:
    """Test: a wall at one distance, whose noise says nothing about its dependence on distance."""
    view = draw_view(np.random.default_rng(3), ViewRecipe())
    wall = (2.0 + 0.002 * np.random.default_rng(4).standard_normal((240, 320))).astype(np.float32)
    assert surface_blocks(wall, replace(view.frame.camera, sensor=sensor)).measures_range == measures_range
