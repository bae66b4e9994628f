"""A record that cannot be fitted is refused, with what was seen and what to do."""

from collections.abc import Callable

import numpy as np
import pytest

from treadline.errors import ModelError, NotFinite, PeriodMismatch, PoorExcitation, SettingsError, ShapeMismatch, TreadlineError
from treadline.identification import identify
from treadline.models import InputOutputRecord

Draw = Callable[..., InputOutputRecord]
Spoil = Callable[[np.ndarray, np.ndarray], None]


def with_inf(_: np.ndarray, y: np.ndarray) -> None:
    y[3, 1] = np.inf


def constant(u: np.ndarray, _: np.ndarray) -> None:
    u[:, 0] = 0.2


def together(u: np.ndarray, _: np.ndarray) -> None:
    u[:, 1] = 2.0 * u[:, 0] + 1.0


def with_gaps(_: np.ndarray, y: np.ndarray) -> None:
    y[::4] = np.nan


def still(_: np.ndarray, y: np.ndarray) -> None:
    y[:, 1] = 0.0


FAULTS: list[tuple[Spoil, type[TreadlineError], str]] = [
    (with_inf, NotFinite, "'yaw_rate' holds Inf at sample 3"),
    (constant, PoorExcitation, "input 'left_m_s' is constant"),
    (together, PoorExcitation, r"the 2 inputs move together \(rank 1\): left_m_s, right_m_s"),
    (with_gaps, NotFinite, "25 % of the rows hold a NaN, more than 20 %"),
    (still, PoorExcitation, "output 'yaw_rate' is constant"),
]


@pytest.mark.parametrize(("spoil", "error", "message"), FAULTS, ids=[fault[0].__name__ for fault in FAULTS])
def test_a_fault_in_the_data_is_named(draw: Draw, spoil: Spoil, error: type[TreadlineError], message: str) -> None:
    record = draw(0)
    u, y = record.u.copy(), record.y.copy()
    spoil(u, y)
    spoiled = InputOutputRecord(u=u, y=y, dt_s=1.0, input_names=record.input_names, output_names=record.output_names)
    with pytest.raises(error, match=message):
        identify(spoiled)


def test_degrees_are_taken_for_what_they_are(draw: Draw) -> None:
    record = draw(0)
    degrees = InputOutputRecord(u=record.u, y=np.rad2deg(record.y), dt_s=1.0, output_names=("heading_rad", "yaw_rate_rad_s"))
    with pytest.raises(ShapeMismatch, match=r"'heading_rad' reaches \d+\.\d, beyond π: degrees"):
        identify(degrees)


def test_an_angle_that_was_unwrapped_may_pass_pi_if_its_name_says_so(draw: Draw) -> None:
    record = draw(0)
    y = record.y + np.array([20.0, 0.0])
    found = identify(InputOutputRecord(u=record.u, y=y, dt_s=1.0, output_names=("yaw_unwrapped_rad", "yaw_rate_rad_s")), order=2)
    # The nearest operating point to the data's means, of the many that an offset of the inputs leaves.
    assert found.model.output_offset[0] == pytest.approx(20.0, abs=0.1)


def test_a_short_record_says_how_many_samples_are_needed(draw: Draw) -> None:
    # One row holds a constant, both inputs now, and two inputs and two outputs of one lag: 7 unknowns, 14 samples.
    with pytest.raises(PoorExcitation, match=r"12 samples are too few: 2 inputs, 2 outputs .* need more than 14"):
        identify(draw(0, samples=12))
    with pytest.raises(PoorExcitation, match="need more than 2406"):
        identify(draw(0), order=2, lags=300)


def test_gaps_that_leave_too_few_whole_windows_are_counted(draw: Draw) -> None:
    record = draw(0, samples=300)
    y = record.y.copy()
    y[::8] = np.nan
    # Every window of eight lags or more holds a gap.
    with pytest.raises(PoorExcitation, match=r"300 samples are too few: .* 8 lags need more than 70, and gaps cost 292"):
        identify(InputOutputRecord(u=record.u, y=y, dt_s=1.0), lags=8)


def test_an_empty_record_is_refused() -> None:
    with pytest.raises(PoorExcitation, match="holds no samples"):
        identify(InputOutputRecord(u=np.zeros((0, 2)), y=np.zeros((0, 2)), dt_s=1.0))


def test_records_of_two_clocks_are_not_joined(draw: Draw) -> None:
    slow = draw(0)
    fast = InputOutputRecord(u=slow.u, y=slow.y, dt_s=0.5)
    with pytest.raises(PeriodMismatch, match=r"record 2: period 0\.5 s, the first record has 1 s"):
        identify([slow, fast])


def test_records_of_other_channels_are_not_joined(draw: Draw) -> None:
    first = draw(0)
    second = InputOutputRecord(u=first.u, y=first.y[:, :1], dt_s=1.0)
    with pytest.raises(ShapeMismatch, match="record 2: has other channels"):
        identify([first, second])


def test_an_order_that_the_data_do_not_show_is_refused(draw: Draw) -> None:
    with pytest.raises(PoorExcitation, match="order 9 is above the rank 2"):
        identify(draw(0), order=9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 0}, "order is 0; at least 1"),
        ({"lags": 0}, "lags is 0; at least 1"),
        ({"method": "guess"}, "method is 'guess'; allowed: best, okid-era, era-dc, pbsid, deconvolution"),
        ({"validation": 1.5}, r"the validation share is 1\.5"),
    ],
)
def test_an_option_out_of_range_is_refused(draw: Draw, options: dict[str, float | str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        identify(draw(0), **options)


def test_no_record_at_all_is_refused() -> None:
    with pytest.raises(SettingsError, match="at least one record"):
        identify([])


def test_a_record_without_a_period_is_no_record() -> None:
    with pytest.raises(ModelError, match=r"period is 0\.0 s"):
        InputOutputRecord(u=np.zeros((3, 2)), y=np.zeros((3, 2)), dt_s=0.0)
