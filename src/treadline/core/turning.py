"""What the names of a vehicle's channels say: belts, headings and yaw rates, and how a model has to turn with them.

``turn_faults`` tests a model, not the log that it came from: the fit of a log with exchanged sides, a wrong sign or a wrong unit is
as good as any other, and its controller spins the chair.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import ModelError
from treadline.core.state_space import StateSpaceModel

LEFT, RIGHT = "left", "right"
HEADING_PREFIXES = ("yaw", "heading")
"""Prefixes of the names of a heading or its rate."""
RATE_WORDS = ("_rate", "rad_s", "deg_s")
"""Parts of such a name that make it a rate."""
RATE_SUFFIXES_ROS = ("angular_velocity.z", "angular.z")
"""Suffixes of yaw rates in ROS messages."""
NAME_PRIOR = "name_prior"
"""Key of the provenance of an identified model: whether its channels' names say what they are."""
YAW_GAIN = "yaw_gain_ci95"
"""Key of the provenance of an identified model: bounds of the yaw rate per difference of the belt speeds [rad/m]."""

SLOW = np.pi * np.array([0.01, 0.02, 0.05])
"""Frequencies at which a model's turn is read [rad per sample]: above the drift of an estimated integrator, below most lags."""
INTEGRAL_TOLERANCE = 0.35
"""Relative difference of a heading and the integral of the yaw rate, of a log or of a model: gyros and compasses agree within some
per cent, and a wrong unit or sign is far beyond."""
SAME_WAY = 0.3
"""Ratio of the belts' yaw gains from which two of one sign are no noise: a belt that does nothing has a gain near zero. Half of it
and twice as much give the same verdicts (docs/evidence/identification.md)."""
GAUGES_M = (0.2, 10.0)
"""Effective gauges of vehicles [m]: from a toy's to twenty times what a stair is wide; slip makes a gauge larger, never smaller.
With 0.4 and 5 m two recorded drives that hardly turn are faults too, with 0.1 and 20 m no verdict changes
(docs/evidence/identification.md)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnChannels:
    """Outputs that describe a turn, identified by their names."""

    heading: int | None
    yaw_rate: int | None
    count: int
    """Number of turn outputs."""


def turn_channels(output_names: Sequence[str]) -> TurnChannels:
    """Return the first heading and the first yaw rate among the outputs."""
    roles = [_role(name.lower().rsplit("/", 1)[-1]) for name in output_names]
    first = {role: roles.index(role) if role in roles else None for role in ("heading", "rate")}
    return TurnChannels(heading=first["heading"], yaw_rate=first["rate"], count=sum(role is not None for role in roles))


def _role(name: str) -> str | None:
    if name.endswith(RATE_SUFFIXES_ROS):
        return "rate"
    if not name.startswith(HEADING_PREFIXES):
        return None
    return "rate" if any(word in name for word in RATE_WORDS) else "heading"


def radians(name: str) -> float:
    """Return the factor from a channel's unit to radians, by its name."""
    return DEG if "_deg" in name.lower() else 1.0


def belt_signs(inputs: Sequence[str]) -> Float[np.ndarray, " 2"] | None:
    """Return the signs of two belts in their difference, right minus left; None for other inputs.

    Belts are the only inputs, a left and a right one with otherwise the same name.
    """
    if len(inputs) != 2:
        return None
    one, other = (name.lower() for name in inputs)
    is_left = [LEFT in one and one.replace(LEFT, RIGHT) == other, LEFT in other and other.replace(LEFT, RIGHT) == one]
    return None if sum(is_left) != 1 else np.where(is_left, -1.0, 1.0)


