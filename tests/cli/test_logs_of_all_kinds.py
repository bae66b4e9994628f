"""``identify`` on anybody's logs: each kind gives a model."""

from pathlib import Path

import numpy as np
import pytest
from bags import bag
from scipy.io import savemat

ROWS = 300


def columns() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7)
    u = rng.uniform(-0.1, 0.1, (ROWS, 2))
    y = np.zeros(ROWS)
    for k in range(ROWS - 1):
        y[k + 1] = 0.8 * y[k] + u[k] @ [0.3, -0.2]
    return {"t_s": 0.25 * np.arange(ROWS), "left": u[:, 0], "right": u[:, 1], "turn": y}


def write_csv(path: Path) -> None:
    table = columns()
    np.savetxt(path, np.column_stack(list(table.values())), "%.17g", ",", header=",".join(table), comments="")


def write_parquet(path: Path) -> None:
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is an extra")
    from pyarrow import parquet

    parquet.write_table(arrow.table(columns()), path)


def write_mcap(path: Path) -> None:
    table = columns()
    times = table.pop("t_s").tolist()
    bag(path, **{name: list(zip(times, values.tolist(), strict=True)) for name, values in table.items()})


WRITERS = {
    "log.csv": write_csv,
    "log.npz": lambda path: np.savez(path, **columns()),
    "log.mat": lambda path: savemat(path, columns()),
    "log.parquet": write_parquet,
    "log.mcap": write_mcap,
}


def names(path: Path) -> list[str]:
    field = ".data" if path.suffix == ".mcap" else ""
    return ["--inputs", f"left{field},right{field}", "--outputs", f"turn{field}"]


@pytest.mark.parametrize("name", WRITERS)
def test_identify_reads_every_kind(run, tmp_path: Path, name: str) -> None:
    path, out = tmp_path / name, tmp_path / "model.json"
    WRITERS[name](path)
    outcome = run("identify", path, *names(path), "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["order"] == 1
    assert out.exists()
