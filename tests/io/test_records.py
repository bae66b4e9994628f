"""Records: rows come back exactly; every fault of a CSV file is one line with its place and remedy."""

from pathlib import Path

import numpy as np
import pytest

from treadline.core.errors import LogFormatError, NotFinite, PeriodMismatch, RecordError, ShapeMismatch
from treadline.io.records import clock_warning, read_chunks, read_record

INPUTS = ("left_m_s", "right_m_s")
OUTPUTS = ("heading_rad",)
HEADER = "t_s,left_m_s,right_m_s,heading_rad"
ROWS = [f"{0.25 * k},0.2,{0.2 + 0.01 * k},{0.1 - 0.01 * k}" for k in range(10)]


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n" if lines else "")
    return path


def replaced(k: int, row: str) -> list[str]:
    return [HEADER, *ROWS[:k], row, *ROWS[k + 1 :]]


def test_columns_are_found_by_name_not_by_place(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["heading_rad,note,t_s", "0.1,x,0", "0.2,y,1", "0.3,z,2"])
    assert read_record(path, (), ("heading_rad",)).y[:, 0].tolist() == [0.1, 0.2, 0.3]


@pytest.mark.parametrize("first_s", [0.0, 17.3, 51.0, 1.7e9])
@pytest.mark.parametrize("period_s", [0.05, 0.25, 0.01, 1.0 / 3.0])
def test_the_period_is_the_shortest_decimal_that_the_rounded_stamps_allow(tmp_path: Path, first_s: float, period_s: float) -> None:
    rows = [f"{first_s + period_s * k!r},0.1" for k in range(300)]
    record = read_record(written(tmp_path / "a.csv", ["t_s,heading_rad", *rows]), (), OUTPUTS)
    if period_s == 1.0 / 3.0:  # no decimal: within the spacing of floats at the last stamp
        assert abs(record.dt_s - period_s) <= 2.0 * np.spacing(first_s + 100.0)
    else:
        assert record.dt_s == period_s


def test_a_clock_in_milliseconds_is_named_where_the_period_shows_it(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["t_s,heading_rad", *(f"{250 * k},0.1" for k in range(9))])
    with pytest.raises(PeriodMismatch, match=r"does column 't_s' count milliseconds\? divide it by 1000"):
        read_record(path, (), OUTPUTS, period_s=0.25)
    warning = clock_warning(read_record(path, (), OUTPUTS).dt_s)
    assert warning is not None
    assert "divide it by 1000: the period is then 0.25 s" in warning
    assert [clock_warning(period_s) for period_s in (0.25, 1.5, 60.25)] == [None] * 3


