"""Wild files: logs as spreadsheets, loggers, ROS tools and MATLAB write them are read, or refused in one line with the remedy."""

import gzip
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from treadline.core.errors import TreadlineError
from treadline.io.records import read_record

ROWS, PERIOD_S = 60, 0.05
NAMES = ("left", "right", "yaw")
START_NS = 1_706_742_000_000_000_000
"""31 January 2024, 23:00 UTC."""
_rng = np.random.default_rng(42)
VALUES = np.round(_rng.uniform(-1.0, 1.0, (ROWS, 3)), 3)
T = PERIOD_S * np.arange(ROWS)
NS = START_NS + 50_000_000 * np.arange(ROWS)


@dataclass(frozen=True)
class Wild:
    """A file, the call that a user makes on it, and words of the refusal if it must be refused."""

    name: str
    write: Callable[[Path], object]
    inputs: tuple[str, ...] = NAMES[:2]
    outputs: tuple[str, ...] = NAMES[2:]
    options: dict[str, Any] = field(default_factory=dict)
    refused: str = ""
    gaps: tuple[int, ...] = ()
    """Rows whose first input is missing."""
    flags: bool = False
    """Whether the first input is true or false."""


def cells(values: np.ndarray = VALUES, show: Callable[[float], str] = str) -> list[list[str]]:
    return [[show(value) for value in row] for row in values.tolist()]


def timed(times: Any, rows: list[list[str]] | None = None) -> list[list[str]]:
    return [[str(time), *row] for time, row in zip(times, rows or cells(), strict=True)]


def text(
    header: str | list[str],
    rows: list[list[str]],
    *,
    mark: str = ",",
    first: str = "",
    last: str = "",
    end: str = "\n",
    code: str = "utf-8",
) -> Callable[[Path], object]:
    """Return the writer of a delimited file; ``header`` holds whole lines."""
    lines = [*([header] if isinstance(header, str) else header), *(mark.join(row) for row in rows)]
    whole = first + end.join(lines) + end + last
    return lambda path: path.write_bytes(whole.encode(code))


def comma(value: float) -> str:
    return f"{value}".replace(".", ",")


def short(times: Any) -> list[str]:
    return [f"{time:.2f}" for time in times]


