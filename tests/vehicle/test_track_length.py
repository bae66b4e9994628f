"""Track length: two pitches touch two nosings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.errors import MechanicsError
from treadline.vehicle.tracks import nosings_touched


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
