"""Depth images, colour images and calibrations become frames in whatever order they come."""

from collections.abc import Callable

import numpy as np
import pytest

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import ImageError
from treadline.io.images import Paired, Pairing, Picture


def camera(width_px: int = 4, height_px: int = 3, focal_px: float = 5.0) -> PinholeCamera:
    return PinholeCamera(width_px=width_px, height_px=height_px, fx_px=focal_px, fy_px=focal_px, cx_px=1.5, cy_px=1.0)


def depth(number: int) -> Picture:
    return Picture(0.1 * number, "16UC1", np.full((3, 4), 1000 + number, np.uint16))


def colour(number: int, late_s: float = 0.0) -> Picture:
    return Picture(0.1 * number + late_s, "rgb8", np.full((3, 4, 3), 1 + number, np.uint8))


def number_of(frame: Paired) -> int:
    return round(frame.frame.t_s / 0.1)


def interleaved(rng: np.random.Generator, *queues: list[Callable[[], list[Paired]]]) -> list[Paired]:
    """Call what is in the queues, each in its own order, one queue at random after the other."""
    found: list[Paired] = []
    turns = rng.permutation([place for place, queue in enumerate(queues) for _ in queue])
    for place in turns:
        found += queues[place].pop(0)()
    return found


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("is_alone_enough", [False, True])
@pytest.mark.parametrize("ahead", [1, 3, 20])
def test_each_depth_image_becomes_a_frame_or_is_lost_once_and_in_order(seed: int, is_alone_enough: bool, ahead: int) -> None:
    """Test: twelve depth images, some without a colour image or with a late one, interleaved at random with colour and calibration.
    Expected result: each is a frame or lost, none twice, frames in the order of time; a frame has its own colour, or is black."""
    rng = np.random.default_rng(seed)
    lost: list[int] = []
    pairing = Pairing(lost=lambda t_s, _: lost.append(round(t_s / 0.1)), ahead=ahead, is_alone_enough=is_alone_enough)
    partners = {number: float(rng.choice([-0.019, 0.0, 0.019, 0.03])) for number in range(12) if rng.random() < 0.8}
    found = interleaved(
        rng,
        [lambda number=number: pairing.depth(depth(number)) for number in range(12)],
        [lambda number=number, late=late: pairing.colour(colour(number, late)) for number, late in partners.items()],
        [lambda: pairing.calibrate(camera())],
    )
    found += pairing.rest()
    numbers = [number_of(paired) for paired in found]
    assert numbers == sorted(set(numbers))
    assert sorted([*numbers, *lost]) == [*range(12)]
    for number, (frame, has_colour) in zip(numbers, found, strict=True):
        assert frame.depth_m[0, 0] == pytest.approx(1.0 + 0.001 * number)
        assert int(frame.rgb[0, 0, 0]) == (1 + number if has_colour else 0)
        assert has_colour <= (abs(partners.get(number, 1.0)) <= 0.02)
        assert has_colour or is_alone_enough


@pytest.mark.parametrize("seed", range(20))
def test_with_room_enough_each_pair_meets_whichever_topic_is_ahead(seed: int) -> None:
    """Test: eight pairs, each topic in its own order, one as far ahead of the other as chance has it, with room for all. Expected:
    all eight frames, in order."""
    rng = np.random.default_rng(seed)
    lost: list[float] = []
    pairing = Pairing(ahead=8, calibrate=lambda _: camera(), lost=lambda t_s, _: lost.append(t_s))
    found = interleaved(
        rng,
        [lambda number=number: pairing.depth(depth(number)) for number in range(8)],
        [lambda number=number: pairing.colour(colour(number)) for number in range(8)],
    )
    assert ([number_of(paired) for paired in found], lost) == ([*range(8)], [])
    assert all(has_colour for _, has_colour in found)


def test_without_a_colour_topic_a_depth_image_waits_for_nothing_but_its_calibration() -> None:
    lost: list[str] = []
    pairing = Pairing(has_colour=False, lost=lambda _, reason: lost.append(reason))
    assert pairing.depth(depth(0)) == pairing.depth(depth(1)) == []
    assert [number_of(paired) for paired in pairing.calibrate(camera())] == [1]
    assert [number_of(paired) for paired in pairing.depth(depth(2))] == [2]
    assert lost == ["no calibration yet"]


def test_in_a_log_of_ours_a_calibration_that_changes_is_that_of_the_frames_time() -> None:
    """Test: another focal length in each frame, whose calibration follows its images. Expected: none is a frame late."""
    pairing = Pairing(has_colour=False, is_ours=True)
    taken = [(pairing.depth(depth(n)), pairing.calibrate(camera(focal_px=5.0 + n), 0.1 * n)) for n in range(4)]
    assert [(early, paired.frame.camera.fx_px) for early, (paired,) in taken] == [([], 5.0), ([], 6.0), ([], 7.0), ([], 8.0)]


def test_a_calibration_of_another_size_or_without_a_focal_length_makes_no_frame() -> None:
    pairing = Pairing(has_colour=False)
    pairing.depth(depth(0))
    with pytest.raises(ImageError, match=r"sizes differ: an image of 4×3 at 0\.000 s, calibrated for 8×6"):
        pairing.calibrate(camera(8, 6))
    pairing = Pairing()
    assert pairing.colour(colour(1)) == pairing.depth(depth(1)) == []
    with pytest.raises(ImageError, match="no intrinsics: fx = 0"):
        pairing.calibrate(camera(focal_px=0.0))
    assert pairing.depth(depth(2)) == []
    assert [number_of(frame) for frame in pairing.calibrate(camera())] == []  # the colour image is of the first
    assert [number_of(frame) for frame in pairing.colour(colour(2))] == [2]


def test_a_colour_image_of_another_size_is_none_or_an_error() -> None:
    """Test: colour at twice the size. Expected result: a frame without colour where that is enough, else an error."""
    large = Picture(0.1, "rgb8", np.ones((6, 8, 3), np.uint8))
    strict, alone = Pairing(), Pairing(is_alone_enough=True)
    for pairing in (strict, alone):
        pairing.calibrate(camera())
        pairing.depth(depth(1))
    assert alone.colour(large) == []
    assert [frame.has_colour for frame in alone.rest()] == [False]
    with pytest.raises(ImageError, match=r"8×6.*4×3"):
        strict.colour(large)
