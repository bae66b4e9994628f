"""A record that cannot be fitted is rejected with the observed number and a remedy."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import jaxtyping
import numpy as np
import pytest

from treadline.core.errors import (
    ModelError,
    NotFinite,
    PeriodMismatch,
    PoorExcitation,
    RecordError,
    SettingsError,
    ShapeMismatch,
    TooFewSamples,
    TreadlineError,
)
from treadline.core.models import InputOutputRecord
from treadline.identification import IdentificationOptions, identify
from treadline.identification.windows import fewest_samples, max_supported_lags

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


def test_degrees_in_a_radian_column_are_rejected(draw: Draw) -> None:
    record = draw(0)
    degrees = InputOutputRecord(u=record.u, y=np.rad2deg(record.y), dt_s=1.0, output_names=("heading_rad", "yaw_rate_rad_s"))
    with pytest.raises(ShapeMismatch, match=r"'heading_rad' reaches \d+\.\d, beyond π: degrees"):
        identify(degrees)


def test_an_angle_that_was_unwrapped_may_pass_pi_if_its_name_says_so(draw: Draw) -> None:
    record = draw(0)
    y = record.y + np.array([20.0, 0.0])
    found = identify(
        InputOutputRecord(u=record.u, y=y, dt_s=1.0, output_names=("yaw_unwrapped_rad", "yaw_rate_rad_s")),
        IdentificationOptions(order=2),
    )
    # The nearest operating point to the data's means, among the many allowed by an input offset.
    assert found.model.output_offset[0] == pytest.approx(20.0, abs=0.1)


def test_a_short_record_says_how_many_samples_are_needed(draw: Draw) -> None:
    # A row holds a constant, both current inputs, and two inputs and two outputs of one lag: 7 coefficients with
    # 8 windows each, and one lag.
    with pytest.raises(TooFewSamples, match=r"12 samples are too few: 2 inputs, 2 outputs .* need at least 57$"):
        identify(draw(0, samples=12))
    with pytest.raises(TooFewSamples, match="56 samples are too few"):
        identify(draw(0, samples=56))
    assert identify(draw(0, samples=57)).model.order >= 1
    # Given lags need two windows for each of 1203 coefficients and one more, after 300 samples.
    with pytest.raises(TooFewSamples, match=r"need at least 2707$"):
        identify(draw(0), IdentificationOptions(order=2, lags=300))


@pytest.mark.parametrize(("lags", "order", "records"), [(3, None, 1), (3, 2, 2), (None, 4, 1), (None, None, 3)])
def test_the_stated_number_of_samples_is_sufficient(lags: int | None, order: int | None, records: int, draw: Draw) -> None:
    # Split into records, whose first samples are not targets of a window.
    fewest = fewest_samples(2, 2, lags=lags, order=order, records=records)
    for samples in (fewest - 1, fewest):
        record = draw(0, samples=samples)
        cuts = np.linspace(0, samples, records + 1).astype(int)
        parts = [replace(record, u=record.u[a:b], y=record.y[a:b]) for a, b in itertools.pairwise(cuts)]
        if samples < fewest:
            with pytest.raises(TooFewSamples, match=rf"at least {fewest}$"):
                max_supported_lags(parts, lags, order)
        else:
            assert max_supported_lags(parts, lags, order) >= 1


def test_gaps_that_leave_too_few_whole_windows_are_counted(draw: Draw) -> None:
    record = draw(0, samples=300)
    y = record.y.copy()
    y[::8] = np.nan
    # Every window of eight lags or more contains a gap.
    with pytest.raises(PoorExcitation, match=r"300 samples are too few: .* 8 lags need at least 79, and gaps cost 292"):
        identify(InputOutputRecord(u=record.u, y=y, dt_s=1.0), IdentificationOptions(lags=8))


def test_an_empty_record_is_rejected() -> None:
    with pytest.raises(PoorExcitation, match="holds no samples"):
        identify(InputOutputRecord(u=np.zeros((0, 2)), y=np.zeros((0, 2)), dt_s=1.0))


def test_records_of_different_periods_are_rejected(draw: Draw) -> None:
    slow = draw(0)
    fast = InputOutputRecord(u=slow.u, y=slow.y, dt_s=0.5)
    with pytest.raises(PeriodMismatch, match=r"record 2: period 0\.5 s, the first record has 1 s"):
        identify([slow, fast])


def test_records_of_different_channels_are_rejected(draw: Draw) -> None:
    first = draw(0)
    second = InputOutputRecord(u=first.u, y=first.y[:, :1], dt_s=1.0)
    with pytest.raises(ShapeMismatch, match="record 2: has other channels"):
        identify([first, second])


def test_an_order_that_the_data_do_not_show_is_rejected(draw: Draw) -> None:
    with pytest.raises(PoorExcitation, match="order 9 is above the rank 2"):
        identify(draw(0), IdentificationOptions(order=9))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 0}, "order is 0; it must be an integer, at least 1"),
        ({"lags": 0}, "lags is 0; it must be an integer, at least 1"),
        ({"method": "guess"}, "method is 'guess'; allowed: best, okid-era, era-dc, pbsid, deconvolution"),
        ({"validation": 1.5}, r"the validation share is 1\.5"),
    ],
)
def test_an_option_out_of_range_is_rejected(draw: Draw, options: dict[str, float | str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        identify(draw(0), IdentificationOptions(**options))


def test_no_record_at_all_is_rejected() -> None:
    with pytest.raises(SettingsError, match="at least one record"):
        identify([])


def test_a_record_without_a_period_is_no_record() -> None:
    with pytest.raises(ModelError, match=r"period is 0\.0 s"):
        InputOutputRecord(u=np.zeros((3, 2)), y=np.zeros((3, 2)), dt_s=0.0)


def test_lists_and_single_channels_are_columns(draw: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    record = draw(0)
    listed = InputOutputRecord(u=record.u.tolist(), y=record.y.tolist(), dt_s=1.0, input_names=["left", "right"])
    np.testing.assert_array_equal(listed.u, record.u)
    assert listed.input_names == ("left", "right")
    single = InputOutputRecord(u=record.u[:, 0], y=[1] * len(record), dt_s=1.0)
    assert (single.u.shape, single.y.shape, single.y.dtype) == ((len(record), 1), (len(record), 1), np.dtype(float))


def test_arrays_are_kept_as_they_are(draw: Draw) -> None:
    record = draw(0)
    assert InputOutputRecord(u=record.u, y=record.y, dt_s=1.0).u is record.u


@pytest.mark.parametrize(
    ("fields", "error", "message"),
    [
        ({"u": np.zeros((3, 1, 1))}, ShapeMismatch, r"u is of shape \(3, 1, 1\); wanted one row per sample"),
        ({"y": 2.0}, ShapeMismatch, r"y is of shape \(\); wanted one row per sample"),
        ({"u": [[1.0], [2.0, 3.0]]}, ShapeMismatch, "u has rows of different lengths"),
        ({"u": np.zeros((3, 1), dtype=complex)}, RecordError, "u is an array of complex values; wanted .* real numbers"),
        ({"u": np.array([[1], [None], [2]])}, RecordError, "u is an array of object values"),
        ({"y": ["1", "2", "3"]}, RecordError, "y is an array of str values"),
        ({"y": None}, RecordError, "y is None, of type NoneType; wanted one row per sample"),
        ({"dt_s": "0.1"}, ModelError, r"dt_s is '0\.1', of type str; wanted a number"),
        ({"input_names": "left"}, RecordError, "input_names is 'left'; wanted a list of names"),
    ],
)
def test_invalid_record_arguments_are_named(
    fields: dict[str, object], error: type[TreadlineError], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(error, match=message):
        InputOutputRecord(**({"u": np.zeros((3, 1)), "y": np.zeros((3, 1)), "dt_s": 1.0} | fields))
