"""Warnings about a tuned design, from its closed loop on its own model.

For models of a chair with belts in m/s and heading in rad. Input: a design; output: one line of text or None.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.control.tune import BELT_DISTURBANCE_M_S
from treadline.core.angles import DEG
from treadline.core.models import ControllerDesign

LARGE_HEADING_RAD = 30.0 * DEG
"""Largest initial heading in the paper [rad]; a response smaller than belt slip does not steer."""
INITIAL_HEADING_RAD = 10.0 * DEG
"""Initial heading from which a design must return [rad]."""
HALVING_TIME_S = 5.0
"""Longest time to halve the heading [s]: at 0.2 m/s and 10° a chair drifts sideways at 0.035 m/s; halving every 5 s gives 0.25 m in
total, about the clearance on either side of a gauge of 0.65 m on a stair of 1.2 m."""
SIMULATED_S = 20.0
"""Duration of the simulation [s]."""
DIVERGED_RAD = 1e6
"""Heading at which a diverging simulation ends, before overflow [rad]."""
DIFFERENCE_ALONE = np.array([[0.5, -0.5], [-0.5, 0.5]])
"""Projection of two belt speeds on their difference."""


def design_warning(design: ControllerDesign) -> str | None:
    """Return a warning for a gain without effect or with too slow a response, else None."""
    return _negligible_response(design) or _slow_response(design)


def heading_response(design: ControllerDesign) -> Float[np.ndarray, " T"]:
    """Return the heading [rad] of the design's closed loop from ``INITIAL_HEADING_RAD``, one sample per period, without limits.

    The state starts as the controller's, and the observer of an exact model then equals the state. Only the difference of the belt
    speeds acts: their mean is the planned speed (``climb_safe``) for any gain.
    """
    model, steering = design.model, DIFFERENCE_ALONE @ design.K
    x = np.linalg.pinv(model.C) @ np.array([INITIAL_HEADING_RAD, 0.0])
    heading = np.empty(2 + math.ceil(SIMULATED_S / model.dt_s))
    for k in range(len(heading)):
        heading[k] = (model.C @ x - model.D @ steering @ x)[0]
        if abs(heading[k]) > DIVERGED_RAD:
            heading[k:] = heading[k]
            break
        x = model.A @ x - model.B @ steering @ x
    return heading


def _negligible_response(design: ControllerDesign) -> str | None:
    """Return a warning if the response is negligible, because of a long period or a high input weight."""
    response_m_s = LARGE_HEADING_RAD * float(np.abs(design.K @ np.linalg.pinv(design.model.C)).max())
    if response_m_s >= BELT_DISTURBANCE_M_S:
        return None
    return (
        f"a heading of {LARGE_HEADING_RAD / DEG:.0f}° is answered with {response_m_s:.2g} m/s, less than slip does to a belt "
        f"({BELT_DISTURBANCE_M_S} m/s); give a control period shorter than {design.period_s:g} s, or a lower input weight"
    )


def _slow_response(design: ControllerDesign) -> str | None:
    """Return a warning if the difference of the belt speeds does not halve the heading in time."""
    model = design.model
    if model.D.shape != DIFFERENCE_ALONE.shape:
        return None
    heading = heading_response(design)
    above_half = np.flatnonzero(np.abs(heading) > 0.5 * INITIAL_HEADING_RAD)
    # Zero if the outputs do not show a heading.
    halved_s = float(above_half[-1] + 1) * model.dt_s if above_half.size else 0.0
    if halved_s <= HALVING_TIME_S:
        return None
    left, right = -design.K @ np.linalg.pinv(model.C) @ np.array([DEG, 0.0])
    takes = (
        f"takes {halved_s:.1f} s to halve"
        if above_half[-1] + 1 < len(heading)
        else f"is at {heading[math.ceil(HALVING_TIME_S / model.dt_s)] / DEG:.3g}° after {HALVING_TIME_S:g} s"
    )
    return (
        f"from {INITIAL_HEADING_RAD / DEG:.0f}° the model's heading {takes}; {HALVING_TIME_S:g} s to halve are the limit. "
        f"For each degree the gain asks {right - left:+.3f} m/s of the belts' difference, which alone steers (below 0 turns "
        f"back), and {0.5 * (left + right):+.3f} m/s of their mean, which the climb speed replaces; give --output-weight 1,0 "
        "in place of a weight on the model's own states, or a lower input weight"
    )
