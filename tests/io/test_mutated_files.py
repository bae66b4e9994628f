"""Mutated files: each reader answers with a result or a typed error of one line; no traceback, and no warning of Python or NumPy.

Mutations put hostile numbers, words and bytes in place of those of a sound file. ``make slow`` runs a thousand for each reader.
"""

import re
import shutil
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from frame_files import add_cloud, write_pcd
from mutations import lengthened, mutated_bytes

from treadline.campaign.spec import read_spec
from treadline.cli import main
from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import TreadlineError
from treadline.core.kernel_cache import compiling
from treadline.core.models import InputOutputRecord
from treadline.experiments.as_printed import paper_model
from treadline.io.records import write_record
from treadline.scenario.shipped_files import DATA

from ..conftest import Recording  # noqa: TID252 - pytest names the folders; outside of it they are no package
from ..report.conftest import reproduced, write_reproduction, write_run  # noqa: TID252 - the same

NUMBERS = (
    *("0", "-0.0", "-1", "7", "1e-5", "3.3e-43", "1e-320", "1e20", "1e308", "-1e308", "1e999", "2147483648"),
    *("18446744073709551616", "-9223372036854775809", "18446744073709551616"),
    *("Infinity", "-Infinity", "inf", "null", "true", '"x"', "[]", "{}"),
)
WORDS = ["", "x", "\0", "é", "1", "nan", "../x", "%s", "\ufffd"]
TOKEN = re.compile(rb'-?\d[\d.eE+-]*|"[^"\n]*"|\w+')
Mutate = Callable[[bytes, np.random.Generator], bytes]


