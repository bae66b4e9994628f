"""Records and models: the interface between identification and control.

Identification reads an ``InputOutputRecord`` and returns a ``LinearModel``; tuning adds gains, and a mission runs the resulting
``ControllerDesign``. Models and designs are stored as JSON: no code, no pickle.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from numbers import Real
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.arrays import check_magnitude, matrix, real, shaped
from treadline.core.errors import ModelError, NotFinite, RecordError, SettingsError, ShapeMismatch, TreadlineError
from treadline.core.model_methods import ModelMethods
from treadline.core.printing import Brief, Printable, plain
from treadline.core.settings import text_of
from treadline.core.signals import TICK_S, on_the_tick

Reconstruct = Literal["observer", "static"]
"""Method of state reconstruction: an observer, or the static inverse of one output (Eq. 11b)."""
Provenance = dict[str, Any]
"""Origin of a model: command, versions, seeds, fit. JSON values only."""
EXPLAINED = "explained_percent"
"""Key of the provenance of an identified model: explained share of each output's variance [%]."""

BAG_SUFFIXES = (".mcap", ".bag", ".db3")
"""Suffixes of message logs."""
LOG_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".gz", ".npz", ".parquet", ".feather", *BAG_SUFFIXES)
"""Suffixes of logs, from which models are identified; a .mat file holds a log or a model."""
RUN_VALUES = 10
"""Least output values per estimated initial state for a free-run score: the state estimate uses a tenth of them."""
TEST_VALUES = 100
"""Least output values per initial state for residual tests: state estimation from fewer values colours white residuals."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class InputOutputRecord(Brief):
    """Sampled inputs and outputs of an experiment; ``y[k]`` is measured before ``u[k]`` acts.

    One row per sample, one column per channel; a one-dimensional array is a single channel. Any array-like of real numbers is
    accepted.
    """

    u: Float[np.ndarray, "T m"]
    y: Float[np.ndarray, "T p"]
    dt_s: float
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("u", "y"):
            object.__setattr__(self, name, _columns(name, getattr(self, name)))
        for name in ("input_names", "output_names"):
            object.__setattr__(self, name, _names(name, getattr(self, name)))
        if self.u.shape[0] != self.y.shape[0]:
            raise ShapeMismatch(
                f"the record has {self.u.shape[0]} inputs but {self.y.shape[0]} outputs in time; cut both to one length"
            )
        _check_number("dt_s", self.dt_s)
        if not 0.0 < self.dt_s < math.inf:
            raise ModelError(f"the record's period is {self.dt_s} s; it must be positive and finite")

    def __len__(self) -> int:
        return int(self.u.shape[0])

    @property
    def whole(self) -> Bool[np.ndarray, " T"]:
        """Mask of the samples without a missing channel."""
        if np.isfinite(self.u).all() and np.isfinite(self.y).all():  # much faster than the row-wise test
            return np.ones(len(self), dtype=np.bool_)
        return np.asarray(np.isfinite(self.u).all(axis=1) & np.isfinite(self.y).all(axis=1))

    def stretches(self, values: int) -> list[slice]:
        """Return the segments used for model validation: the whole record, or the parts between missing inputs.

        The effect of an unknown input on the state is unknown and decays slowly in a slow model, so the state is estimated anew
        after each gap. Segments too short for an estimate are left out; if all are too short, the longest is returned.

        Args:
            values: Least number of output values per segment: ``RUN_VALUES`` or ``TEST_VALUES`` per state.
        """
        edges = np.flatnonzero(np.diff(np.isfinite(self.u).all(axis=1).astype(int), prepend=0, append=0))
        spans = [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
        if len(spans) <= 1:
            return spans
        held = [int(np.isfinite(self.y[span]).all(axis=1).sum()) * self.y.shape[1] for span in spans]
        long = [span for span, count in zip(spans, held, strict=True) if count >= values]
        return long or [spans[int(np.argmax(held))]]

    def delayed(self, shifts: Sequence[int]) -> "InputOutputRecord":
        """Return the record with each input as it acts after a dead time; missing where it was given before the record's start."""
        u = np.full(self.u.shape, np.nan)
        for j, shift in enumerate(shifts):
            u[shift:, j] = self.u[: max(len(self) - shift, 0), j]
        return replace(self, u=u)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class LinearModel(ModelMethods, Printable):
    """x[k+1] = A x[k] + B (u[k - d] - input_offset),  y[k] - output_offset = C x[k] + D (u[k - d] - input_offset).

    ``input_delay`` d is the dead time of each input in samples, apart from the states. ``observer_gain`` L corrects the state by
    L (y - ŷ) each period (predictor form). ``input_offset`` contains the climb speed; without an offset the law u = -Kx would
    stop the chair. The constructor checks the shapes: A (n n), B (n m), C (p n), D (p m).

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> one, none = np.eye(1), np.zeros(1)
        >>> tl.LinearModel(A=0.9 * one, B=one, C=one, D=0 * one, dt_s=0.25, input_offset=none, output_offset=none)
        linear model of order 1, period 0.25 s
          inputs   1
          outputs  1
          poles    0.9
    """

    A: Float[np.ndarray, "_ _"]
    B: Float[np.ndarray, "_ _"]
    C: Float[np.ndarray, "_ _"]
    D: Float[np.ndarray, "_ _"]
    dt_s: float
    input_offset: Float[np.ndarray, " _"]
    output_offset: Float[np.ndarray, " _"]
    observer_gain: Float[np.ndarray, "_ _"] | None = None
    input_delay: tuple[int, ...] = ()
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    provenance: Provenance = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("A", "B", "C", "D"):
            object.__setattr__(self, name, matrix(name, getattr(self, name)))
        for name in ("input_names", "output_names"):
            object.__setattr__(self, name, _names(name, getattr(self, name)))
        n, m, p = self.A.shape[0], self.B.shape[1], self.C.shape[0]
        object.__setattr__(self, "input_delay", _delays(self.input_delay, m))
        wanted = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "input_offset": (m,), "output_offset": (p,)}
        for name, shape in wanted.items():
            _settle(self, name, shape)
        if self.observer_gain is not None:
            _settle(self, "observer_gain", (n, p))
        if not self.dt_s > 0.0:
            raise ModelError(f"the model's period is {self.dt_s} s; it must be positive")

    def _linear(self) -> "LinearModel":
        return self

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    @property
    def turn_per_belt_rad_m(self) -> float:
        """Yaw rate, the second output, a second after a step of the belt speed difference acts, per that difference [rad/m]."""
        step = np.array([-0.5, 0.5])
        x = np.zeros(self.order)
        for _ in range(max(round(1.0 / self.dt_s), 1)):
            x = self.A @ x + self.B @ step
        return float((self.C @ x + self.D @ step)[1])

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return order, period, channels and poles."""
        poles = ", ".join(f"{pole:.4g}" for pole in np.linalg.eigvals(self.A))
        names = {"inputs": (self.input_names, self.B.shape[1]), "outputs": (self.output_names, self.C.shape[0])}
        rows = [(kind, ", ".join(given) or str(count)) for kind, (given, count) in names.items()]
        if any(self.input_delay):
            rows.append(("dead time", f"{', '.join(map(str, self.input_delay))} samples"))
        return f"linear model of order {self.order}, period {self.dt_s:g} s", [*rows, ("poles", poles)]

    @classmethod
    def load(cls, path: Path) -> "LinearModel":
        """Return the model in a JSON file.

        Raises:
            SettingsError: If the file is missing, not JSON, or not a model.
        """
        if path.suffix.lower() == ".mat":
            raise SettingsError(f"{path}: a model for MATLAB; give the JSON file: treadline identify --out model.json")
        _reject_log(path, "a model", f"treadline identify {path} --out model.json")
        tables = read_json(path)
        for key, kind in _NO_MODELS.items():
            if key in tables:
                raise SettingsError(f"{path}: not a model but {kind}; a model is what treadline identify writes")
        model: LinearModel = _from_json(cls, tables, str(path))
        return model


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ControllerDesign(Printable):
    """Feedback gain with model and observer: the file written by ``treadline tune`` and loaded by ``treadline climb``."""

    model: LinearModel
    K: Float[np.ndarray, "_ _"]
    observer_gain: Float[np.ndarray, "_ _"]
    period_s: float
    disturbance_gain: Float[np.ndarray, " _"] | None = None
    """Gain from innovation to the estimated constant input disturbance; None: no disturbance estimate."""
    reconstruct: Reconstruct = "observer"
    vehicle: str = "wheelchair"
    provenance: Provenance = field(default_factory=dict)

    def __post_init__(self) -> None:
        _settle(self, "K", (self.model.B.shape[1], self.model.order))
        _settle(self, "observer_gain", (self.model.order, self.model.C.shape[0]))
        if self.disturbance_gain is not None:
            _settle(self, "disturbance_gain", (self.model.C.shape[0],))
        if not isinstance(self.vehicle, str) or self.reconstruct not in get_args(Reconstruct):
            raise ModelError(f"the vehicle is {self.vehicle!r}, a name; reconstruct is {self.reconstruct!r}, observer or static")

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return vehicle, period, gain and state reconstruction."""
        gain = "; ".join(" ".join(f"{value:.4f}" for value in row) for row in self.K)
        rows = [("K", f"[{gain}]"), ("state", self.reconstruct), ("model", f"order {self.model.order}")]
        return f"controller of '{self.vehicle}', period {self.period_s:g} s", rows

    def save(self, path: Path | str) -> None:
        """Write the controller as JSON."""
        write_json(Path(path), asdict(self))

    @classmethod
    def load(cls, path: Path) -> "ControllerDesign":
        """Return the controller in a JSON file.

        Raises:
            SettingsError: If the file is missing, not JSON, not a controller, or has a period other than a multiple of the tick.
        """
        _reject_log(path, "a controller", f"treadline identify {path} --out model.json && treadline tune model.json")
        return cls.of_tables(read_json(path), path)

    @classmethod
    def of_tables(cls, tables: dict[str, Any], path: Path) -> "ControllerDesign":
        """Return the controller in the tables of a JSON file; errors name ``path``.

        Raises:
            SettingsError: As ``load``, for tables that are no controller.
        """
        if {"A", "B", "C", "D"} <= set(tables):
            raise SettingsError(f"{path}: a model, not a controller: treadline tune {path.name} makes one")
        if not isinstance(tables.get("model"), dict):
            raise SettingsError(f"{path}: not a controller: no 'model'; make one with treadline tune")
        model = _from_json(LinearModel, tables["model"], f"{path}: model")
        design: ControllerDesign = _from_json(cls, tables | {"model": model}, str(path))
        if not on_the_tick(design.period_s):
            raise SettingsError(
                f"{path}: period_s is {design.period_s}, no multiple of {TICK_S} s; tune it again with a --period that is one"
            )
        return design


