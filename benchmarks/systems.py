"""Systems and records of the identification benchmarks: simulated ones with known ground truth, and measured ones."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.signal import lfilter

from treadline.core import paper
from treadline.core.linear_systems import part
from treadline.core.models import InputOutputRecord, LinearModel

MODES_SEED = 2021
"""Draws the lightly damped system; never used for data."""
CHUNK = 1_000_000
"""Samples simulated at once: bounds the memory of the long records."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateSpace:
    """x⁺ = A x + B (u - input_offset), y - output_offset = C x + D (u - input_offset)."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m"]
    C: Float[np.ndarray, "p n"]
    D: Float[np.ndarray, "p m"]
    input_offset: Float[np.ndarray, " m"]
    output_offset: Float[np.ndarray, " p"]


Model = StateSpace | LinearModel
"""A model of the benchmark or of treadline: both have these matrices and offsets."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment:
    """A record with the truth behind it; the state starts at zero."""

    system: StateSpace
    record: InputOutputRecord
    noise_std: Float[np.ndarray, " p"]


def without_offsets(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"], C: Float[np.ndarray, "p n"], D: Float[np.ndarray, "p m"]
) -> StateSpace:
    """Return a system about the origin."""
    return StateSpace(A=A, B=B, C=C, D=D, input_offset=np.zeros(B.shape[1]), output_offset=np.zeros(C.shape[0]))


def equation_12() -> StateSpace:
    """Return Eq. (12) of the paper: two states, two inputs, two outputs, poles 0.71 and 0.50."""
    return without_offsets(paper.A, paper.B, paper.C, paper.D)


def light_damping(modes: int = 5, seed: int = MODES_SEED) -> StateSpace:
    """Return modes of 0.4 to 0.8 % damping, spread over 0.2 to 2.8 rad a sample, with random B, C, D (2 by 2)."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(0.2, 2.8, modes + 1)
    frequency = edges[:-1] + np.diff(edges) * rng.uniform(0.2, 0.8, modes)  # one in each band: never two alike
    damping = rng.uniform(0.004, 0.008, modes)
    turns = [
        np.exp(-z * w) * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]])
        for z, w in zip(damping, frequency, strict=True)
    ]
    A = block_diag(*turns)
    return without_offsets(A, rng.standard_normal((2 * modes, 2)), rng.standard_normal((2, 2 * modes)), rng.standard_normal((2, 2)))


def unstable() -> StateSpace:
    """Return an integrator and a pole at 1.02, coupled at both inputs and both outputs."""
    B, C = np.array([[1.0, 0.2], [0.3, 1.0]]), np.array([[0.5, 0.1], [-0.1, 0.4]])
    return without_offsets(np.diag([1.0, 1.02]), B, C, np.zeros((2, 2)))


def outputs(system: StateSpace, u: Float[np.ndarray, "T m"]) -> Float[np.ndarray, "T p"]:
    """Return the outputs from rest, mode by mode: the long records are made in compiled code."""
    poles, modes = np.linalg.eig(system.A)
    into, out = np.linalg.solve(modes, system.B.astype(modes.dtype)), system.C @ modes
    y, memory = np.empty((len(u), len(system.C))), np.zeros((len(poles), 1), dtype=modes.dtype)
    for start in range(0, len(u), CHUNK):
        now = slice(start, start + CHUNK)
        drive, states = u[now] @ into.T, np.empty((len(u[now]), len(poles)), dtype=modes.dtype)
        for k, pole in enumerate(poles):
            states[:, k], memory[k] = lfilter([0.0, 1.0], [1.0, -pole], drive[:, k], zi=memory[k])
        y[now] = (states @ out.T).real + u[now] @ system.D.T
    return y


def driven(system: StateSpace, samples: int, noise: float, seed: int) -> Experiment:
    """Return a run on white inputs of unit deviation; white output noise of a share of each output's deviation."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, system.B.shape[1]))
    y = outputs(system, u)
    noise_std = noise * y.std(axis=0)
    if noise:
        y += noise_std * rng.standard_normal(y.shape)
    return Experiment(system=system, record=InputOutputRecord(u=u, y=y, dt_s=paper.SAMPLING_TIME_S), noise_std=noise_std)


