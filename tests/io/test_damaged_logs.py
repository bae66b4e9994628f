"""Damaged logs: any damage gives a typed error or a record, with bounded memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from mutations import mutated_bytes

from treadline.core.errors import TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.io.records import read_record

CHECKSUMMED = ("npz", "mat compressed", "mcap", "mcap lz4")
"""What is read from these after damage is what was written."""
BARE = ("csv", "mat", "mat 4", "mcap bare", "bag", "bag bz2", "bag lz4", "db3", "parquet")
CASES = 40
MOST_BYTES = 64 * 1024**2


@pytest.fixture
def short(record: InputOutputRecord) -> InputOutputRecord:
    return replace(record, u=record.u[:12], y=record.y[:12])


@pytest.mark.parametrize("damaged_kind", [*CHECKSUMMED, *BARE])
def test_a_damaged_log_is_refused_or_read_and_asks_for_no_more_memory(
    written, short: InputOutputRecord, damaged_kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    log = written(damaged_kind, short)
    whole = log.path.read_bytes()
    read_record(log.path, log.inputs, log.outputs)  # imports are not the log's memory
    errors, rng = [], np.random.default_rng(sum(map(ord, damaged_kind)))
    tracemalloc.start()
    try:
        for _ in range(CASES):
            log.path.write_bytes(mutated_bytes(whole, rng))
            try:
                back = read_record(log.path, log.inputs, log.outputs)
            except TreadlineError as error:
                errors.append(str(error))
            else:
                assert np.isfinite(back.u).all()
                assert damaged_kind not in CHECKSUMMED or back.u.tobytes() == short.u.tobytes()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(errors) > CASES // 10
    assert all("\n" not in error and log.path.name in error for error in errors)
    assert peak < MOST_BYTES
    assert capfd.readouterr() == ("", "")
