"""Methods of linear models and of results of an identification: simulate, predict, analyse, convert, save, draw.

Each method is one call of a function of ``linear_systems`` or ``transfer_function``, which hold the mathematics.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from treadline.core.errors import ModelError, RecordError

if TYPE_CHECKING:
    from jaxtyping import Complex, Float
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from treadline.core.model_scores import Comparison
    from treadline.core.responses import FrequencyResponse, TimeResponse
    from treadline.core.state_space import InputOutputRecord, StateSpaceModel


class ModelMethods(ABC):
    """Methods that ``LinearModel`` and ``Identified`` share.

    Arrays have one row per sample and one column per channel; one-dimensional arrays are single channels. Where a method takes
    measured data, ``u`` and ``y`` are arrays or data frames, or ``u`` is a record and ``y`` is left out; a result of
    ``tl.identify`` uses the data that it was judged on when both are left out.
    """

    __slots__ = ()

    @abstractmethod
    def _linear(self) -> "StateSpaceModel":
        """Return the model."""

    def _own_record(self) -> "InputOutputRecord":
        """Return the data to use when none are given."""
        raise RecordError("a model holds no data; give inputs and outputs: (u, y)")

    def _record(self, u: Any, y: Any) -> "InputOutputRecord":
        from treadline.core.samples import record_of
        from treadline.core.state_space import InputOutputRecord

        if u is None and y is None:
            return self._own_record()
        model = self._linear()
        record = u if isinstance(u, InputOutputRecord) else record_of(u, y, model.dt_s)
        wanted, given = (model.B.shape[1], model.C.shape[0]), (record.u.shape[1], record.y.shape[1])
        if wanted != given:
            raise RecordError(
                f"the data have {given[0]} inputs and {given[1]} outputs, the model has {wanted[0]} and {wanted[1]}; "
                "give the same channels"
            )
        if abs(record.dt_s - model.dt_s) > 1e-6 * model.dt_s:
            raise RecordError(f"the data have a period of {record.dt_s:g} s, the model {model.dt_s:g} s; resample the data")
        return record

    def simulate(self, u: "ArrayLike", x0: "ArrayLike | None" = None) -> "Float[np.ndarray, 'T p']":
        """Return the outputs of a free run: the inputs alone, no measured output.

        Args:
            u: Inputs in the units of the record, one row per sample; offsets are subtracted here.
            x0: Initial state; zero, the state at rest, when left out. ``x0`` estimates one from measured data.

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
        from treadline.core.samples import samples_of

        model = self._linear()
        inputs = np.asarray(samples_of("u", u)[0], dtype=float)
        inputs = inputs[:, None] if inputs.ndim == 1 else inputs
        if inputs.ndim != 2 or inputs.shape[1] != model.B.shape[1]:
            raise RecordError(
                f"u is of shape {inputs.shape}; wanted one row per sample and {model.B.shape[1]} columns, one per input"
            )
        start = np.zeros(model.order) if x0 is None else np.asarray(x0, dtype=float)
        if start.shape != (model.order,):
            raise ModelError(f"x0 is of shape {start.shape}; wanted {model.order} states")
        return simulate(model, inputs, start)

    def x0(self, u: "ArrayLike | InputOutputRecord | None" = None, y: "ArrayLike | None" = None) -> "Float[np.ndarray, ' n']":
        """Return the initial state of measured data by least squares over the whole of them, for ``simulate``.

        A fit with this state is chosen with hindsight; ``compare`` starts from a short prefix instead.

        Args:
            u: Inputs; they must be complete.
            y: Outputs; samples with NaN are left out.

        Raises:
            RecordError: If channels or period differ from the model's.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.x0(np.zeros(3), [4.0, 2.0, 1.0]).round(6)
            array([4.])
        """
        from treadline.core.linear_systems import initial_state

        return initial_state(self._linear(), self._record(u, y))

    def predict(
        self, u: "ArrayLike | InputOutputRecord | None" = None, y: "ArrayLike | None" = None, *, horizon: int = 1
    ) -> "Float[np.ndarray, 'T p']":
        """Return the outputs predicted a number of samples ahead: row k knows the outputs up to k - horizon, and all inputs.

        The observer's start is estimated from the first tenth of the data, which these rows therefore know; ``compare`` scores
        the others.

        Args:
            u: Inputs.
            y: Outputs, from which the observer corrects the state; NaN are bridged. Without an ``observer_gain`` nothing is
                corrected, and the prediction is a free run.
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
        return predictions(self._linear(), self._record(u, y), horizon)

    def residuals(
        self, u: "ArrayLike | InputOutputRecord | None" = None, y: "ArrayLike | None" = None
    ) -> "Float[np.ndarray, 'T p']":
        """Return the errors of the prediction one step ahead, measured minus predicted; NaN where either is missing.

        Args:
            u: Inputs.
            y: Outputs.

        Raises:
            RecordError: If channels or period differ from the model's.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> float(abs(lag.residuals([1.0, 1.0, 1.0], [0.0, 1.0, 1.5])).max().round(9))
            0.0
        """
        from treadline.core.linear_systems import one_step_residuals

        return one_step_residuals(self._linear(), self._record(u, y))

    def compare(self, u: "ArrayLike | InputOutputRecord | None" = None, y: "ArrayLike | None" = None) -> "Comparison":
        """Return how well the model reproduces measured data: fit, tests of the residuals, ``plot()``.

        A free run starts from the state that the first tenth of the data determines, and is scored after it. For an unstable
        model a forecast of ten samples stands in its place. Both are stated in the result.

        Args:
            u: Inputs.
            y: Outputs.

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

        return compare(self._linear(), self._record(u, y))

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
        return self._time_response("step", steps)

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
        return self._time_response("impulse", steps)

    def _time_response(self, kind: str, steps: int | None) -> "TimeResponse":
        from treadline.core.linear_systems import impulse_response
        from treadline.core.responses import TimeResponse
        from treadline.core.state_space import channel_names
        from treadline.core.transfer_function import response_steps

        model = self._linear()
        y = impulse_response(model, response_steps(model) if steps is None else steps)
        inputs, outputs = channel_names(model)
        return TimeResponse(
            t_s=np.arange(len(y)) * model.dt_s,
            y=np.cumsum(y, axis=0) if kind == "step" else y,
            kind=kind,
            input_names=inputs,
            output_names=outputs,
        )

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
        from treadline.core.responses import FrequencyResponse
        from treadline.core.state_space import channel_names
        from treadline.core.transfer_function import frequency_grid, frequency_response

        model = self._linear()
        turns = 2.0 * np.pi * model.dt_s
        omega = frequency_grid(model, 1000) if frequency_hz is None else turns * np.asarray(frequency_hz, dtype=float)
        if omega.max(initial=0.0) > np.pi * (1.0 + 1e-9):
            raise ModelError(f"{omega.max() / turns:g} Hz lies above the Nyquist frequency of {0.5 / model.dt_s:g} Hz")
        inputs, outputs = channel_names(model)
        return FrequencyResponse(
            frequency_hz=omega / turns,
            response=frequency_response(model, omega),
            dt_s=model.dt_s,
            input_names=inputs,
            output_names=outputs,
        )

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

        return poles(self._linear())

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

        return zeros(self._linear())

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

        return static_gain(self._linear())

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

        return statespace(self._linear(), library)

    def save(self, path: "Path | str") -> None:
        """Write the model as JSON, for ``tl.load_model``; ``treadline identify --out model.mat`` writes a file for MATLAB.

        Raises:
            TreadlineError: If the file cannot be written.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> one, none = np.eye(1), np.zeros(1)
            >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
            >>> lag.save("lag.json")
        """
        from treadline.core.files import write_json

        write_json(Path(path), asdict(self._linear()))

    def plot(self) -> "Figure":
        """Return the matplotlib figure of the model: step response, magnitude and phase."""
        from treadline.core.responses import figure_of

        return figure_of("model", self._linear())