def in_closed_loop(system: StateSpace, samples: int, noise: float, seed: int) -> Experiment:
    """Return a run under u = dither - F y of the sample before: z² - a z + 1/4 is stable for both poles a.

    The measured output, noise included, is fed back. The delay keeps u_k free of the noise in y_k, so that D can be
    estimated at all. The noise's deviation is a share of the outputs' in the same loop without noise.
    """
    rng = np.random.default_rng(seed)
    F = 0.25 * np.linalg.inv(system.C @ system.B)
    dither, white = rng.standard_normal((samples, 2)), rng.standard_normal((samples, 2))
    noise_std = noise * _loop(system, F, dither, np.zeros_like(white))[1].std(axis=0)
    u, y = _loop(system, F, dither, noise_std * white)
    return Experiment(system=system, record=InputOutputRecord(u=u, y=y, dt_s=paper.SAMPLING_TIME_S), noise_std=noise_std)


def _loop(
    system: StateSpace, F: Float[np.ndarray, "m p"], dither: Float[np.ndarray, "T m"], noise: Float[np.ndarray, "T p"]
) -> tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T p"]]:
    x, u, y = np.zeros(len(system.A)), dither.copy(), noise.copy()
    for k in range(len(u)):
        if k:
            u[k] -= F @ y[k - 1]
        y[k] += system.C @ x + system.D @ u[k]
        x = system.A @ x + system.B @ u[k]
    return u, y


@dataclass(frozen=True, slots=True, kw_only=True)
class DataSet:
    """A measured set: its file and its columns."""

    name: str
    file: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    validation_file: str | None = None
    """Where a second run validates; otherwise the second half of the first does."""


DATA_SETS = (
    DataSet(name="CD arm", file="cd_arm.csv", inputs=("force_1", "force_2"), outputs=("track_1", "track_2")),
    DataSet(name="robot arm", file="robot_arm.csv", inputs=("torque",), outputs=("acceleration",)),
    DataSet(
        name="steam generator",
        file="steam_generator.csv",
        inputs=("fuel", "air", "level_reference", "disturbance"),
        outputs=("drum_pressure", "excess_oxygen", "level", "steam_flow"),
    ),
    DataSet(name="heating", file="heating.csv", inputs=("voltage",), outputs=("temperature",)),
    DataSet(
        name="cascaded tanks",
        file="cascaded_tanks_estimation.csv",
        validation_file="cascaded_tanks_validation.csv",
        inputs=("pump",),
        outputs=("level",),
    ),
    *(
        DataSet(name=f"Husky {run}", file=f"husky_{run}.csv", inputs=("left_m_s", "right_m_s"), outputs=("yaw_rate_rad_s",))
        for run in ("asphalt_00", "flooring_00", "asphalt_05")
    ),
    *(
        DataSet(
            name=name.replace("_", " "),
            file=f"{name}.csv",
            inputs=tuple(f"u{k}" for k in range(inputs)),
            outputs=tuple(f"y{k}" for k in range(outputs)),
        )
        for name, inputs, outputs in (
            ("evaporator", 3, 3),
            ("glass_furnace", 3, 6),
            ("flutter", 1, 1),
            ("flexible_structure", 2, 28),
        )
    ),
)


def halves(data: DataSet, folder: Path, *, turned: bool = False) -> tuple[InputOutputRecord, InputOutputRecord]:
    """Return the record to estimate from and the record to validate on; ``turned`` exchanges them."""
    whole = read(data, folder / data.file)
    if data.validation_file is not None:
        first, second = whole, read(data, folder / data.validation_file)
    else:
        first, second = part(whole, 0, len(whole) // 2), part(whole, len(whole) // 2, len(whole))
    return (second, first) if turned else (first, second)


def read(data: DataSet, path: Path) -> InputOutputRecord:
    """Return the record in a CSV file with a header and a column ``t_s``."""
    with path.open(newline="") as file:
        names = next(csv.reader(file))
    table = dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    u, y = (np.column_stack([table[name] for name in channels]) for channels in (data.inputs, data.outputs))
    period_s = float(np.median(np.diff(table["t_s"])))
    return InputOutputRecord(u=u, y=y, dt_s=period_s, input_names=data.inputs, output_names=data.outputs)
