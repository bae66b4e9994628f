"""Output-only identification: modes of a plant that noise alone drives, such as a frame in traffic or wind.

Stochastic subspace identification (Van Overschee and De Moor, Subspace Identification for Linear Systems, 1996, chapter 3), by
PBSID's regression without inputs: the outputs' past predicts their future, its leading directions are the states.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.printing import Printable
from treadline.identification._affine import to_model
from treadline.identification._checks import channel_names, check_alike, units_of_moving
from treadline.identification._gram import gram_of
from treadline.identification._model_order import bic_order
from treadline.identification._okid import regression
from treadline.identification._realisation import pbsid, state_map
from treadline.identification._threads import one_thread
from treadline.identification.options import DEFAULT_OPTIONS, IdentificationOptions, max_supported_lags
from treadline.identification.stabilisation import modes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class OutputModes(Printable):
    """Modes of a plant from its outputs alone, in ascending order of frequency.

    The noise that drives the plant is taken to be white. What colours it, such as an engine or the pace of a step, appears as a
    mode of its own; noise of the sensors as modes of large damping. There is no gain, as no input was measured, and no fit of a
    free run. The damping ζ of a light mode at f Hz in T seconds has a relative standard deviation of 1 / √(2π f ζ T) at best.
    """

    model: LinearModel
    """Innovation model without inputs: ``predict`` takes an array of no columns for ``u``."""
    frequency_hz: Float[np.ndarray, " k"]
    """Natural frequency of each pole, complex pairs once [Hz]."""
    damping: Float[np.ndarray, " k"]
    """Damping ratio: 1 for a decaying real pole."""
    lags: int
    samples: int

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return frequency and damping of each mode."""
        rows = [
            (f"{f:.4g} Hz", f"damping {100.0 * damping:.2g} %") for f, damping in zip(self.frequency_hz, self.damping, strict=True)
        ]
        return f"modes of order {self.model.order} with {self.lags} lags from {self.samples} samples of outputs alone", rows


@one_thread()
def output_modes(records: Sequence[InputOutputRecord], options: IdentificationOptions = DEFAULT_OPTIONS) -> OutputModes:
    """Return the modes of a plant from records without inputs.

    Args:
        records: Experiments with the same outputs and period.
        options: Order, by default at the smallest BIC, and lags, by default as many as the data support, up to 40. Others are of
            models with inputs.

    Raises:
        RecordError: If the data do not support the request.
        SettingsError: If another option is given.
    """
    others = [item.name for item in fields(options) if getattr(options, item.name) != getattr(DEFAULT_OPTIONS, item.name)]
    others = [name for name in others if name not in {"order", "lags"}]
    if others:
        raise SettingsError(f"{others[0]} is of models with inputs; outputs alone take order and lags")
    given = list(records)
    check_alike(given, outputs_alone=True)
    units = units_of_moving(given)
    lags = max_supported_lags(given, options.lags, options.largest_order)
    data = gram_of(given, lags, units)
    states = state_map(data, lags, regression(data, lags, feedthrough=False).theta)
    order = options.given_order or bic_order(data, states, lags, feedthrough=False, allowed=options.allowed_orders)
    system = pbsid(data, states, order, lags, feedthrough=False)
    frequency_hz, damping = modes(np.linalg.eigvals(system.A).astype(complex), data.dt_s)
    sort = np.argsort(frequency_hz)
    return OutputModes(
        model=to_model(system, units, data.dt_s, channel_names(given[0])),
        frequency_hz=frequency_hz[sort],
        damping=damping[sort],
        lags=lags,
        samples=round(data.count),
    )
