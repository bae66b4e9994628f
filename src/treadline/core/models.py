"""Records and models: the interface between identification and control.

Identification reads an ``InputOutputRecord`` and returns a ``LinearModel``; tuning adds gains, and a mission runs the resulting
``ControllerDesign``. Models and designs are stored as JSON: no code, no pickle.
"""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from treadline.core.arrays import check_magnitude
from treadline.core.errors import ModelError, SettingsError, TreadlineError
from treadline.core.files import read_json, write_json
from treadline.core.model_methods import ModelMethods
from treadline.core.printing import Printable
from treadline.core.signals import TICK_S, on_the_tick
from treadline.core.state_space import InputOutputRecord, Provenance, StateSpaceModel, names_of, store_checked

__all__ = ["BAG_SUFFIXES", "LOG_SUFFIXES", "ControllerDesign", "InputOutputRecord", "LinearModel", "Reconstruct"]
Reconstruct = Literal["observer", "static"]
"""Method of state reconstruction: an observer, or the static inverse of one output (Eq. 11b)."""
EXPLAINED = "explained_percent"
"""Key of the provenance of an identified model: explained share of each output's variance [%]."""
BAG_SUFFIXES = (".mcap", ".bag", ".db3")
"""Suffixes of message logs."""
LOG_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".gz", ".npz", ".parquet", ".feather", *BAG_SUFFIXES)
"""Suffixes of logs, from which models are identified; a .mat file holds a log or a model."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class LinearModel(ModelMethods, StateSpaceModel, Printable):
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

    def _linear(self) -> "LinearModel":
        return self

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
        store_checked(self, "K", (self.model.B.shape[1], self.model.order))
        store_checked(self, "observer_gain", (self.model.order, self.model.C.shape[0]))
        if self.disturbance_gain is not None:
            store_checked(self, "disturbance_gain", (self.model.C.shape[0],))
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


def _reject_log(path: Path, wanted: str, command: str) -> None:
    """Reject a log, or a run folder, where a file that is made from one belongs."""
    if path.is_dir() or (path.suffix.lower() in LOG_SUFFIXES and path.exists()):
        kind = "folder" if path.is_dir() else "log"
        raise SettingsError(f"{path}: a {kind}, not {wanted}; make one first: {command}")


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
            if name == "input_delay":
                values[name] = tuple(value)
            if name in _NAMES:
                values[name] = names_of(name, value)
        return cls(**values)
    except (ArithmeticError, TypeError, ValueError) as error:
        raise SettingsError(f"{where}: not a {cls.__name__}: {error}") from None
    except TreadlineError as error:
        raise SettingsError(f"{where}: {error}") from None