def turn_faults(model: StateSpaceModel) -> list[str]:
    """Return what is wrong with the turn of a model from two belts to a heading, a yaw rate or both; nothing for other channels.

    Each fault is a sentence with its figure and the remedy. Tested are the sign and the size of the yaw rate per difference of the
    belt speeds, the belts' opposite effects, the heading against the integral of the yaw rate, and, where the provenance has one,
    whether the interval of the yaw gain excludes zero.
    """
    signs, turn = belt_signs(model.input_names), turn_channels(model.output_names)
    if signs is None or turn.count == 0:
        return []
    turns = np.exp(1j * SLOW)
    response = model.C @ np.linalg.solve(turns[:, None, None] * np.eye(model.order) - model.A, model.B[None]) + model.D
    rates = {}
    if turn.yaw_rate is not None:
        rates["rate"] = response[:, turn.yaw_rate] * radians(model.output_names[turn.yaw_rate])
    if turn.heading is not None:
        change = (turns[:, None] - 1.0) / model.dt_s * radians(model.output_names[turn.heading])
        rates["heading"] = response[:, turn.heading] * change
    gains = rates["rate" if "rate" in rates else "heading"].real.mean(axis=0)
    found = [*_belt_faults(gains, signs, model), *_interval_fault(model)]
    if len(rates) == 2 and (turned := rates["rate"] @ signs).all():
        ratio = float(((rates["heading"] @ signs) / turned).real.mean())
        found += integral_faults(model.output_names[turn.heading or 0], ratio, ratio)
    return found


def _belt_faults(gains: Float[np.ndarray, " 2"], signs: Float[np.ndarray, " 2"], model: StateSpaceModel) -> list[str]:
    """Return faults of the yaw rate per speed of each belt [rad/m]."""
    small, large = sorted(np.abs(gains))
    text = " and ".join(f"{gain:.3g} rad/s per m/s of '{name}'" for gain, name in zip(gains, model.input_names, strict=True))
    if gains[0] * gains[1] > 0.0 and small > SAME_WAY * large:
        return [f"both belts turn the vehicle the same way ({text}): is one belt's speed negated? change its sign"]
    gain = float(0.5 * gains @ signs)
    if gain <= 0.0:
        return [
            f"a faster right belt turns the vehicle to the right ({text}): are left and right exchanged, or angles counted "
            "clockwise? exchange the columns, or negate heading and yaw rate"
        ]
    if all("m_s" in name.lower() for name in model.input_names) and not GAUGES_M[0] < 1.0 / gain < GAUGES_M[1]:
        return [
            f"the effective gauge is {1.0 / gain:.3g} m, of vehicles it is {GAUGES_M[0]:g} to {GAUGES_M[1]:g} m: are belts in m/s "
            "and turns in rad/s? convert them"
        ]
    return []


def _interval_fault(model: StateSpaceModel) -> list[str]:
    given = model.provenance.get(YAW_GAIN)
    if not isinstance(given, Sequence) or len(given) != 2 or not given[0] <= 0.0 <= given[1]:
        return []
    return [
        f"the yaw rate per difference of the belt speeds may be zero (95 %: {given[0]:.3g} to {given[1]:.3g} rad/m): drive curves, "
        "with belts that differ"
    ]


def integral_faults(heading: str, low: float, high: float) -> list[str]:
    """Return what is wrong with a heading, by the bounds of its change per integral of the yaw rate; nothing where they allow 1.

    Args:
        heading: Name of the channel.
        low: Lower bound of the ratio, of a log by regression.
        high: Upper bound; of a model it is the same.
    """
    if low <= 1.0 + INTEGRAL_TOLERANCE and high >= 1.0 - INTEGRAL_TOLERANCE:
        return []
    size = 0.5 * abs(low + high)
    remedy = "check units, the period and the order of the rows"
    if min(abs(size * DEG - 1.0), abs(size / DEG - 1.0)) < INTEGRAL_TOLERANCE:
        remedy = "is one of them in degrees? convert it"
    elif high < 0.0:
        remedy = "one of them is counted clockwise: negate it"
    known = f"{low:.2g}" if low == high else f"{low:.2g} to {high:.2g}"
    return [f"integrator: '{heading}' changes by {known} of the yaw rate's integral, not by 1: {remedy}"]


def check_turns(model: StateSpaceModel) -> None:
    """Reject an identified model that turns the wrong way.

    A model that was not identified here, as Eq. (12), is taken as it is, and so is one whose names were to say nothing.

    Raises:
        ModelError: With each fault of ``turn_faults``.
    """
    if model.provenance.get(NAME_PRIOR) and (faults := turn_faults(model)):
        raise ModelError(f"the model does not turn as a vehicle does: {'; '.join(faults)}")