def write_whole(path: Path, data: str | bytes) -> None:
    """Write a file atomically: a reader sees the old content or the new content, never a part."""
    with written_whole(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values as a JSON file, atomically: arrays as lists, non-finite numbers as null."""
    write_whole(path, json.dumps(plain(values), indent=1, allow_nan=False) + "\n")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path whose content atomically replaces the file on success and is discarded on error.

    Raises:
        TreadlineError: If the file cannot be written.
    """
    temporary = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise TreadlineError(f"{path}: cannot be written: {error.strerror or error}") from None


def _reject_log(path: Path, wanted: str, command: str) -> None:
    """Reject a log, or a run folder, where a file that is made from one belongs."""
    if path.is_dir() or (path.suffix.lower() in LOG_SUFFIXES and path.exists()):
        kind = "folder" if path.is_dir() else "log"
        raise SettingsError(f"{path}: a {kind}, not {wanted}; make one first: {command}")


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises:
        SettingsError: If the file is missing, a folder, not UTF-8, not JSON or not an object.
    """
    return json_of(text_of(path, "a JSON file"), str(path))


def json_of(text: str, path: str) -> dict[str, Any]:
    """Return the object in a JSON text; errors name ``path``.

    Raises:
        SettingsError: If the text is not JSON or not an object.
    """
    if not text.strip():
        raise SettingsError(f"{path}: empty; wanted JSON, as treadline writes it")
    try:
        value = json.loads(text, parse_constant=_finite, parse_float=_finite, parse_int=_whole)
    except json.JSONDecodeError as error:
        raise SettingsError(f"{path}:{error.lineno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: not JSON that can be read: {error}") from None
    if not isinstance(value, dict):
        raise SettingsError(f"{path}: holds a {type(value).__name__}, not an object")
    return value


def _finite(text: str) -> float:
    """Return the number of a JSON text; NaN and Infinity, which Python reads, are none, and 1e999 is too large."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text[:20]} is not finite")
    return number


