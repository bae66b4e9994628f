"""A stream of chunks: as one record, from the chunk on in which every channel moves."""

from collections.abc import Callable

import numpy as np
import pytest

from treadline.errors import PeriodMismatch, PoorExcitation, RecordError
from treadline.identification import identify_chunks, stream
from treadline.identification.validate import impulse_response, part
from treadline.models import InputOutputRecord, LinearModel

Draw = Callable[..., InputOutputRecord]


def in_chunks(record: InputOutputRecord, rows: int) -> list[InputOutputRecord]:
    return [part(record, start, min(start + rows, len(record))) for start in range(0, len(record), rows)]


def after_standing(record: InputOutputRecord, samples: int) -> InputOutputRecord:
    """Return the record with a time of rest before it: its first outputs are those of the state zero."""
    u, y = (np.vstack([np.zeros((samples, 2)), part_]) for part_ in (record.u, record.y))
    return InputOutputRecord(u=u, y=y, dt_s=record.dt_s, input_names=record.input_names, output_names=record.output_names)


@pytest.mark.parametrize("rows", [50, 200])
def test_a_stream_that_stands_still_at_first_is_waited_for(draw: Draw, eq_12: LinearModel, rows: int) -> None:
    found = identify_chunks(in_chunks(after_standing(draw(0), 400), rows), order=2)
    np.testing.assert_allclose(impulse_response(found.model, 20), impulse_response(eq_12, 20), atol=1e-9)
    assert not any("left out" in warning for warning in found.report.warnings)


def test_of_a_long_rest_the_end_is_kept_and_the_loss_told(draw: Draw, eq_12: LinearModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "KEPT", 300)
    found = identify_chunks(in_chunks(after_standing(draw(0), 1000), 100), order=2)
    np.testing.assert_allclose(impulse_response(found.model, 20), impulse_response(eq_12, 20), atol=1e-9)
    assert any("the first 700 samples, in which a channel stands still" in warning for warning in found.report.warnings)


def test_chunks_too_short_alone_are_long_enough_together(draw: Draw, eq_12: LinearModel) -> None:
    found = identify_chunks(in_chunks(draw(0), 5), order=2)
    np.testing.assert_allclose(impulse_response(found.model, 20), impulse_response(eq_12, 20), atol=1e-9)


def test_a_stream_that_never_moves_is_refused(draw: Draw) -> None:
    record = draw(0)
    still = InputOutputRecord(u=np.zeros_like(record.u), y=record.y, dt_s=1.0, input_names=("left", "right"))
    with pytest.raises(PoorExcitation, match="input 'left' is constant"):
        identify_chunks(in_chunks(still, 100), order=2)
    with pytest.raises(PoorExcitation, match="there is no chunk"):
        identify_chunks([], order=2)


@pytest.mark.parametrize("spoil", ["period", "channels", "infinite"])
def test_a_later_chunk_of_another_kind_is_refused(draw: Draw, spoil: str) -> None:
    """Test: the third chunk has another period, an input more, or an infinite sample. Expected result: an error that says so, and
    no model."""
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
        identify_chunks(chunks, order=2)
