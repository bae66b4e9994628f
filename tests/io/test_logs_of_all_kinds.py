"""Logs of all kinds: the same record comes out of each, bit for bit, and each fault is one line with place and remedy."""

import bz2
import io
import os
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from treadline.core.errors import LogFormatError, NotFinite, TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.core.signals import SeatReading, TrackCommand
from treadline.io import _array_files, mcap_read
from treadline.io.mcap_log import RunLog
from treadline.io.records import read_record

from .conftest import ANSWER, KINDS


def refused(path: Path, inputs: tuple[str, ...], outputs: tuple[str, ...], words: str, **options: object) -> TreadlineError:
    with pytest.raises(TreadlineError, match=words) as caught:
        read_record(path, inputs, outputs, **options)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return caught.value


def test_every_kind_of_log_gives_the_same_record_and_lists_its_columns(written, record: InputOutputRecord, kind: str) -> None:
    log = written(kind, record)
    back = read_record(log.path, log.inputs, log.outputs)
    assert back.u.tobytes() == record.u.tobytes()
    assert back.y.tobytes() == record.y.tobytes()
    assert back.dt_s == record.dt_s
    assert (back.input_names, back.output_names) == (log.inputs, log.outputs)
    there = log.outputs[0] if kind in KINDS else ANSWER
    error = refused(log.path, log.inputs, ("/nowhere.x",), f"nowhere.*there are: (.*, )?{there.partition('[')[0]}")
    assert isinstance(error, LogFormatError)


def test_every_format_checks_units_gaps_and_infinity(written, record: InputOutputRecord, kind: str) -> None:
    row = np.arange(40)[:, None] == 7
    log = written(kind, replace(record, y=np.where(row, np.inf, record.y)))
    refused(log.path, log.inputs, log.outputs, "Inf", allow_gaps=True)
    log = written(kind, replace(record, y=np.where(row, np.nan, record.y)))
    assert isinstance(refused(log.path, log.inputs, log.outputs, "NaN.*--allow-gaps"), NotFinite)
    back = read_record(log.path, log.inputs, log.outputs, allow_gaps=True)
    assert np.flatnonzero(np.isnan(back.y[:, 0])).tolist() == [7]
    log = written(kind, replace(record, u=1000.0 * record.u))
    if log.inputs == record.input_names:  # others name no unit
        refused(log.path, log.inputs, log.outputs, "millimetres")


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("")
    refused(tmp_path, ("a",), ("b",), r"without record\.csv")
    refused(tmp_path / "log.csv", ("a",), ("b",), "no such file")
    os.mkfifo(tmp_path / "log.csv")
    refused(tmp_path / "log.csv", ("a",), ("b",), "neither a file nor a folder")


T = 0.25 * np.arange(10)


def test_objects_are_never_unpickled(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return print, ("sprung",)

    np.savez(tmp_path / "log.npz", a=np.array([Trap()] * 10), b=T, t_s=T)
    refused(tmp_path / "log.npz", ("a",), ("b",), "'a' holds object")


def test_an_archive_that_unpacks_beyond_the_cap_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_array_files, "MAX_BYTES", 100_000)
    zeros = np.zeros(100_000)
    np.savez_compressed(tmp_path / "log.npz", a=zeros, b=zeros)
    savemat(tmp_path / "log.mat", {"a": zeros, "b": zeros}, do_compression=True)
    for name in ("log.npz", "log.mat"):
        assert (tmp_path / name).stat().st_size < 10_000
        refused(tmp_path / name, ("a",), ("b",), "100000 (bytes that )?are read", period_s=1.0)


def test_a_header_that_promises_more_than_the_archive_holds_is_refused(tmp_path: Path) -> None:
    data = io.BytesIO()
    np.lib.format.write_array_header_1_0(data, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("a.npy", data.getvalue() + b"\x00" * 80)
    refused(tmp_path / "log.npz", ("a",), (), "not a valid NPZ file", period_s=1.0)


def test_an_array_of_negative_size_is_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", {"a": T})
    data, sizes = (tmp_path / "log.mat").read_bytes(), [np.array([5, 8, 1, rows], np.int32).tobytes() for rows in (10, -10)]
    assert sizes[0] in data
    (tmp_path / "log.mat").write_bytes(data.replace(*sizes))
    refused(tmp_path / "log.mat", ("a",), (), r"'a' has the shape \(1, -10\)", period_s=1.0)


def test_what_needs_an_extra_says_how_to_get_it(written, record: InputOutputRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    log = written("parquet", record)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    refused(log.path, log.inputs, log.outputs, r"pip install '\.\[parquet\]'")


def test_a_run_folder_without_a_record_is_read_from_its_log(tmp_path: Path) -> None:
    with RunLog(tmp_path / "log.mcap") as log:
        for k in range(20):
            log(SeatReading(t_s=0.25 * k, pitch_rad=0.01 * k, stroke_m=0.05))
            log(TrackCommand(t_s=0.25 * k, left_m_s=0.1 * k, right_m_s=0.2))
    record = read_record(tmp_path, ("/tracks/cmd.left_m_s",), ("/seat/state.pitch_rad",))
    np.testing.assert_array_equal(record.u[:, 0], 0.1 * np.arange(20))
    np.testing.assert_array_equal(record.y[:, 0], 0.01 * np.arange(20))
    assert record.dt_s == 0.25


@pytest.mark.parametrize(
    ("kind", "cap", "most", "words"),
    [
        *((kind, "MAX_CHUNK_BYTES", 1000, "1000") for kind in ("mcap", "mcap lz4", "mcap bare", "bag bz2", "bag lz4")),
        *((kind, "MAX_MESSAGES", 10, "more than 10 messages") for kind in ("mcap", "bag", "db3")),
    ],
)
def test_a_log_beyond_a_cap_is_refused(
    written, record: InputOutputRecord, monkeypatch: pytest.MonkeyPatch, kind: str, cap: str, most: int, words: str
) -> None:
    log = written(kind, record)
    monkeypatch.setattr(mcap_read, cap, most)
    refused(log.path, log.inputs, log.outputs, words)


def test_a_decompression_bomb_in_a_bag_is_not_unpacked(written, record: InputOutputRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    log = written("bag bz2", record)
    data = log.path.read_bytes()
    bomb = bz2.compress(bytes(10**7))
    at = data.index(b"BZh")
    log.path.write_bytes(data[:at] + bomb + data[at + len(bomb) :])
    monkeypatch.setattr(mcap_read, "MAX_CHUNK_BYTES", 10**6)
    refused(log.path, log.inputs, log.outputs, "more than 1000000 bytes")
