"""A stream of chunks gives the same model as one record, from the first chunk in which every channel moves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from systems import Draw, fit

from treadline.core.errors import NotFinite, PeriodMismatch, PoorExcitation, RecordError
from treadline.core.linear_systems import impulse_response, part
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import IdentificationOptions, Identified, identify_chunks
from treadline.identification import _stream as stream


def in_chunks(record: InputOutputRecord, rows: int) -> list[InputOutputRecord]:
    return [part(record, start, min(start + rows, len(record))) for start in range(0, len(record), rows)]


def fit_chunks(*experiments: list[InputOutputRecord], **options: Any) -> Identified:
    return identify_chunks(*experiments, options=IdentificationOptions(**({"order": 2} | options)))


def assert_eq_12(found: Identified, eq_12: LinearModel) -> None:
    np.testing.assert_allclose(impulse_response(found.model, 20), impulse_response(eq_12, 20), atol=1e-9)


def after_standing(record: InputOutputRecord, samples: int) -> InputOutputRecord:
    """Return the record after a period of rest; its first outputs are those of state zero."""
    u, y = (np.vstack([np.zeros((samples, 2)), part_]) for part_ in (record.u, record.y))
    return InputOutputRecord(u=u, y=y, dt_s=record.dt_s, input_names=record.input_names, output_names=record.output_names)


@pytest.mark.parametrize("rows", [5, 50, 200])
def test_a_stream_that_begins_at_rest_is_identified(draw: Draw, eq_12: LinearModel, rows: int) -> None:
    found = fit_chunks(in_chunks(after_standing(draw(0), 400), rows))
    assert_eq_12(found, eq_12)
    assert not any("left out" in warning for warning in found.report.warnings)


def test_a_long_initial_rest_is_truncated_and_reported(draw: Draw, eq_12: LinearModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "RECENT", 300)
    found = fit_chunks(in_chunks(after_standing(draw(0), 1000), 100))
    assert_eq_12(found, eq_12)
    assert any("the first 700 samples, with a constant channel" in warning for warning in found.report.warnings)


def test_a_stream_that_never_moves_is_rejected(draw: Draw) -> None:
    record = draw(0)
    still = InputOutputRecord(u=np.zeros_like(record.u), y=record.y, dt_s=1.0, input_names=("left", "right"))
    with pytest.raises(PoorExcitation, match="input 'left' is constant"):
        fit_chunks(in_chunks(still, 100))
    with pytest.raises(PoorExcitation, match="there is no chunk"):
        fit_chunks([])


@pytest.mark.parametrize("spoil", ["period", "channels", "infinite"])
def test_a_later_chunk_of_another_kind_is_rejected(draw: Draw, spoil: str) -> None:
    """Test: the third chunk has another period, an additional input, or an infinite sample. Expected result: an error with the
    cause, and no model."""
    chunks = in_chunks(draw(0), 100)
    odd = chunks[2]
    if spoil == "period":
        chunks[2] = InputOutputRecord(u=odd.u, y=odd.y, dt_s=2.0 * odd.dt_s)
    elif spoil == "channels":
        chunks[2] = InputOutputRecord(u=np.hstack([odd.u, odd.u[:, :1]]), y=odd.y, dt_s=odd.dt_s)
    else:
        y = odd.y.copy()
        y[5, 0] = np.inf
        chunks[2] = InputOutputRecord(u=odd.u, y=y, dt_s=odd.dt_s)
    with pytest.raises((RecordError, PeriodMismatch)):
        fit_chunks(chunks)


def with_gaps(record: InputOutputRecord, rows: slice | np.ndarray) -> InputOutputRecord:
    y = record.y.copy()
    y[rows] = np.nan
    return replace(record, y=y)


def test_several_experiments_are_summed_as_if_read_whole(draw: Draw) -> None:
    records = [draw(seed) for seed in (0, 1, 2)]
    whole = fit(records, order=2, lags=6, method="okid-era")
    streamed = fit_chunks(*(in_chunks(record, 70) for record in records), lags=6, method="okid-era")
    # The same windows, none across a border, in other units: equal to rounding.
    np.testing.assert_allclose(impulse_response(streamed.model, 20), impulse_response(whole.model, 20), atol=1e-9)
    assert streamed.gram.count == whole.gram.count == sum(len(record) - 6 for record in records)


@pytest.mark.parametrize("rows", [[1000, 60], [60, 1000], [1000], [1000, 12], [500, 500, 60]])
def test_chunks_of_unequal_length_give_the_same_order(draw: Draw, rows: list[int]) -> None:
    """Test: noise that hides the second mode in few windows. Expected result: the same order for all divisions into chunks."""
    records = [draw(seed, samples=count, noise=0.3) for seed, count in enumerate(rows)]
    by_chunks = fit_chunks(*([record] for record in records), order=None, method="okid-era", lags=8)
    assert by_chunks.report.order == fit(records, method="okid-era", lags=8).report.order


def test_data_before_a_long_pause_are_used_for_validation_if_no_data_follow(draw: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "RECENT", 100)
    record = draw(0)
    found = fit_chunks(in_chunks(with_gaps(record, slice(850, 1000)), 60))
    assert sum(len(part_) for part_ in found.judged) == 100
    np.testing.assert_array_equal(found.judged[-1].y[-1], record.y[849])
    assert all(value > 99.0 for value in found.report.fit_percent.values())


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_stream_with_too_many_gaps_is_rejected(draw: Draw, share: float) -> None:
    rows = np.arange(1000)
    spoilt = with_gaps(draw(0), rows[rows % 2 == 0] if share < 1.0 else rows)
    with pytest.raises(NotFinite, match=f"{100 * share:.0f} % of the rows hold a NaN"):
        fit_chunks(in_chunks(spoilt, 100))


def test_a_chunk_of_gaps_is_accepted_in_a_mostly_complete_stream(draw: Draw, eq_12: LinearModel) -> None:
    """Test: a logger pauses for two chunks of twenty, then for six. Expected result: a model; an error with the share."""
    record = draw(0)
    tenth, third = (slice(100, 100 + len(record) * part_ // 20) for part_ in (2, 6))
    found = fit_chunks(in_chunks(with_gaps(record, tenth), len(record) // 20))
    assert_eq_12(found, eq_12)
    assert found.report.dropped >= len(record) // 10
    with pytest.raises(NotFinite, match="30 % of the rows hold a NaN"):
        fit_chunks(in_chunks(with_gaps(record, third), len(record) // 20))
