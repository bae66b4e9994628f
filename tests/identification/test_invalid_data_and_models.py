"""The Python interface rejects unusable data and models with a typed one-line error, as the command line does."""

from collections.abc import Callable
from dataclasses import replace

import jaxtyping
import numpy as np
import pytest

from treadline.core.errors import ModelError, NotFinite, PoorExcitation, RecordError, SettingsError, ShapeMismatch, TreadlineError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import IdentificationOptions, identify

Draw = Callable[..., InputOutputRecord]
Spoil = Callable[[InputOutputRecord], InputOutputRecord]


def constant_first_half(which: str) -> Spoil:
    """Return a fault: a channel that is constant in the first half."""

    def spoil(record: InputOutputRecord) -> InputOutputRecord:
        data = getattr(record, which).copy()
        data[: len(data) // 2, 0] = 0.2
        return replace(record, **{which: data})

    return spoil


FAULTS: dict[str, tuple[Spoil, dict[str, float], type[TreadlineError], str]] = {
    "Inf in an input": (
        lambda r: replace(r, u=np.where(np.arange(len(r))[:, None] == 5, np.inf, r.u)),
        {},
        NotFinite,
        "'left_m_s' holds Inf at sample 5",
    ),
    "NaN everywhere": (lambda r: replace(r, u=np.full_like(r.u, np.nan)), {}, NotFinite, "100 % of the rows hold a NaN"),
    "one row": (lambda r: replace(r, u=r.u[:1], y=r.y[:1]), {}, RecordError, "constant|too few|1 samples"),
    "no row": (lambda r: replace(r, u=r.u[:0], y=r.y[:0]), {}, PoorExcitation, "no samples"),
    "no inputs": (lambda r: replace(r, u=r.u[:, :0], input_names=()), {}, ShapeMismatch, "no inputs"),
    "no outputs": (lambda r: replace(r, y=r.y[:, :0], output_names=()), {}, ShapeMismatch, "no outputs"),
    "transposed": (
        lambda r: InputOutputRecord(u=np.ascontiguousarray(r.u.T), y=np.ascontiguousarray(r.y.T), dt_s=1.0),
        {},
        ShapeMismatch,
        "transposed",
    ),
    "names of other channels": (lambda r: replace(r, input_names=("left_m_s",)), {}, ShapeMismatch, "name"),
    "an input still where it is fitted": (constant_first_half("u"), {"validation": 0.5}, PoorExcitation, "'left_m_s' is constant"),
    "an output still where it is fitted": (constant_first_half("y"), {"validation": 0.5}, PoorExcitation, "'heading' is constant"),
    "a validation part of no samples": (lambda r: r, {"validation": 1e-6}, PoorExcitation, "validation"),
    "a validation part of ten samples": (lambda r: r, {"validation": 0.025}, PoorExcitation, "validation part has 10 .* at least"),
    "a validation part of gaps": (
        lambda r: replace(r, y=np.where(np.arange(len(r))[:, None] >= 360, np.nan, r.y)),
        {"validation": 0.1},
        PoorExcitation,
        "validation part has 0 ",
    ),
    "an order above the samples": (lambda r: r, {"order": 300}, PoorExcitation, "order 300"),
    "an order above what the lags can see": (lambda r: r, {"order": 40}, PoorExcitation, "order 40"),
    "a share that is no number": (lambda r: r, {"validation": float("nan")}, SettingsError, "validation share is nan"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_rejected_in_one_line(draw: Draw, fault: str) -> None:
    spoil, options, error, message = FAULTS[fault]
    spoiled = spoil(draw(0, samples=400, noise=0.05))
    with pytest.raises(error, match=message) as caught:
        identify(spoiled, IdentificationOptions(**options))
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 300


@pytest.mark.parametrize("method", ["okid-era", "era-dc", "pbsid"])
def test_an_order_above_the_rank_of_exact_data_is_rejected(draw: Draw, method: str) -> None:
    with pytest.raises(PoorExcitation, match="order 3 is above the rank 2"):
        identify(draw(0, samples=400), IdentificationOptions(order=3, method=method))


def test_a_validation_record_must_fit_the_fitted_ones(draw: Draw) -> None:
    record = draw(0, samples=400, noise=0.05)
    with pytest.raises(ShapeMismatch, match="has other channels"):
        identify(record, IdentificationOptions(validation=replace(record, y=record.y[:, :1])))


def test_a_second_record_of_one_sample_does_not_change_the_model(draw: Draw) -> None:
    record = draw(0, samples=400, noise=0.05)
    short = replace(record, u=record.u[:1], y=record.y[:1])
    found = identify([record, short], IdentificationOptions(order=2, method="okid-era"))
    assert found.report.samples == 400 - found.gram.lags


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan")])
def test_a_period_must_be_a_positive_number(period: float) -> None:
    with pytest.raises(ModelError, match="period is"):
        InputOutputRecord(u=np.zeros((3, 1)), y=np.zeros((3, 1)), dt_s=period)


def test_an_infinite_period_is_rejected() -> None:
    with pytest.raises(ModelError, match="period is inf"):
        InputOutputRecord(u=np.zeros((3, 1)), y=np.zeros((3, 1)), dt_s=float("inf"))


@pytest.mark.parametrize("name", ["A", "B", "C", "D", "input_offset", "output_offset", "observer_gain"])
def test_a_model_that_holds_nan_or_does_not_fit_is_rejected_by_name(eq_12: LinearModel, name: str) -> None:
    model = replace(eq_12, observer_gain=np.zeros((2, 2)))
    spoiled = getattr(model, name).copy()
    spoiled.flat[0] = np.nan
    with pytest.raises(NotFinite, match=f"{name} holds NaN or Inf"):
        replace(model, **{name: spoiled})
    with pytest.raises(ShapeMismatch, match="transposed"):
        replace(model, **{name: np.zeros((3, *getattr(model, name).shape[1:]))})


@pytest.mark.parametrize("scale", [1e-150, 1e150])
def test_large_and_small_units_are_accepted(draw: Draw, scale: float) -> None:
    record = draw(0, samples=400, noise=0.05)
    plain, scaled = (
        identify(item, IdentificationOptions(order=2, method="okid-era")).model.A
        for item in (record, InputOutputRecord(u=record.u * scale, y=record.y * scale, dt_s=1.0))
    )
    np.testing.assert_allclose(scaled, plain, rtol=1e-9)


def test_arrays_of_any_layout_and_read_only_arrays_are_accepted(draw: Draw) -> None:
    record = draw(0, samples=400, noise=0.05)
    u, y = np.asfortranarray(record.u), np.asfortranarray(record.y)
    for array in (u, y):
        array.setflags(write=False)
    plain, other = (
        identify(item, IdentificationOptions(order=2, method="okid-era")) for item in (record, replace(record, u=u, y=y))
    )
    np.testing.assert_allclose(other.model.A, plain.model.A, atol=1e-12)
    assert other.report.fit_percent == pytest.approx(plain.report.fit_percent)


def test_a_model_accepts_lists_for_matrices(eq_12: LinearModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    lists = {name: getattr(eq_12, name).tolist() for name in ("A", "B", "C", "D", "input_offset", "output_offset")}
    np.testing.assert_array_equal(LinearModel(**lists, dt_s=1.0).B, eq_12.B)
    with pytest.raises(ShapeMismatch, match=r"C is of shape \(2,\); wanted a matrix"):
        LinearModel(**lists | {"C": [1.0, 0.0]}, dt_s=1.0)