FAULTS = {
    "missing column": (
        ["t_s,left_m_s", "0,1", "1,1"],
        LogFormatError,
        r"right_m_s.*there are: t_s, left_m_s\); name columns with --inputs",
    ),
    "empty": ([], LogFormatError, "empty"),
    "header only": ([HEADER], LogFormatError, "two rows"),
    "one row": ([HEADER, ROWS[0]], LogFormatError, "two rows"),
    "a word": (replaced(3, "0.75,fast,0.2,0.1"), LogFormatError, ":5: column 'left_m_s' holds 'fast'"),
    "infinity": (replaced(3, "0.75,inf,0.2,0.1"), NotFinite, ":5: column 'left_m_s' holds Inf"),
    "a gap": (replaced(3, "0.75,0.2,0.2,nan"), NotFinite, ":5: column 'heading_rad' holds NaN.*--allow-gaps"),
    "an empty cell": (replaced(3, "0.75,0.2,0.2,"), NotFinite, ":5: column 'heading_rad' holds NaN"),
    "time stands": (replaced(3, ROWS[2]), RecordError, ":5: column 't_s' does not increase"),
    "time goes back": (replaced(3, "0.1,0.2,0.2,0.1"), RecordError, ":5: column 't_s' does not increase"),
    "irregular": (replaced(3, "0.78,0.2,0.2,0.1"), PeriodMismatch, ":5: .*--resample"),
    "ragged": (replaced(3, "0.75,0.2"), ShapeMismatch, ":5: 2 cells, the header has 4"),
    "degrees": (replaced(3, "0.75,0.2,0.2,20.0"), RecordError, "heading_rad.*degrees"),
    "doubled column": ([HEADER + ",left_m_s", *[row + ",0" for row in ROWS]], LogFormatError, ": column 'left_m_s' occurs twice"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_is_named_with_its_place_on_one_line(tmp_path: Path, case: str) -> None:
    lines, kind, words = FAULTS[case]
    with pytest.raises(kind, match=rf"record\.csv.*{words}") as caught:
        read_record(written(tmp_path / "record.csv", lines), INPUTS, OUTPUTS)
    assert "\n" not in str(caught.value)


def test_an_angle_that_was_unwrapped_may_pass_pi_if_its_name_says_so(tmp_path: Path) -> None:
    lines = [line.replace("heading_rad", "heading_unwrapped_rad") for line in replaced(3, "0.75,0.2,0.2,20.0")]
    record = read_record(written(tmp_path / "record.csv", lines), INPUTS, ("heading_unwrapped_rad",))
    assert record.y[3, 0] == 20.0


def test_allowed_gaps_stay_as_rows_of_nan_up_to_a_fifth(tmp_path: Path) -> None:
    def gaps(count: int) -> Path:
        rows = [f"{0.25 * k},0.2,0.2," if k < count else ROWS[k] for k in range(10)]
        return written(tmp_path / "record.csv", [HEADER, *rows])

    record = read_record(gaps(2), INPUTS, OUTPUTS, allow_gaps=True)
    assert np.isnan(record.y[:, 0]).tolist() == [True] * 2 + [False] * 8
    with pytest.raises(NotFinite, match="30%"):
        read_record(gaps(3), INPUTS, OUTPUTS, allow_gaps=True)


def test_rows_that_are_missing_come_back_as_rows_of_nan(tmp_path: Path) -> None:
    lines = [HEADER, *(row for k, row in enumerate(ROWS) if k not in (4, 7))]
    path = written(tmp_path / "record.csv", lines)
    with pytest.raises(
        PeriodMismatch, match=r"a step of 0\.5 s where the period is 0\.25 s; if rows are missing, pass --allow-gaps"
    ):
        read_record(path, INPUTS, OUTPUTS)
    whole = read_record(written(tmp_path / "whole.csv", [HEADER, *ROWS]), INPUTS, OUTPUTS)
    record = read_record(path, INPUTS, OUTPUTS, allow_gaps=True)
    assert np.flatnonzero(np.isnan(record.u).all(axis=1) & np.isnan(record.y).all(axis=1)).tolist() == [4, 7]
    there = np.isfinite(record.y[:, 0])
    np.testing.assert_array_equal(record.y[there], whole.y[there])
    np.testing.assert_array_equal(record.u[there], whole.u[there])


def test_missing_rows_count_as_gaps_and_must_leave_the_others_on_the_grid(tmp_path: Path) -> None:
    few = written(tmp_path / "few.csv", [HEADER, *ROWS[:3], ROWS[-1]])
    with pytest.raises(NotFinite, match="hold NaN or are missing"):
        read_record(few, INPUTS, OUTPUTS, allow_gaps=True)
    off = written(tmp_path / "off.csv", replaced(3, "0.78,0.2,0.2,0.1"))
    with pytest.raises(PeriodMismatch, match="pass --resample"):
        read_record(off, INPUTS, OUTPUTS, allow_gaps=True)
    wild = written(tmp_path / "wild.csv", [HEADER, *ROWS, "1e12,0.2,0.2,0.1"])
    with pytest.raises(PeriodMismatch, match=r":12: a step of 1e\+12 s"):
        read_record(wild, INPUTS, OUTPUTS, allow_gaps=True)


def test_resampling_holds_inputs_and_interpolates_outputs(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["t_s,left_m_s,heading_rad", "0,1,0.0", "1,2,0.1", "2,3,0.2", "4,4,0.4", "5,5,0.5"])
    record = read_record(path, ("left_m_s",), OUTPUTS, resample=True)
    assert record.u[:, 0].tolist() == [1, 2, 3, 3, 4, 5]
    # The straight line, but for rounding.
    np.testing.assert_allclose(record.y[:, 0], 0.1 * np.arange(6), atol=1e-15)


def test_an_endless_cell_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match="no column"):
        read_record(written(tmp_path / "record.csv", [HEADER, "1" * 200_000, ROWS[1]]), INPUTS, OUTPUTS)


@pytest.mark.parametrize("period_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_period_that_is_no_time_is_refused(tmp_path: Path, period_s: float) -> None:
    with pytest.raises(PeriodMismatch, match="--period"):
        read_record(written(tmp_path / "record.csv", [HEADER, *ROWS]), INPUTS, OUTPUTS, period_s=period_s)


def iso(k: int, suffix: str) -> str:
    """Return the ISO 8601 time of row k of a record at 4 Hz, across midnight."""
    minute, second = divmod(59 * 60 + 58 + 0.25 * k, 60.0)
    day, clock = ("31", f"23:{minute:02.0f}") if minute < 60 else ("01", f"00:{minute - 60:02.0f}")
    month = "01" if day == "31" else "02"
    return f"2024-{month}-{day}T{clock}:{second:06.3f}{suffix}"


@pytest.mark.parametrize("suffix", ["", "Z", "+02:00"])
def test_an_iso_8601_time_column_is_a_clock_whole_or_in_chunks(tmp_path: Path, suffix: str) -> None:
    rows = [f"{iso(k, suffix)},{row.split(',', 1)[1]}" for k, row in enumerate(ROWS)]
    path = written(tmp_path / "record.csv", [HEADER.replace("t_s", "timestamp"), *rows])
    plain = read_record(written(tmp_path / "plain.csv", [HEADER, *ROWS]), INPUTS, OUTPUTS)
    for parts in ([read_record(path, INPUTS, OUTPUTS)], list(read_chunks(path, INPUTS, OUTPUTS, rows=4))):
        # Microseconds are kept: 0.25 s is exact.
        assert {part.dt_s for part in parts} == {0.25}
        np.testing.assert_array_equal(np.concatenate([part.u for part in parts]), plain.u)


def test_a_broken_iso_8601_time_is_named_with_its_place(tmp_path: Path) -> None:
    rows = [f"{iso(k, 'Z')},{row.split(',', 1)[1]}" for k, row in enumerate(ROWS)]
    rows[3] = "2024-13-01T00:00:00Z,0,0,0"
    path = written(tmp_path / "record.csv", [HEADER.replace("t_s", "time"), *rows])
    with pytest.raises(LogFormatError, match=r":5: column 'time' holds '2024-13-01T00:00:00Z', not an ISO 8601 time"):
        read_record(path, INPUTS, OUTPUTS)
