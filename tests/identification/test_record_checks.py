"""Data, options and models that cannot be used are rejected in one line with the observed number and a remedy."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from systems import Draw, fit

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
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification.options import fewest_samples, max_supported_lags

Spoil = Callable[[InputOutputRecord], InputOutputRecord]


def with_values(which: str, rows: slice | int, column: int | slice, value: float) -> Spoil:
    """Return a fault: a value in some samples of a channel."""

    def spoil(record: InputOutputRecord) -> InputOutputRecord:
        data = getattr(record, which).copy()
        data[rows, column] = value
        return replace(record, **{which: data})

    return spoil


def transposed(record: InputOutputRecord) -> InputOutputRecord:
    return InputOutputRecord(u=np.ascontiguousarray(record.u.T), y=np.ascontiguousarray(record.y.T), dt_s=1.0)


def in_degrees(record: InputOutputRecord) -> InputOutputRecord:
    return replace(record, y=np.rad2deg(record.y), output_names=("heading_rad", "yaw_rate_rad_s"))


EVERY, FIRST_HALF = slice(None), slice(0, 200)
FAULTS: dict[str, tuple[Spoil, dict[str, Any], type[TreadlineError], str]] = {
    "Inf in an input": (with_values("u", 5, 0, np.inf), {}, NotFinite, "'left_m_s' holds Inf at sample 5"),
    "NaN everywhere": (with_values("u", EVERY, EVERY, np.nan), {}, NotFinite, "100 % of the rows hold a NaN"),
    "gaps": (with_values("y", slice(0, None, 4), 0, np.nan), {}, NotFinite, "25 % of the rows hold a NaN, more than 20 %"),
    # Every window of eight lags or more contains a gap.
    "gaps in every window": (
        with_values("y", slice(0, None, 8), 0, np.nan),
        {"lags": 8},
        PoorExcitation,
        r"400 samples are too few: .* 8 lags need at least 79, and gaps cost 392",
    ),
    "inputs at rest": (with_values("u", EVERY, EVERY, 0.2), {}, PoorExcitation, r"no input moves \(left_m_s, right_m_s\)"),
    "an input that moves in the first row alone": (
        with_values("u", slice(1, None), 0, 0.2),
        {},
        PoorExcitation,
        r"'left_m_s' moved by ±\d+(\.\d)? mm/s, at the start of the record or at gaps alone; give a record in which it moves",
    ),
    "an output at rest": (with_values("y", EVERY, 1, 0.0), {}, PoorExcitation, "output 'yaw_rate' is constant"),
    "one row": (lambda r: replace(r, u=r.u[:1], y=r.y[:1]), {}, RecordError, "no input moves|too few|1 samples"),
    "no row": (lambda r: replace(r, u=r.u[:0], y=r.y[:0]), {}, PoorExcitation, "holds no samples"),
    "no inputs": (lambda r: replace(r, u=r.u[:, :0], input_names=()), {}, ShapeMismatch, "no inputs"),
    "no outputs": (lambda r: replace(r, y=r.y[:, :0], output_names=()), {}, ShapeMismatch, "no outputs"),
    "transposed": (transposed, {}, ShapeMismatch, "transposed"),
    "names of other channels": (lambda r: replace(r, input_names=("left_m_s",)), {}, ShapeMismatch, "name"),
    "degrees": (in_degrees, {}, ShapeMismatch, r"'heading_rad' reaches \d+\.\d, beyond π: degrees"),
    "inputs still where they are fitted": (
        with_values("u", FIRST_HALF, EVERY, 0.2),
        {"validation": 0.5},
        PoorExcitation,
        "'left_m_s' is constant",
    ),
    "a validation part of no samples": (lambda r: r, {"validation": 1e-6}, PoorExcitation, "validation"),
    "a validation part of ten samples": (lambda r: r, {"validation": 0.025}, PoorExcitation, "validation part has 10 .* at least"),
    "a validation part of gaps": (
        with_values("y", slice(360, None), EVERY, np.nan),
        {"validation": 0.1},
        PoorExcitation,
        "validation part has 0 ",
    ),
    "an order above the samples": (lambda r: r, {"order": 300}, PoorExcitation, "order 300"),
    "no order": (lambda r: r, {"order": 0}, SettingsError, "order is 0; it must be an integer, at least 1"),
    "no lags": (lambda r: r, {"lags": 0}, SettingsError, "lags is 0; it must be an integer, at least 1"),
    "forgetting without earlier data": (
        lambda r: r,
        {"forgetting": 0.99},
        SettingsError,
        "forgetting has no effect without earlier data",
    ),
    "a word for dead times": (lambda r: r, {"delays": "some"}, SettingsError, "delays is 'some'; give a whole number of samples"),
    **{
        f"dead times {shifts}": (
            lambda r: r,
            {"delays": shifts},
            SettingsError,
            r"one integer per input \(2\), from 0 to less than a record's length",
        )
        for shifts in ([], [1], [1, 0, 2], [-1, 0], [0, 400])
    },
    "an unknown method": (
        lambda r: r,
        {"method": "guess"},
        SettingsError,
        "method is 'guess'; allowed: best, okid-era, pbsid, deconvolution",
    ),
    "a share that is no number": (lambda r: r, {"validation": float("nan")}, SettingsError, "validation share is nan"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_rejected_in_one_line(draw: Draw, fault: str) -> None:
    spoil, options, error, message = FAULTS[fault]
    spoiled = spoil(draw(0, samples=400, noise=0.05))
    with pytest.raises(error, match=message) as caught:
        fit(spoiled, **options)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("method", ["best", "okid-era", "pbsid"])
def test_an_order_above_the_rank_of_exact_data_is_rejected(draw: Draw, method: str) -> None:
    with pytest.raises(PoorExcitation, match="order 3 is above the rank 2"):
        fit(draw(0, samples=400), order=3, method=method)


def test_an_angle_that_was_unwrapped_may_pass_pi_if_its_name_says_so(draw: Draw) -> None:
    record = draw(0)
    y = record.y + np.array([20.0, 0.0])
    found = fit(replace(record, y=y, output_names=("yaw_unwrapped_rad", "yaw_rate_rad_s")), order=2)
    # The nearest operating point to the data's means, among the many allowed by an input offset.
    assert found.model.output_offset[0] == pytest.approx(20.0, abs=0.1)


def test_a_short_record_says_how_many_samples_are_needed(draw: Draw) -> None:
    # A row holds a constant, both current inputs, and two inputs and two outputs of one lag: 7 coefficients with
    # 8 windows each, and one lag.
    with pytest.raises(TooFewSamples, match=r"12 samples are too few: 2 inputs, 2 outputs .* need at least 57$"):
        fit(draw(0, samples=12))
    with pytest.raises(TooFewSamples, match="56 samples are too few"):
        fit(draw(0, samples=56))
    assert fit(draw(0, samples=57)).model.order >= 1
    # Given lags need two windows for each of 1203 coefficients and one more, after 300 samples.
    with pytest.raises(TooFewSamples, match=r"need at least 2707$"):
        fit(draw(0), order=2, lags=300)


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


def test_records_that_do_not_belong_together_are_rejected(draw: Draw) -> None:
    record = draw(0, samples=400, noise=0.05)
    other = replace(record, y=record.y[:, :1])
    with pytest.raises(PeriodMismatch, match=r"record 2: period 0\.5 s, the first record has 1 s"):
        fit([record, replace(record, dt_s=0.5)])
    with pytest.raises(ShapeMismatch, match="record 2: has other channels"):
        fit([record, other])
    with pytest.raises(ShapeMismatch, match="has other channels"):
        fit(record, validation=other)
    with pytest.raises(SettingsError, match="at least one record"):
        fit([])


def test_a_second_record_of_one_sample_does_not_change_the_model(draw: Draw) -> None:
    record = draw(0, samples=400, noise=0.05)
    found = fit([record, replace(record, u=record.u[:1], y=record.y[:1])], order=2, method="okid-era")
    assert found.report.samples == 400 - found.gram.lags


@pytest.mark.parametrize("scale", [1e-150, 1e150])
def test_large_and_small_units_are_accepted(draw: Draw, scale: float) -> None:
    record = draw(0, samples=400, noise=0.05)
    scaled = replace(record, u=record.u * scale, y=record.y * scale)
    plain, other = (fit(item, order=2, method="okid-era", name_prior=False).model.A for item in (record, scaled))
    np.testing.assert_allclose(other, plain, rtol=1e-9)


@pytest.mark.usefixtures("without_shape_checks")
def test_lists_and_single_channels_are_columns(draw: Draw) -> None:
    record = draw(0)
    listed = InputOutputRecord(u=record.u.tolist(), y=record.y.tolist(), dt_s=1.0, input_names=["left", "right"])
    np.testing.assert_array_equal(listed.u, record.u)
    assert listed.input_names == ("left", "right")
    single = InputOutputRecord(u=record.u[:, 0], y=[1] * len(record), dt_s=1.0)
    assert (single.u.shape, single.y.shape, single.y.dtype) == ((len(record), 1), (len(record), 1), np.dtype(float))


@pytest.mark.parametrize(
    ("fields", "error", "message"),
    [
        ({"u": np.zeros((3, 1, 1))}, ShapeMismatch, r"u is of shape \(3, 1, 1\); wanted one row per sample"),
        ({"u": [[1.0], [2.0, 3.0]]}, ShapeMismatch, "u has rows of different lengths"),
        ({"u": np.zeros((3, 1), dtype=complex)}, RecordError, "u is an array of complex values; wanted .* real numbers"),
        ({"u": np.array([[1], [None], [2]])}, RecordError, "u is an array of object values"),
        ({"y": None}, RecordError, "y is None, of type NoneType; wanted one row per sample"),
        ({"dt_s": "0.1"}, ModelError, r"dt_s is '0\.1', of type str; wanted a number"),
        ({"dt_s": 0.0}, ModelError, r"period is 0\.0 s"),
        ({"dt_s": float("inf")}, ModelError, "period is inf"),
        ({"input_names": "left"}, RecordError, "input_names is 'left'; wanted a list of names"),
    ],
)
@pytest.mark.usefixtures("without_shape_checks")
def test_invalid_record_arguments_are_named(fields: dict[str, object], error: type[TreadlineError], message: str) -> None:
    with pytest.raises(error, match=message):
        InputOutputRecord(**({"u": np.zeros((3, 1)), "y": np.zeros((3, 1)), "dt_s": 1.0} | fields))


@pytest.mark.parametrize("name", ["A", "B", "C", "D", "input_offset", "output_offset", "observer_gain"])
def test_a_model_that_holds_nan_or_does_not_fit_is_rejected_by_name(eq_12: LinearModel, name: str) -> None:
    model = replace(eq_12, observer_gain=np.zeros((2, 2)))
    spoiled = getattr(model, name).copy()
    spoiled.flat[0] = np.nan
    with pytest.raises(NotFinite, match=f"{name} holds NaN or Inf"):
        replace(model, **{name: spoiled})
    with pytest.raises(ShapeMismatch, match="transposed"):
        replace(model, **{name: np.zeros((3, *getattr(model, name).shape[1:]))})


@pytest.mark.usefixtures("without_shape_checks")
def test_a_model_accepts_lists_for_matrices(eq_12: LinearModel) -> None:
    lists = {name: getattr(eq_12, name).tolist() for name in ("A", "B", "C", "D", "input_offset", "output_offset")}
    np.testing.assert_array_equal(LinearModel(**lists, dt_s=1.0).B, eq_12.B)
    with pytest.raises(ShapeMismatch, match=r"C is of shape \(2,\); wanted a matrix"):
        LinearModel(**lists | {"C": [1.0, 0.0]}, dt_s=1.0)
