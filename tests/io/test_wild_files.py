"""Wild files: logs as spreadsheets, loggers, ROS tools and MATLAB write them are read, or refused in one line with the remedy.

The files in ``wild`` hold the same 60 rows; ``wild.toml`` says for each how a user reads it.
"""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.core.errors import TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.io.records import read_record

FOLDER = Path(__file__).with_name("wild")
FILES: dict[str, dict[str, dict[str, Any]]] = tomllib.loads(FOLDER.with_suffix(".toml").read_text(encoding="utf-8"))
ROWS, PERIOD_S = 60, 0.05
VALUES = np.round(np.random.default_rng(42).uniform(-1.0, 1.0, (ROWS, 3)), 3)
"""Columns left, right and yaw of each file."""


def read(name: str, **options: Any) -> InputOutputRecord:
    if Path(name).suffix in {".parquet", ".feather"}:
        pytest.importorskip("pyarrow", reason="pyarrow is an extra")
    inputs, outputs = options.pop("inputs", ("left", "right")), options.pop("outputs", ("yaw",))
    return read_record(FOLDER / name, tuple(inputs), tuple(outputs), **options)


@pytest.mark.parametrize("name", FILES["read"])
def test_a_wild_file_is_read_exactly(name: str) -> None:
    """Test: the file by its channels. Expected: the values; of the first input rows ``gaps`` missing, true or false (``flags``)."""
    options, values = dict(FILES["read"][name]), VALUES.copy()
    values[options.pop("gaps", []), 0] = np.nan
    if options.pop("flags", False):
        values[:, 0] = np.arange(ROWS) % 7 < 3
    record = read(name, **options)
    np.testing.assert_array_equal(np.column_stack([record.u, record.y]), values)
    assert record.dt_s == PERIOD_S
    assert (record.u.shape[1], record.y.shape[1]) == (2, 1)


@pytest.mark.parametrize("name", FILES["refused"])
def test_a_file_that_cannot_be_read_is_refused_in_one_line_with_the_remedy(name: str) -> None:
    options = dict(FILES["refused"][name])
    with pytest.raises(TreadlineError, match=options.pop("says")) as caught:
        read(name, **options)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_uneven_clock_is_resampled_where_that_is_asked() -> None:
    assert len(read("jitter.csv", resample=True, period_s=PERIOD_S)) == ROWS
    assert len(read("comma-blank.csv", resample=True, period_s=PERIOD_S / 1.02)) == ROWS + 1  # 59 steps, each within the tolerance


@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9])
def test_the_period_decides_the_unit_of_a_clock_that_names_none(tmp_path: Path, unit: int) -> None:
    times = unit * np.arange(ROWS) // 20 if unit > 1 else PERIOD_S * np.arange(ROWS)
    np.savetxt(tmp_path / "log.csv", np.column_stack([times, VALUES]), "%.15g", ",", header="time,left,right,yaw", comments="")
    assert read(str(tmp_path / "log.csv"), period_s=PERIOD_S).dt_s == PERIOD_S


def test_a_given_period_stands_in_for_a_clock_that_cannot_be_read() -> None:
    assert read("day-first.csv", period_s=0.1).dt_s == 0.1
