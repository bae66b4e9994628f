"""Damaged logs: any damage gives a typed error or a record, with bounded memory."""

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from treadline.core.errors import TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.io.records import read_record

CHECKSUMMED = ("npz", "mat compressed", "mcap", "mcap lz4")
"""What is read from these after damage is what was written."""
BARE = ("csv", "mat", "mat 4", "mcap bare", "bag", "bag bz2", "bag lz4", "db3", "parquet")
CASES = 40
MOST_BYTES = 64 * 1024**2


def damaged(data: bytes, seed: int) -> Iterator[bytes]:
    rng = np.random.default_rng(seed)
    for k in range(CASES):
        changed = bytearray(data)
        if k % 4 == 0:
            del changed[int(rng.integers(0, len(data))) :]
        elif k % 4 == 1:  # a length that asks for everything
            at = int(rng.integers(0, len(data) - 8))
            changed[at : at + 8] = b"\xff" * int(rng.choice([3, 7])) + b"\x00"
        else:  # headers stand in front
            for at in rng.integers(0, len(data) if k % 4 == 2 else min(len(data), 800), 3).tolist():
                changed[at] = int(rng.choice([0, 1, 15, 128, 255, rng.integers(0, 256)]))
        yield bytes(changed)


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
    errors = []
    tracemalloc.start()
    try:
        for data in damaged(whole, seed=sum(map(ord, damaged_kind))):
            log.path.write_bytes(data)
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
    assert len(errors) > CASES // 5
    assert all("\n" not in error and log.path.name in error for error in errors)
    assert peak < MOST_BYTES
    assert capfd.readouterr() == ("", "")