def mutated_text(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a text with one to three numbers, words, lines or bytes changed."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        kind = rng.choice(["number", "word", "lines", "bytes", "long"], p=[0.6, 0.1, 0.1, 0.1, 0.1])
        tokens = [token for token in TOKEN.finditer(data) if kind == "word" or token.group()[:1] in b"-0123456789"]
        if kind == "lines":
            lines = data.split(b"\n")
            i, j = rng.integers(0, len(lines), 2).tolist()
            lines[i : i + 1] = [[], [lines[i], lines[j]], [lines[j]]][int(rng.integers(3))]
            data = b"\n".join(lines)
        elif kind == "long":
            data = lengthened(data, rng)
        elif kind == "bytes" or not tokens:
            data = mutated_bytes(data, rng)
        else:
            token, word = tokens[int(rng.integers(len(tokens)))], str(rng.choice(WORDS if kind == "word" else NUMBERS))
            data = data[: token.start()] + word.encode() + data[token.end() :]
    return data


def mutated_pixels(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a PNG with mutated depths: a mutated file fails its checksums."""
    depth = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    pixels = mutated_bytes(depth.tobytes(), rng).ljust(depth.nbytes, b"\0")[: depth.nbytes]
    return bytes(cv2.imencode(".png", np.frombuffer(pixels, np.uint16).reshape(depth.shape))[1])


class Reader(NamedTuple):
    make: Callable[[Path], Path]
    """Writes sound files into a folder; returns the one that is mutated."""
    read: Callable[[Path], object]
    mutate: Mutate = mutated_text
    share: int = 1
    """Divisor of the number of mutations in the short form: a report takes half a second."""


def verb(*words: str) -> Callable[[Path], object]:
    """Return a function that runs a command on a file: {} is the file, [] its folder."""

    def run(path: Path) -> int:
        return main([word.replace("{}", str(path)).replace("[]", str(path.parent)) for word in words])

    return run


def controller(folder: Path) -> Path:
    verb("tune", "{}", "--period", "0.25", "--out", "[]/controller.json")(model(folder))
    return folder / "controller.json"


def model(folder: Path) -> Path:
    paper_model(0.2).save(folder / "model.json")
    return folder / "model.json"


def copied(source: str, name: str, **others: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        for other, text in others.items():
            (folder / f"{other}.toml").write_text(text.replace("[]", str(folder)))
        return Path(shutil.copy(DATA / source, folder / name))

    return make


def log(folder: Path) -> Path:
    u = np.random.default_rng(3).normal(size=(60, 2))
    names = {"input_names": ("left_m_s", "right_m_s"), "output_names": ("heading_rad",)}
    write_record(
        folder / "log.csv", InputOutputRecord(u=u, y=0.05 * np.cumsum(u[:, :1] - u[:, 1:], axis=0), dt_s=0.25, **names), 0.5
    )
    return folder / "log.csv"


def depth_image(folder: Path) -> Path:
    depth = 1500 + 3 * np.indices((120, 160))[0] + 40 * (np.indices((120, 160))[0] // 20 % 2)
    cv2.imwrite(str(folder / "depth.png"), depth.astype(np.uint16))
    (folder / "camera.toml").write_text("width=160\nheight=120\nfx_px=140.0\nfy_px=140.0\ncx_px=79.5\ncy_px=59.5\n")
    return folder / "depth.png"


def wall_points() -> np.ndarray:
    """Return the points of a wall that leans, row by row."""
    v, u = np.indices((40, 50))
    z = 1.5 + 0.01 * v
    return np.stack([(u - 25) / 60 * z, (v - 20) / 60 * z, z], -1).reshape(-1, 3)


def cloud(name: str) -> Callable[[Path], Path]:
    """Return the maker of a point cloud: binary PCD, or a PLY file in text."""

    def make(folder: Path) -> Path:
        points = wall_points()
        if name.endswith(".pcd"):
            return write_pcd(folder / name, points, (50, 40))
        head = "ply\nformat ascii 1.0\nobj_info num_cols 50\nobj_info num_rows 40\nelement vertex 2000\n"
        head += "property float x\nproperty float y\nproperty float z\nend_header\n"
        rows = "\n".join(" ".join(f"{value:.4f}" for value in point) for point in points)
        (folder / name).write_text(f"{head}{rows}\n")
        return folder / name

    return make


def frames(name: str) -> Callable[[Path], Path]:
    """Return the maker of a recording with three depth images, or clouds."""

    def make(folder: Path) -> Path:
        recording = Recording(ros1=name.endswith(".bag"))
        camera = PinholeCamera(width_px=64, height_px=48, fx_px=56.0, fy_px=56.0, cx_px=31.5, cy_px=23.5)
        for t_s in (0.0, 0.1, 0.2):
            if name.startswith("clouds"):
                add_cloud(recording, "/points", t_s, wall_points(), (50, 40))
                continue
            recording.calibration("/depth/camera_info", t_s, camera)
            recording.image("/depth/image_raw", t_s, (1500 + 10 * np.indices((48, 64))[0]).astype(np.uint16), "16UC1")
        return recording.write(folder / name)

    return make


def run_folder(name: str) -> Callable[[Path], Path]:
    """Return the maker of a run's folder."""
    return lambda folder: write_run(folder / "run", duration_s=1.0) / name


def results(folder: Path) -> Path:
    return write_reproduction(folder / "reproduce", reproduced() | {"table2": reproduced()["table2"][:2]}) / "results.json"


CHANNELS = ("--inputs", "left_m_s,right_m_s", "--outputs", "heading_rad")
OPTIONS = ("--method", "okid-era", "--order", "2", "--lags", "4", "--no-page", "--force", "--out", "[]/model.json")
SEEN, REPORTED = verb("see", "{}"), verb("report", "[]")
READERS = {
    "model": Reader(model, verb("tune", "{}", "--force", "--out", "[]/made.json")),
    "controller": Reader(controller, verb("export", "{}", "--to", "json", "--force", "--out", "[]/made")),
    "scenario": Reader(copied("scenarios/up-28.toml", "scenario.toml"), verb("check", "{}")),
    "chair": Reader(
        copied("chairs/wheelchair.toml", "chair.toml", scenario='[chair]\nmodel = "[]/chair.toml"\n'),
        verb("check", "[]/scenario.toml"),
    ),
    "sweep": Reader(
        copied("scenarios/envelope.toml", "sweep.toml"), lambda path: (spec := read_spec(path)).at([0.5] * spec.dimension, "middle")
    ),
    # Formats of records differ in their readers, which ``test_damaged_logs`` runs alone; what is identified is the same for all.
    "log": Reader(log, verb("identify", "{}", *CHANNELS, *OPTIONS)),
    "camera": Reader(lambda folder: depth_image(folder).with_name("camera.toml"), verb("see", "[]/depth.png", "--camera", "{}")),
    "depth image": Reader(depth_image, verb("see", "{}", "--camera", "[]/camera.toml"), mutated_bytes),
    "depths": Reader(depth_image, verb("see", "{}", "--camera", "[]/camera.toml"), mutated_pixels),
    "pcd": Reader(cloud("cloud.pcd"), SEEN, mutated_bytes),
    "ply": Reader(cloud("cloud.ply"), SEEN),
    "frames of mcap": Reader(frames("frames.mcap"), SEEN, mutated_bytes),
    "frames of a bag": Reader(frames("frames.bag"), SEEN, mutated_bytes),
    "clouds of a bag": Reader(frames("clouds.bag"), SEEN, mutated_bytes),
    "run's log": Reader(run_folder("log.mcap"), REPORTED, mutated_bytes, 5),
    "run's result": Reader(run_folder("result.json"), REPORTED, share=5),
    "run's manifest": Reader(run_folder("manifest.json"), REPORTED, share=5),
    "run's series": Reader(run_folder("series.csv"), REPORTED, share=25),
    "results": Reader(results, REPORTED, share=10),
}


def own_time_s() -> float:
    """Return the CPU time of this process without that of compiling kernels [s]."""
    return time.process_time() - compiling().spent_s


def findings(reader: Reader, folder: Path, count: int) -> Iterator[str]:
    """Yield what is wrong with the reader's answers."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        path, began_s = reader.make(folder), own_time_s()
        reader.read(path)
    longest_s = 5.0 + 2 * (own_time_s() - began_s)
    """A mutated file may be as long to read as the sound one, and machines are noisy; what hangs takes minutes."""
    whole = path.read_bytes()
    for seed in range(count):
        path.write_bytes(reader.mutate(whole, np.random.default_rng(seed)))
        said, began_s = StringIO(), own_time_s()
        with redirect_stdout(StringIO()), redirect_stderr(said), warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                reader.read(path)
            except TreadlineError as error:
                said.write(f"treadline: {error}\n")
            except Exception as error:  # noqa: BLE001 - any of them is a finding
                yield f"{seed}: {type(error).__name__}: {error}"
        if (took_s := own_time_s() - began_s) > longest_s:
            yield f"{seed}: {took_s:.1f} s"
        yield from (f"{seed}: {warning.category.__name__}: {warning.message}" for warning in warned)
        if not re.fullmatch(r"((treadline|warning): [^\n]+\n)?", said.getvalue()):
            yield f"{seed}: {said.getvalue()}"


@pytest.mark.parametrize("count", [30, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_read_or_refused_in_one_line(name: str, count: int, tmp_path: Path) -> None:
    reader = READERS[name]
    assert list(findings(reader, tmp_path, count if count > 50 else count // reader.share)) == []