def _whole(text: str) -> int:
    """Return the whole number of a JSON text, which must be small enough to become a float."""
    _finite(text)
    return int(text)


def _columns(name: str, given: object) -> Float[np.ndarray, "T c"]:
    """Return the samples of a record, one row each; a one-dimensional array becomes one column.

    The array has the one memory layout that kernels are compiled for; a column-major, read-only or single-precision array, as
    a data frame may hold it, is copied.
    """
    wanted = "one row per sample, one column per channel"
    array = real(name, given, wanted)
    array = shaped(name, array[:, None] if array.ndim == 1 else array, (None, None), wanted)
    return np.require(array, dtype=np.float64, requirements=("C", "W"))


def _names(name: str, given: Iterable[str]) -> tuple[str, ...]:
    names = () if isinstance(given, str) else tuple(given)
    if isinstance(given, str) or not all(isinstance(item, str) for item in names):
        raise RecordError(f"{name} is {given!r}; wanted a list of names, one per channel")
    return names


def _delays(given: Iterable[int], inputs: int) -> tuple[int, ...]:
    """Return the dead time of each input; zero for all where none is given."""
    delays = tuple(given) or (0,) * inputs
    whole = all(isinstance(delay, int | np.integer) and not isinstance(delay, bool) and delay >= 0 for delay in delays)
    if not whole or len(delays) != inputs:
        raise ModelError(f"input_delay is {list(delays)}; give one whole number of samples per input ({inputs}), from 0 up")
    return tuple(int(delay) for delay in delays)


