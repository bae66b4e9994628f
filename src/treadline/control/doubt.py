"""What a tuned design does on its own model, and what a user should know of it before the chair moves.

For models of a chair: belts in m/s, heading in rad. A design in, a line of text or nothing out.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.control.tune import BELT_DISTURBANCE_M_S
from treadline.models import ControllerDesign

FELT_RAD = 30.0 * DEG
"""The paper's largest heading at the start; a loop that answers it with less than a belt's own slip does not steer."""
ASKEW_RAD = 10.0 * DEG
"""From which a design must bring the chair back."""
HALVED_S = 5.0
"""Longest time to halve it: at 0.2 m/s a chair at 10° goes 0.035 m/s sideways, and one that halves its heading every 5 s 0.25 m
in all, about what a stair of 1.2 m leaves on either side of a gauge of 0.65 m."""
WATCHED_S = 20.0
"""For so long the model is run."""
RUN_AWAY_RAD = 1e6
"""Where a loop that grows is followed no further, before its numbers overflow."""
DIFFERENCE_ALONE = np.array([[0.5, -0.5], [-0.5, 0.5]])
"""What is left of two belt speeds without their mean."""


def doubt(design: ControllerDesign) -> str | None:
    """Say where a gain is too small to be felt, or does not bring a chair back that stands askew."""
    return _too_small(design) or _too_slow(design)


def askew(design: ControllerDesign) -> Float[np.ndarray, " T"]:
    """Return the heading [rad] of a design's model, one sample a period, from ``ASKEW_RAD`` on, no limit reached.

    The state begins as the controller's does, and the observer of an exact model then knows it. Only the difference of the belts
    acts: their mean is the plan's speed (``climb_safe``), whatever the gain asks of it.
    """
    model, steering = design.model, DIFFERENCE_ALONE @ design.K
    x = np.linalg.pinv(model.C) @ np.array([ASKEW_RAD, 0.0])
    heading = np.empty(2 + math.ceil(WATCHED_S / model.dt_s))
    for k in range(len(heading)):
        heading[k] = (model.C @ x - model.D @ steering @ x)[0]
        if abs(heading[k]) > RUN_AWAY_RAD:
            heading[k:] = heading[k]
            break
        x = model.A @ x - model.B @ steering @ x
    return heading


def _too_small(design: ControllerDesign) -> str | None:
    """Doubt a design with which it is best to do nothing: over so long a period, or at such a price."""
    answer_m_s = FELT_RAD * float(np.abs(design.K @ np.linalg.pinv(design.model.C)).max())
    if answer_m_s >= BELT_DISTURBANCE_M_S:
        return None
    return (
        f"a heading of {FELT_RAD / DEG:.0f}° is answered with {answer_m_s:.2g} m/s, less than slip does to a belt "
        f"({BELT_DISTURBANCE_M_S} m/s); give a control period shorter than {design.period_s:g} s, or a lower input weight"
    )


def _too_slow(design: ControllerDesign) -> str | None:
    """Doubt a design whose belts' difference does not halve the heading soon enough."""
    model = design.model
    if model.D.shape != DIFFERENCE_ALONE.shape:
        return None
    heading = askew(design)
    askew_still = np.flatnonzero(np.abs(heading) > 0.5 * ASKEW_RAD)
    # None, where the outputs do not show a heading at all.
    halved_s = float(askew_still[-1] + 1) * model.dt_s if askew_still.size else 0.0
    if halved_s <= HALVED_S:
        return None
    left, right = -design.K @ np.linalg.pinv(model.C) @ np.array([DEG, 0.0])
    takes = (
        f"takes {halved_s:.1f} s to halve"
        if askew_still[-1] + 1 < len(heading)
        else f"is at {heading[math.ceil(HALVED_S / model.dt_s)] / DEG:.3g}° after {HALVED_S:g} s"
    )
    return (
        f"from {ASKEW_RAD / DEG:.0f}° the model's heading {takes}; {HALVED_S:g} s to halve are the limit. For each degree the gain "
        f"asks {right - left:+.3f} m/s of the belts' difference, which alone steers (below 0 turns back), and "
        f"{0.5 * (left + right):+.3f} m/s of their mean, which the climb speed replaces; give --output-weight 1,0 in place of a "
        "weight on the model's own states, or a lower input weight"
    )
