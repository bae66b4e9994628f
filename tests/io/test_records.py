"""Records: rows come back exactly; every fault of a CSV file is one line with its place and remedy."""

from pathlib import Path

import numpy as np
import pytest

from treadline.core.errors import LogFormatError, PeriodMismatch
from treadline.io.records import ChunkReader, read_record

INPUTS = ("left_m_s", "right_m_s")
OUTPUTS = ("heading_rad",)
HEADER = "t_s,left_m_s,right_m_s,heading_rad"
ROWS = [f"{0.25 * k},0.2,{0.2 + 0.01 * k},{0.1 - 0.01 * k}" for k in range(10)]


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n" if lines else "")
    return path


@pytest.mark.parametrize("first_s", [0.0, 17.3, 51.0, 1.7e9])
@pytest.mark.parametrize("period_s", [0.05, 0.25, 0.01, 1.0 / 3.0])
def test_the_period_is_the_shortest_decimal_that_the_rounded_stamps_allow(tmp_path: Path, first_s: float, period_s: float) -> None:
    rows = [f"{first_s + period_s * k!r},0.1" for k in range(300)]
    record = read_record(written(tmp_path / "a.csv", ["t_s,heading_rad", *rows]), (), OUTPUTS)
    if period_s == 1.0 / 3.0:  # no decimal: within the spacing of floats at the last stamp
        assert abs(record.dt_s - period_s) <= 2.0 * np.spacing(first_s + 100.0)
    else:
        assert record.dt_s == period_s


@pytest.mark.parametrize("reader", [read_record, lambda *log, **how: next(iter(ChunkReader(*log, **how)))])
@pytest.mark.parametrize(("unit", "per_s"), [("milliseconds", 10**3), ("microseconds", 10**6), ("nanoseconds", 10**9)])
def test_whole_steps_of_seconds_are_refused_until_a_period_says_what_they_count(tmp_path: Path, reader, unit, per_s) -> None:
    def log(clock: str, first: int = 0) -> Path:
        rows = [f"{first + per_s // 20 * k},{0.1 + 0.001 * k}" for k in range(60)]
        return written(tmp_path / "a.csv", [f"{clock},heading_rad", *rows])

    for clock in ("t", "t_s", "time", "timestamp [s]"):
        with pytest.raises(PeriodMismatch, match=f"column '.*' steps by .* s; if it counts {unit}, give --period 0.05 or name it"):
            reader(log(clock), (), OUTPUTS)
        assert reader(log(clock), (), OUTPUTS, period_s=0.05).dt_s == 0.05
        assert reader(log(clock), (), OUTPUTS, period_s=0.05 * per_s).dt_s == 0.05 * per_s
        # Since 1970 the digits say the unit.
        assert reader(log(clock, 1_700_000_000 * per_s), (), OUTPUTS).dt_s == 0.05
    assert reader(log(f"t [{unit}]"), (), OUTPUTS).dt_s == 0.05


@pytest.mark.parametrize("step_s", [1.0, 1.5, 4.0, 60.25])
def test_slow_logs_with_decimals_or_dates_are_read(tmp_path: Path, step_s: float) -> None:
    for first in (0.25, 1.7e9, *([0] if step_s < 10.0 else [])):
        rows = [f"{first + step_s * k!r},0.1" for k in range(20)]
        assert read_record(written(tmp_path / "a.csv", ["t_s,heading_rad", *rows]), (), OUTPUTS).dt_s == step_s


def test_units_in_brackets_are_no_part_of_a_name(tmp_path: Path) -> None:
    rows = [f"{50 * k}, {0.2 + 0.1 * k}, {0.1 - 0.01 * k}" for k in range(10)]
    file = written(tmp_path / "a.csv", ["t [ms], left [m/s], heading [rad]", *rows])
    for inputs, outputs in ((("left_m_s",), ("heading_rad",)), (("left",), ("heading",)), (("left [m/s]",), ("heading [rad]",))):
        record = read_record(file, inputs, outputs)
        assert (record.dt_s, record.u[1, 0], record.y[1, 0]) == (0.05, 0.2 + 0.1, 0.1 - 0.01)


def test_an_endless_cell_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match="no column"):
        read_record(written(tmp_path / "record.csv", [HEADER, "1" * 200_000, ROWS[1]]), INPUTS, OUTPUTS)


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_a_name_of_thousands_of_brackets_is_refused_at_once(tmp_path: Path, suffix: str) -> None:
    file, name = tmp_path / f"record.{suffix}", "[" * 20_000
    if suffix == "csv":
        written(file, [f"{HEADER},{name}", *(row + ",0" for row in ROWS)])
    else:
        np.savez(file, **{name: np.zeros(2)})
    with pytest.raises(LogFormatError, match="a column's name has 20000 characters; 200 at most"):
        read_record(file, INPUTS, OUTPUTS)


@pytest.mark.parametrize("period_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_period_that_is_no_time_is_refused(tmp_path: Path, period_s: float) -> None:
    with pytest.raises(PeriodMismatch, match="--period"):
        read_record(written(tmp_path / "record.csv", [HEADER, *ROWS]), INPUTS, OUTPUTS, period_s=period_s)