SECONDS = short(T)
PLAIN = timed(SECONDS)
SPLIT = [[str(ns // 10**9), str(ns % 10**9)] for ns in NS.tolist()]
ISO = [f"2024-01-31 23:00:{time:09.6f}" for time in T]
COMMAS = [[cell.replace(".", ",") for cell in row] for row in PLAIN]
GERMAN = timed([f"31.01.2024 23:00:{time:05.2f}" for time in T])
JITTER = T + 0.01 * (np.arange(ROWS) % 3)


def shaped(**arrays: Any) -> Callable[[Path], object]:
    return lambda path: np.savez(path, **arrays) if path.suffix == ".npz" else savemat(path, arrays)


def squeezed(path: Path) -> None:
    path.write_bytes(gzip.compress(("t,left,right,yaw\n" + "\n".join(map(",".join, PLAIN))).encode()))


def arrow_table(index: str) -> Any:
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is an extra")
    columns = dict(zip(NAMES, VALUES.T, strict=True))
    return arrow.table({**columns, index: arrow.array(NS, arrow.timestamp("ns"))})


def parquet(path: Path) -> None:
    table = arrow_table("__index_level_0__")
    from pyarrow import parquet as file

    file.write_table(table, path)


def feather(path: Path) -> None:
    table = arrow_table("when")
    from pyarrow import feather as file

    file.write_feather(table, path)


def hdf5(path: Path) -> None:
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(100))


U, Y = VALUES[:, :2], VALUES[:, 2:]
HEAD = "t,left,right,yaw"
PAIR = (("u[0]", "u[1]"), ("y",))
WIDE = [[*row, *[""] * 3000] for row in PLAIN]
GAPPY = [[row[0], word, *row[2:]] for row, word in zip(PLAIN[:5], ["NaN", "NA", "-", "", "nan"], strict=True)] + PLAIN[5:]
FLAGS = (np.arange(ROWS) % 7 < 3).tolist()
RATES = "sec,nanosec,left,right,yaw"
STRUCT = {"u": U, "y": Y, "Ts": PERIOD_S}
DUMP = {"InputData": U, "OutputData": Y, "Ts": PERIOD_S, "InputName": "left, right", "TimeUnit": "seconds"}
INPUTS = ("/cmd/left", "/cmd/right")

READ = [
    Wild(
        "rosbag.csv",
        text("header.stamp.sec,header.stamp.nanosec,left,right,yaw", [[*a, *b] for a, b in zip(SPLIT, cells(), strict=True)]),
    ),
    Wild("sec-nanosec.csv", text(RATES, [[*a, *b] for a, b in zip(SPLIT, cells(), strict=True)])),
    Wild("secs-nsecs.csv", text("secs,nsecs,left,right,yaw", [[*a, *b] for a, b in zip(SPLIT, cells(), strict=True)])),
    Wild("rostopic.csv", text("%time,field.left,field.right,field.yaw", timed(NS.tolist()))),
    Wild(
        "plotjuggler.csv",
        text("__time,/cmd/left,/cmd/right,/imu/yaw", timed(f"{ns / 1e9:.6f}" for ns in NS)),
        INPUTS,
        ("/imu/yaw",),
    ),
    Wild("leaves.csv", text("__time,/cmd/left,/cmd/right,/imu/yaw", timed(f"{ns / 1e9:.6f}" for ns in NS))),
    Wild("milliseconds.csv", text("time_ms,left,right,yaw", timed((50 * np.arange(ROWS)).tolist()))),
    Wild("brackets.csv", text("t [s],left [m/s],right [m/s],yaw [rad/s]", PLAIN), ("left [m/s]", "right [m/s]"), ("yaw [rad/s]",)),
    Wild("without-units.csv", text("Time (ms),Left [m/s],Right [m/s],Yaw [rad/s]", timed((50 * np.arange(ROWS)).tolist()))),
    Wild("epoch-us.csv", text("timestamp,left,right,yaw", timed((NS // 1000).tolist()))),
    Wild("epoch-ns.csv", text("timestamp,left,right,yaw", timed(NS.tolist()))),
    Wild("epoch-ms.csv", text("time,left,right,yaw", timed((NS // 10**6).tolist()))),
    Wild(
        "camel.csv",
        text("timestampNs,leftSpeed,rightSpeed,yawRate", timed(NS.tolist())),
        ("leftSpeed", "rightSpeed"),
        ("yaw_rate",),
    ),
    Wild("arduino.csv", text("millis,left,right,yaw", timed((50 * np.arange(ROWS)).tolist()))),
    Wild(
        "rosbag-to-csv.csv",
        text(
            "rosbagTimestamp,header,stamp,secs,nsecs,left,right,yaw",
            [["0", "", "", *a, *b] for a, b in zip(SPLIT, cells(), strict=True)],
        ),
    ),
    Wild(
        "german.csv",
        text("Zeit [s];Links [m/s];Rechts [m/s];Gierrate [rad/s]", COMMAS, mark=";"),
        ("Links", "Rechts"),
        ("Gierrate",),
    ),
    Wild(
        "units-as-written.csv",
        text("Time (s),Left (m/s),Right (m/s),Yaw Rate (rad/s)", PLAIN),
        ("left_m_s", "right_m_s"),
        ("yaw_rate_rad_s",),
    ),
    Wild("blanks-and-units.txt", text("t [s]  left [m/s]  right [m/s]  yaw [rad/s]", PLAIN, mark="  ")),
    Wild("elapsed-us.csv", text("elapsed_us,left,right,yaw", timed((50_000 * np.arange(ROWS)).tolist()))),
    Wild("iso.csv", text("Date/Time,left,right,yaw", timed(ISO))),
    Wild("pandas-index.csv", text(",left,right,yaw", timed(ISO))),
    Wild("time-of-day.csv", text("Time,left,right,yaw", timed(time[11:] for time in ISO))),
    Wild("slashes.csv", text("datetime,left,right,yaw", timed(time.replace("-", "/") for time in ISO))),
    Wild("decimal-commas.csv", text("t;left;right;yaw", COMMAS, mark=";")),
    Wild("decimal-commas.txt", text("t\tleft\tright\tyaw", COMMAS, mark="\t")),
    Wild(
        "excel.csv",
        text("t;left;right;yaw", [[f'"{c}"' for c in row] for row in COMMAS], mark=";", first="\ufeffsep=;\r\n", end="\r\n"),
    ),
    Wild("excel-wide.csv", text(HEAD + "," * 3000, WIDE, last=("," * 3003 + "\n") * 9)),
    Wild("excel-unicode.txt", text("t\tleft\tright\tyaw", COMMAS, mark="\t", end="\r\n", code="utf-16")),
    Wild("utf-16.csv", text(HEAD, PLAIN, code="utf-16-le")),
    Wild("tabs.txt", text("t\tleft\tright\tyaw", PLAIN, mark="\t")),
    Wild("spaces.txt", text("  t   left  right yaw", [[f"{cell:>9}" for cell in row] for row in PLAIN], mark=" ")),
    Wild("comma-blank.csv", text("t, left, right, yaw", PLAIN, mark=", ")),
    Wild("trailing-commas.csv", text(HEAD, [[*row, ""] for row in PLAIN])),
    Wild("comments.csv", text(["# robot 7", "# a, b, c, d", HEAD], [*PLAIN[:9], ["# lunch"], *PLAIN[9:]])),
    Wild("savetxt.csv", text("# t,left,right,yaw", PLAIN)),
    Wild("matlab.dat", text("% t left right yaw", [[f"{float(cell):.7e}" for cell in row] for row in PLAIN], mark="   ")),
    Wild("preamble.csv", text(["Logger 3000", "Recorded,31.1.2024", "", HEAD], PLAIN)),
    Wild("units-row.csv", text([HEAD, "s,m/s,m/s,rad/s"], PLAIN)),
    Wild("no-header.csv", text([], cells()), ("0", "1"), ("2",), {"period_s": PERIOD_S}),
    Wild("ascii.dat", text([], [[f"{float(cell):.7e}" for cell in row] for row in PLAIN], mark="   "), ("1", "2"), ("3",)),
    Wild("twice.csv", text(HEAD + ",note,note", [[*row, "a", "b"] for row in PLAIN])),
    Wild("blanks-in-names.csv", text("Time,left belt,right belt,yaw rate", PLAIN), ("left belt", "right belt"), ("yaw rate",)),
    Wild("fortran.txt", text("t left right yaw", [[f"{float(c):.6E}".replace("E", "D") for c in row] for row in PLAIN], mark=" ")),
    Wild("gaps.csv", text(HEAD, GAPPY), options={"allow_gaps": True}, gaps=(0, 1, 2, 3, 4)),
    Wild("flags.csv", text(HEAD, [[row[0], str(flag), *row[2:]] for row, flag in zip(PLAIN, FLAGS, strict=True)]), flags=True),
    Wild("squeezed.csv.gz", squeezed),
    Wild("matrices.npz", shaped(u=U, y=Y, dt=PERIOD_S), ("u",), ("y",)),
    Wild("vectors.npz", shaped(t=T[None, :], left=U[:, :1], right=U[:, 1], yaw=Y.T)),
    Wild("period.mat", shaped(u=U, y=Y, Ts=PERIOD_S), *PAIR),
    Wild("frequency.npz", shaped(u=U, y=Y, fs=1.0 / PERIOD_S), ("u",), ("y",)),
    Wild("times.npz", shaped(time=NS.astype("M8[ns]"), u=U, y=Y), ("u",), ("y",)),
    Wild("struct.mat", shaped(data=STRUCT), ("data.u",), ("data.y",)),
    Wild("iddata.mat", shaped(data=DUMP), ("InputData",), ("OutputData",)),
    Wild("frame.parquet", parquet),
    Wild("frame.feather", feather),
]
REFUSED = [
    Wild("jitter.csv", text(HEAD, timed(short(JITTER))), refused="--resample"),
    Wild("repeated.csv", text(HEAD, [*PLAIN, PLAIN[-1]]), refused=r":62: column 't' does not increase.*"),
    Wild("restarted.csv", text(HEAD, [*PLAIN, *PLAIN]), refused=":62: column 't' does not increase"),
    Wild("no-time.csv", text("left,right,yaw", cells()), refused="--period"),
    Wild("no-header.csv", text([], PLAIN), refused=r"no column 'left' \(there are: 0, 1, 2, 3\)"),
    Wild(
        "two-of-a-name.csv", text("t,left,left,right,yaw", [[*row[:2], *row[1:]] for row in PLAIN]), refused="'left' occurs twice"
    ),
    Wild(
        "two-leaves.csv",
        text("t,/a/left,/b/left,right,yaw", [[*row[:2], *row[1:]] for row in PLAIN]),
        refused="'/a/left'.*'/b/left'",
    ),
    Wild("misspelt.csv", text(HEAD, PLAIN), ("lefft", "right"), refused="did you mean 'left'"),
    Wild(
        "thousands.csv",
        text("t;left;right;yaw", [[row[0], "1,234.5", *row[2:]] for row in PLAIN], mark=";"),
        refused=":2: column 'left'",
    ),
    Wild("day-first.csv", text("time,left,right,yaw", GERMAN), refused="'31.01.2024 23:00:00.00'.*ISO 8601"),
    Wild("latin.csv", text("t,left °,right,yaw", PLAIN, code="latin-1"), refused="UTF-8"),
    Wild("newer.mat", hdf5, refused="7.3"),
    Wild("book.xlsx", lambda path: path.write_bytes(b"PK\x03\x04"), refused="CSV"),
    Wild("transposed.npz", shaped(t=T, left=U.T, right=U[:, 1], yaw=Y), refused="2 x 60.*transposed"),
]


def values_of(wild: Wild) -> np.ndarray:
    """Return what must be read."""
    values = VALUES.copy()
    values[list(wild.gaps), 0] = np.nan
    return np.column_stack([FLAGS, VALUES[:, 1:]]) if wild.flags else values


@pytest.mark.parametrize("wild", READ, ids=lambda wild: wild.name)
def test_a_wild_file_is_read_exactly(tmp_path: Path, wild: Wild) -> None:
    wild.write(tmp_path / wild.name)
    record = read_record(tmp_path / wild.name, wild.inputs, wild.outputs, **wild.options)
    np.testing.assert_array_equal(np.column_stack([record.u, record.y]), values_of(wild))
    assert record.dt_s == PERIOD_S
    assert (record.u.shape[1], record.y.shape[1]) == (2, 1)


@pytest.mark.parametrize("wild", REFUSED, ids=lambda wild: wild.name)
def test_a_file_that_cannot_be_read_is_refused_in_one_line_with_the_remedy(tmp_path: Path, wild: Wild) -> None:
    wild.write(tmp_path / wild.name)
    with pytest.raises(TreadlineError, match=wild.refused) as caught:
        read_record(tmp_path / wild.name, wild.inputs, wild.outputs, **wild.options)
    assert wild.name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_uneven_clock_is_resampled_where_that_is_asked(tmp_path: Path) -> None:
    text(HEAD, timed(short(JITTER)))(tmp_path / "log.csv")
    record = read_record(tmp_path / "log.csv", NAMES[:2], NAMES[2:], resample=True, period_s=PERIOD_S)
    assert len(record) == ROWS


@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9])
def test_the_period_decides_the_unit_of_a_clock_that_names_none(tmp_path: Path, unit: int) -> None:
    text("time,left,right,yaw", timed((unit * np.arange(ROWS) // 20).tolist() if unit > 1 else SECONDS))(tmp_path / "log.csv")
    assert read_record(tmp_path / "log.csv", NAMES[:2], NAMES[2:], period_s=PERIOD_S).dt_s == PERIOD_S


def test_a_given_period_stands_in_for_a_clock_that_cannot_be_read(tmp_path: Path) -> None:
    text("time,left,right,yaw", GERMAN)(tmp_path / "log.csv")
    assert read_record(tmp_path / "log.csv", NAMES[:2], NAMES[2:], period_s=0.1).dt_s == 0.1
