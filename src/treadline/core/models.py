"""Records and models: the interface between identification and control.

Identification reads an ``InputOutputRecord`` and returns a ``LinearModel``; tuning adds gains, and a mission runs the resulting
``ControllerDesign``. Models and designs are stored as JSON: no code, no pickle.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from jaxtyping import Complex, Float

from treadline.core.arrays import check_magnitude, shaped
from treadline.core.errors import ModelError, RecordError, SettingsError, TreadlineError
from treadline.core.files import read_json, write_json
from treadline.core.printing import Plottable, Printable
from treadline.core.signals import TICK_S, on_the_tick
from treadline.core.state_space import InputOutputRecord, Provenance, StateSpaceModel, measured, names_of, samples_of, store_checked

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from treadline.core.margins import LoopMargins
    from treadline.core.model_scores import Comparison
    from treadline.core.transfer_function import FrequencyResponse, TimeResponse

__all__ = ["BAG_SUFFIXES", "LOG_SUFFIXES", "ControllerDesign", "InputOutputRecord", "LinearModel", "Reconstruct"]
Reconstruct = Literal["observer", "static"]
"""Method of state reconstruction: an observer, or the static inverse of one output (Eq. 11b)."""
EXPLAINED = "explained_percent"
"""Key of the provenance of an identified model: explained share of each output's variance [%]."""
VEHICLE = "vehicle"
"""Key of the provenance of an identified model: name of the vehicle that drove, where the log says so."""
DEFAULT_VEHICLE = "wheelchair"
"""Vehicle where none is named."""
BAG_SUFFIXES = (".mcap", ".bag", ".db3")
"""Suffixes of message logs."""
LOG_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".gz", ".npz", ".parquet", ".feather", *BAG_SUFFIXES)
"""Suffixes of logs, from which models are identified; a .mat file holds a log or a model."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class LinearModel(StateSpaceModel, Printable, Plottable):
    """x[k+1] = A x[k] + B (u[k - d] - input_offset),  y[k] - output_offset = C x[k] + D (u[k - d] - input_offset).

    ``input_delay`` d is the dead time of each input in samples, apart from the states. ``observer_gain`` L corrects the state by
    L (y - ŷ) each period (predictor form). ``input_offset`` contains the climb speed; without an offset the law u = -Kx would
    stop the chair. The constructor checks the shapes: A (n n), B (n m), C (p n), D (p m).

    Arrays of its methods have one row per sample and one column per channel; one-dimensional arrays are single channels. Measured
    data are arrays or data frames ``u`` and ``y``, or a record in place of ``u``.

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

    @property
    def turn_per_belt_rad_m(self) -> float:
        """Yaw rate, the second output, a second after a step of the belt speed difference acts, per that difference [rad/m]."""
        step = np.array([-0.5, 0.5])
        x = np.zeros(self.order)
        for _ in range(max(round(1.0 / self.dt_s), 1)):
            x = self.A @ x + self.B @ step
        return float((self.C @ x + self.D @ step)[1])

    def poles(self) -> "Complex[np.ndarray, ' n']":
        """Return the poles: eigenvalues of A, slowest first; a method, as in python-control and MATLAB. Dead time adds none.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.poles()
            array([0.5+0.j])
        """
        from treadline.core.transfer_function import poles

        return poles(self)

    def zeros(self) -> "Complex[np.ndarray, ' k']":
        """Return the finite transmission zeros of the system with all inputs and outputs; seldom any if their numbers differ.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lead = tl.LinearModel(A=0.5 * one, B=one, C=one, D=one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lead.zeros()
            array([-0.5+0.j])
        """
        from treadline.core.transfer_function import zeros

        return zeros(self)

    def dcgain(self) -> "Float[np.ndarray, 'p m']":
        """Return the static gain: steady change of each output per unit of each input; ±infinity through an integrator.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.dcgain()
            array([[2.]])
        """
        from treadline.core.transfer_function import static_gain

        return static_gain(self)

    def simulate(self, u: "ArrayLike", x0: "ArrayLike | None" = None) -> "Float[np.ndarray, 'T p']":
        """Return the outputs of a free run: the inputs alone, no measured output.

        Args:
            u: Inputs in the units of the record, one row per sample; offsets are subtracted here.
            x0: Initial state; zero, the state at rest, when left out. ``linear_systems.initial_state`` estimates one from
                measured data.

        Raises:
            RecordError: If ``u`` has another number of columns than the model has inputs.
            ModelError: If ``x0`` has another length than the model has states.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.simulate([1.0, 1.0, 1.0])
            array([[0. ],
                   [1. ],
                   [1.5]])
        """
        from treadline.core.linear_systems import simulate
        from treadline.core.transfer_function import warn_of_growth

        inputs = np.asarray(samples_of("u", u)[0], dtype=float)
        inputs = inputs[:, None] if inputs.ndim == 1 else inputs
        m = self.B.shape[1]
        inputs = shaped("u", inputs, (None, m), f"one row per sample and {m} columns, one per input")
        start = np.zeros(self.order) if x0 is None else np.asarray(x0, dtype=float)
        if start.shape != (self.order,):
            raise ModelError(f"x0 is of shape {start.shape}; wanted {self.order} states")
        warn_of_growth(self, len(inputs))
        return simulate(self, inputs, start)

    def predict(
        self, u: "ArrayLike | InputOutputRecord", y: "ArrayLike | None" = None, *, horizon: int = 1
    ) -> "Float[np.ndarray, 'T p']":
        """Return the outputs predicted a number of samples ahead: row k knows the outputs up to k - horizon, and all inputs.

        The observer's start is estimated from the first tenth of the data, which these rows therefore know; ``compare`` scores
        the others.

        Args:
            u: Inputs, or a record.
            y: Outputs; None next to a record. The observer corrects the state from them; NaN are bridged. Without an
                ``observer_gain`` nothing is corrected, and the prediction is a free run.
            horizon: Samples ahead; 1 is one step ahead.

        Raises:
            RecordError: If channels or period differ from the model's, or the horizon is below 1.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> u = np.random.default_rng(0).normal(size=(200, 1))
            >>> y = 0.1 * np.vstack([[0.0], np.cumsum(u, axis=0)[:-1]])
            >>> found = tl.identify(u, y, 0.25, order=1, method="okid-era", lags=2)
            >>> bool(np.allclose(found.predict(u, y, horizon=5), y))
            True
        """
        from treadline.core.linear_systems import predictions

        if horizon < 1:
            raise RecordError(f"horizon is {horizon}; at least 1 sample")
        return predictions(self, measured(self, u, y), horizon)

    def compare(self, u: "ArrayLike | InputOutputRecord", y: "ArrayLike | None" = None) -> "Comparison":
        """Return how well the model reproduces measured data: fit, tests of the residuals, ``plot()``.

        A free run starts from the state that the first tenth of the data determines, and is scored after it. For an unstable
        model a forecast stands in its place, over as many samples as the model takes to grow twentyfold, ten at least, next to the
        fit of outputs that stay as they are. Both are stated in the result.

        Args:
            u: Inputs, or a record.
            y: Outputs; None next to a record.

        Raises:
            RecordError: If channels or period differ from the model's.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> u = np.random.default_rng(0).normal(size=(200, 1))
            >>> y = np.zeros((200, 1))
            >>> for k in range(199):
            ...     y[k + 1] = 0.5 * y[k] + u[k]
            >>> found = tl.identify(u[:100], y[:100], 0.1, order=1, method="okid-era", lags=2)
            >>> round(found.compare(u[100:], y[100:]).fit_percent["y1"], 3)
            100.0
        """
        from treadline.core.model_scores import compare

        return compare(self, measured(self, u, y))

    def step(self, steps: int | None = None) -> "TimeResponse":
        """Return the outputs after a step of one unit of each input: the cumulated impulse response.

        Args:
            steps: Number of samples; until the response has settled, at most 400, when left out.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.step(3).y.ravel()
            array([0. , 1. , 1.5])
        """
        from treadline.core.transfer_function import time_response

        return time_response(self, "step", steps)

    def impulse(self, steps: int | None = None) -> "TimeResponse":
        """Return the outputs after an impulse of one unit and one sample of each input: the Markov parameters D, CB, CAB, ….

        Args:
            steps: Number of samples; until the response has decayed, at most 400, when left out.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.impulse(3).y.ravel()
            array([0. , 1. , 0.5])
        """
        from treadline.core.transfer_function import time_response

        return time_response(self, "impulse", steps)

    def bode(self, frequency_hz: "Sequence[float] | Float[np.ndarray, ' w'] | None" = None) -> "FrequencyResponse":
        """Return the frequency response, with magnitude and phase; ``bode().plot()`` draws both.

        Args:
            frequency_hz: Frequencies [Hz], up to the Nyquist frequency; a logarithmic grid that is denser at the resonances when
                left out.

        Raises:
            ModelError: If a frequency lies above the Nyquist frequency.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.bode([5.0]).response.real.round(3)
            array([[[-0.667]]])
        """
        from treadline.core.transfer_function import bode

        return bode(self, frequency_hz)

    def to_statespace(self, library: str | None = None) -> Any:
        """Return A, B, C, D and the period as a state-space object of another library.

        Offsets are not part of such an object: its inputs and outputs are ``u - input_offset`` and ``y - output_offset``. Dead
        time becomes a chain of states.

        Args:
            library: ``control`` for ``control.StateSpace`` of python-control, ``scipy`` for ``scipy.signal.dlti``; python-control
                where it is installed, else SciPy, when left out.

        Raises:
            ModelError: If the library is neither, or python-control is not installed.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.to_statespace("scipy").dt
            0.1
        """
        from treadline.core.other_libraries import statespace

        return statespace(self, library)

    def to_continuous(self, library: str | None = None) -> Any:
        """Return A, B, C, D in continuous time as a state-space object of another library, for inputs held between samples.

        Args:
            library: As in ``to_statespace``.

        Raises:
            ModelError: As in ``to_statespace``; if an input has a dead time; or, as PeriodMismatch, if a real pole at or below
                zero has no continuous counterpart.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.to_continuous("scipy").A.round(3)
            array([[-6.931]])
        """
        from treadline.core.other_libraries import statespace

        return statespace(self, library, in_continuous_time=True)

    def resampled(self, period_s: float) -> "LinearModel":
        """Return the model at another period, with inputs held between samples, and dead time to the nearest period.

        The observer gain is left out: the noise between the samples is not known.

        Args:
            period_s: Sampling period [s].

        Raises:
            PeriodMismatch: If the model has no continuous counterpart (a real pole at or below zero).

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.resampled(0.2).A
            array([[0.25]])
        """
        from treadline.core.sampling import resampled

        return resampled(self, period_s)

    def transfer_function(self, output: int = 0, given: int = 0) -> Any:
        """Return ``scipy.signal.TransferFunction`` from one input to one output, with ``num`` and ``den`` in powers of z.

        Dead time becomes poles at zero. Offsets are not part of it.

        Args:
            output: Number of the output, from 0.
            given: Number of the input, from 0.

        Raises:
            ModelError: If there is no such output or input.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.transfer_function().den
            array([ 1. , -0.5])
        """
        from treadline.core.other_libraries import transfer_function

        return transfer_function(self.pair(output, given))

    def margins(self, output: int = 0, given: int = 0) -> "LoopMargins":
        """Return gain and phase margin of a loop that feeds one output back to one input, negatively.

        Args:
            output: Number of the output, from 0.
            given: Number of the input, from 0.

        Raises:
            ModelError: If there is no such output or input.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> round(lag.margins().gain, 3)
            1.5
        """
        from treadline.core.margins import margins

        return margins(self.pair(output, given))

    def save(self, path: Path | str) -> None:
        """Write the model as JSON, for ``tl.load_model``, or as a MAT file (version 5) for MATLAB if the path ends in ``.mat``.

        A MAT file holds the matrices under their usual names: A, B, C, D, dt, the observer gain K, the offsets u0 and y0, the
        dead time input_delay of each input in samples (MATLAB's InputDelay), and the names of inputs and outputs.

        Raises:
            TreadlineError: If the file cannot be written.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.save("lag.json")
        """
        if Path(path).suffix.lower() != ".mat":
            write_json(Path(path), asdict(self))
            return
        from treadline.core.other_libraries import write_mat

        write_mat(self, Path(path))

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
    vehicle: str = DEFAULT_VEHICLE
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
        from treadline.core.turning import check_turns

        if {"A", "B", "C", "D"} <= set(tables):
            raise SettingsError(f"{path}: a model, not a controller: treadline tune {path.name} makes one")
        if not isinstance(tables.get("model"), dict):
            raise SettingsError(f"{path}: not a controller: no 'model'; make one with treadline tune")
        model = _from_json(LinearModel, tables["model"], f"{path}: model")
        design: ControllerDesign = _from_json(cls, tables | {"model": model}, str(path))
        try:
            check_turns(model)
        except ModelError as error:
            raise SettingsError(f"{path}: {error}") from None
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