def _check_number(name: str, given: object) -> None:
    if not isinstance(given, Real):
        raise ModelError(f"{name} is {given!r}, of type {type(given).__name__}; wanted a number")


def _settle(owner: object, name: str, shape: tuple[int, ...]) -> None:
    """Check an array of a model and store a read-only view."""
    array = real(name, getattr(owner, name), f"an array of shape {shape}")
    if array.shape != shape:
        raise ShapeMismatch(f"{name} is {array.shape}, the other matrices ask for {shape}; is it transposed?")
    if not np.isfinite(array).all():
        raise NotFinite(f"{name} holds NaN or Inf; identify the model again")
    array.setflags(write=False)
    object.__setattr__(owner, name, array)


_ARRAYS = {"A", "B", "C", "D", "input_offset", "output_offset", "observer_gain", "disturbance_gain", "K"}
_NAMES = {"input_names", "output_names"}


_NO_MODELS = {
    "K": "a controller, which climb --controller and export take",
    "verdict": "a run's result, which treadline report draws from its folder",
    "settings": "a run's manifest",
}
"""Keys by which other treadline files are recognised, with their descriptions."""


def _from_json(cls: type[Any], tables: dict[str, Any], where: str) -> Any:
    names = {item.name for item in fields(cls)}
    unknown = sorted(set(tables) - names)
    if unknown:
        raise SettingsError(f"{where}: unknown key '{unknown[0]}' in a {cls.__name__}")
    values = dict(tables)
    try:
        for name, value in tables.items():
            if name in _ARRAYS and value is not None:
                values[name] = np.array(value, dtype=float)
                check_magnitude(name, values[name], "identify the model again")
            if name in _NAMES:
                values[name] = _names(name, value)
        return cls(**values)
    except (ArithmeticError, TypeError, ValueError) as error:
        raise SettingsError(f"{where}: not a {cls.__name__}: {error}") from None
    except TreadlineError as error:
        raise SettingsError(f"{where}: {error}") from None
