"""The track: its outline closes, its length is the outline's, and two pitches of it touch two nosings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import Tracks, read_chair
from treadline.vehicle.track_length import belt_length, minimum_track_length, nosings_touched, outline, pulley_centres

SHIPPED = read_chair("wheelchair").tracks
tracks = st.builds(
    lambda flat, approach, angle, radius: SHIPPED.model_copy(
        update={"flat_run_m": flat, "approach_m": approach, "approach_angle_deg": angle, "pulley_radius_m": radius}
    ),
    st.floats(0.3, 2.0),
    st.floats(0.1, 0.8),
    st.just(0.0) | st.floats(5.0, 80.0),
    st.floats(0.02, 0.2),
)


def perimeter(points: np.ndarray) -> float:
    return float(np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum())


@given(track=tracks)
def test_the_belt_is_as_long_as_its_outline(track: Tracks) -> None:
    points = 200
    drawn = perimeter(outline(track, points_per_arc=points))
    # A chord of an arc of angle a is short of it by the share a²/24; no arc turns more than a whole turn.
    chord_error = (2.0 * math.pi / (points - 1)) ** 2 / 24.0 * 2.0 * math.pi * track.pulley_radius_m
    assert -1e-9 <= belt_length(track) - drawn <= chord_error + 1e-9


@given(track=tracks)
def test_the_outline_keeps_one_radius_from_the_triangle_of_pulleys(track: Tracks) -> None:
    centres, radius = pulley_centres(track), track.pulley_radius_m
    for point in outline(track):
        nearest = min(distance_to_segment(point, centres[i - 1], centres[i]) for i in range(3))
        assert nearest == pytest.approx(radius, abs=1e-9)


def distance_to_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    along = end - start
    share = min(max(float((point - start) @ along) / float(along @ along), 0.0), 1.0)
    return float(np.linalg.norm(point - start - share * along))


@given(track=tracks)
def test_the_outline_runs_anticlockwise_and_stands_on_the_ground(track: Tracks) -> None:
    points = outline(track)
    x, z = points.T
    assert float(x @ np.roll(z, -1) - z @ np.roll(x, -1)) > 0.0
    assert z.min() == pytest.approx(0.0, abs=1e-12)
    on_ground = x[z < 1e-9]
    # The straight part between rear and front pulley is the flat run; without an angle of attack it goes on to the nose.
    front = 0.5 * track.flat_run_m + (track.approach_m if track.approach_angle_deg == 0.0 else 0.0)
    assert on_ground.min() == pytest.approx(-0.5 * track.flat_run_m, abs=1e-6)
    assert on_ground.max() == pytest.approx(front, abs=1e-6)


def test_the_shipped_track_is_3_17_metres_of_belt() -> None:
    assert belt_length(SHIPPED) == pytest.approx(3.166, abs=5e-4)


@given(rise=st.floats(0.05, 0.3), run=st.floats(0.15, 0.6))
def test_the_minimum_length_is_two_pitches(rise: float, run: float) -> None:
    assert minimum_track_length(rise, run) == pytest.approx(2.0 * math.sqrt(rise * rise + run * run), rel=1e-14)


@given(pitch=st.floats(0.1, 0.7), ratio=st.floats(0.2, 5.0) | st.sampled_from([1.0, 2.0, 3.0]))
def test_two_nosings_lie_under_the_track_at_every_phase_if_and_only_if_it_has_two_pitches(pitch: float, ratio: float) -> None:
    length = ratio * pitch
    # Fewest when the first nosing is just one pitch ahead of the rear end; the grid includes that phase.
    fewest = min(nosings_touched(length, pitch, phase) for phase in np.linspace(0.0, pitch, 33).tolist())
    assert (fewest >= 2) == (length >= 2.0 * pitch)


@given(length=st.floats(0.0, 3.0), pitch=st.floats(0.1, 0.7), share=st.floats(0.0, 1.0))
def test_the_count_of_nosings_is_the_count_of_points_within(length: float, pitch: float, share: float) -> None:
    phase = share * pitch
    counted = sum(phase + i * pitch <= length for i in range(40))
    # Where a nosing meets the track's end to rounding, either count is right.
    close = min(abs(phase + i * pitch - length) for i in range(40)) < 1e-12
    assert close or nosings_touched(length, pitch, phase) == counted


@pytest.mark.parametrize("phase", [-0.01, 0.41, math.nan])
def test_a_phase_outside_one_pitch_is_refused(phase: float) -> None:
    with pytest.raises(MechanicsError, match="outside one pitch"):
        nosings_touched(1.0, 0.4, phase)
