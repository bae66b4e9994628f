"""Contact forces of one MuJoCo step by nonlinear Gauss-Seidel: Signorini's condition and Coulomb friction, slow and independent.

MuJoCo's own solver minimises a convex function whose contacts leave the surface when they slide. This solver keeps MuJoCo's
Jacobian, inertia, regularisation R and reference acceleration, and changes only the law of contact. With y = J a - aref + R f:

* normal: f_n >= 0, y_n >= 0, f_n y_n = 0;
* friction: |f_t / μ| <= f_n, and a contact that slides has f_t = -μ² y_t f_n / |μ y_t| (maximum dissipation on the ellipse);
* joint limits and frictionless contacts: as the normal rows; equality: y = 0; friction loss: |f| <= its bound, against y.

Method: Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999): one contact after the other until no force changes.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numba import njit

TOLERANCE_M_S2 = 1e-9
"""Largest violation of the contact law, in rows of 10 to 100 m/s²."""
SWEEPS = 400_000
"""Bound on the sweeps; a chair on a flight takes 400 to 800, a box at rest on four corners 12 000."""
BILATERAL, BOUNDED, UNILATERAL, CONTACT, TANGENT = 0, 1, 2, 3, 4
"""Kinds of rows; the two tangents of a contact follow its normal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSolution:
    """Accelerations and constraint forces of one step."""

    qacc: np.ndarray
    """Joint accelerations, as ``mjData.qacc``."""
    force: np.ndarray
    """Constraint forces in the order of ``mjData.efc_force``."""
    slack: np.ndarray
    """y = J a - aref + R f of every row."""
    normal: np.ndarray
    """Rows of the contacts' normals; their tangents are the two rows after each."""
    friction: np.ndarray
    """Friction coefficients of those contacts, two columns."""
    error_m_s2: float
    """Largest violation of the contact law, as an acceleration."""
    sweeps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """A step's constraint rows, tangents in units of their friction coefficients: the friction ellipse becomes a disk."""

    kind: np.ndarray
    friction: np.ndarray
    scale: np.ndarray
    """1, and the friction coefficient in a tangent's row: f = scale · p for forces p in the units of the disk."""
    J: np.ndarray
    response: np.ndarray
    """Joint accelerations for unit forces p."""
    W: np.ndarray
    """Slack for unit forces p, regularisation included."""
    bound: np.ndarray
    """Largest force of a row of friction loss."""


def solve_contacts(model: mujoco.MjModel, data: mujoco.MjData, tolerance_m_s2: float = TOLERANCE_M_S2) -> ContactSolution:
    """Return the Coulomb solution of a step whose stages up to ``mj_fwdAcceleration`` are done; ``data`` stay as they are.

    Raises:
        ValueError: If a constraint has a kind that the contact law does not know, or the sweeps do not converge.
    """
    rows = _problem(model, data)
    free = rows.scale * (rows.J @ data.qacc_smooth - data.efc_aref)
    p, y = np.zeros(data.nefc), free.copy()
    error, sweeps = _sweep(rows.W, free, rows.kind, rows.bound, p, y, tolerance_m_s2, SWEEPS) if data.nefc else (0.0, 0)
    if not error <= tolerance_m_s2:
        raise ValueError(f"Gauss-Seidel left {error:.1e} m/s² after {sweeps} sweeps; wanted {tolerance_m_s2:.0e}")
    force = rows.scale * p
    qacc = data.qacc_smooth + rows.response @ p
    return ContactSolution(
        qacc=qacc,
        force=force,
        slack=rows.J @ qacc - data.efc_aref + data.efc_R * force,
        normal=np.flatnonzero(rows.kind == CONTACT),
        friction=rows.friction,
        error_m_s2=float(error),
        sweeps=int(sweeps),
    )


def coulomb_error_m_s2(model: mujoco.MjModel, data: mujoco.MjData, qacc: np.ndarray, force: np.ndarray) -> float:
    """Return by how much any solver's accelerations and forces violate the contact law, as an acceleration.

    The measure is the change of force that one projected Gauss-Seidel step would make, times the row's inverse inertia. It needs
    ``efc_aref`` as the velocity stage left it.
    """
    rows = _problem(model, data)
    slack = rows.scale * (rows.J @ qacc - data.efc_aref + data.efc_R * force)
    return float(_violation(rows.W, rows.kind, rows.bound, force / rows.scale, slack))


def _problem(model: mujoco.MjModel, data: mujoco.MjData) -> _Problem:
    if mujoco.mj_isSparse(model):
        raise ValueError("the Gauss-Seidel oracle reads a dense Jacobian; set jacobian=dense")
    kind, friction = _kinds(data)
    J = data.efc_J.reshape(data.nefc, model.nv).copy()
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    normal, scale = np.flatnonzero(kind == CONTACT), np.ones(data.nefc)
    scale[normal + 1], scale[normal + 2] = friction[:, 0], friction[:, 1]
    Js = scale[:, None] * J
    response = np.linalg.solve(M, Js.T)
    W = Js @ response + np.diag(scale**2 * data.efc_R)
    bound = data.efc_frictionloss.copy()
    return _Problem(kind=kind, friction=friction, scale=scale, J=J, response=response, W=W, bound=bound)


def _kinds(data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return each row's kind, and the friction coefficients of each contact that has a normal row."""
    types = mujoco.mjtConstraint
    known = {
        types.mjCNSTR_EQUALITY: BILATERAL,
        types.mjCNSTR_FRICTION_DOF: BOUNDED,
        types.mjCNSTR_FRICTION_TENDON: BOUNDED,
        types.mjCNSTR_LIMIT_JOINT: UNILATERAL,
        types.mjCNSTR_LIMIT_TENDON: UNILATERAL,
        types.mjCNSTR_CONTACT_FRICTIONLESS: UNILATERAL,
        types.mjCNSTR_CONTACT_ELLIPTIC: TANGENT,
    }
    numbers = {int(name): kind for name, kind in known.items()}
    kind = np.array([numbers.get(int(number), -1) for number in data.efc_type[: data.nefc]], dtype=np.int64)
    if (kind < 0).any():
        raise ValueError("the Gauss-Seidel oracle knows no pyramidal friction cone; set cone=elliptic")
    friction = []
    for contact in sorted(range(data.ncon), key=lambda i: data.contact.efc_address[i]):
        row = int(data.contact.efc_address[contact])
        if row < 0 or kind[row] != TANGENT:
            continue
        if data.contact.dim[contact] != 3:
            raise ValueError(
                f"the Gauss-Seidel oracle knows contacts of dimension 3, not {data.contact.dim[contact]}; set condim=3"
            )
        kind[row] = CONTACT
        friction.append(data.contact.friction[contact, :2].copy())
    return kind, np.array(friction).reshape(-1, 2)


@njit(cache=True)
def _steepest(W, i) -> float:
    """Return the larger eigenvalue of the tangents' block behind normal row i."""
    a, b, c = W[i + 1, i + 1], W[i + 1, i + 2], W[i + 2, i + 2]
    return 0.5 * (a + c) + np.sqrt(0.25 * (a - c) ** 2 + b * b)


@njit(cache=True)
def _projected(W, kind, bound, p, y, i) -> float:
    """Return row i's force after one projected step, for a normal with its tangents as of now."""
    if kind[i] == BILATERAL:
        return p[i] - y[i] / W[i, i]
    if kind[i] == BOUNDED:
        return min(bound[i], max(-bound[i], p[i] - y[i] / W[i, i]))
    return max(0.0, p[i] - y[i] / W[i, i])


@njit(cache=True)
def _on_disk(W, p, y, i) -> tuple[float, float]:
    """Return the tangents' forces behind normal row i after one step along -y, projected on the friction disk."""
    steep = _steepest(W, i)
    u, v = p[i + 1] - y[i + 1] / steep, p[i + 2] - y[i + 2] / steep
    size = np.sqrt(u * u + v * v)
    if size > p[i]:
        u, v = u * p[i] / size, v * p[i] / size
    return u, v


@njit(cache=True)
def _violation(W, kind, bound, p, y) -> float:
    """Return the largest change of force that one projected step would make, as an acceleration."""
    worst = 0.0
    for i in range(len(p)):
        if kind[i] == TANGENT:
            continue
        worst = max(worst, abs(_projected(W, kind, bound, p, y, i) - p[i]) * W[i, i])
        if kind[i] == CONTACT:
            u, v = _on_disk(W, p, y, i)
            worst = max(worst, np.sqrt((u - p[i + 1]) ** 2 + (v - p[i + 2]) ** 2) * _steepest(W, i))
    return worst


@njit(cache=True)
def _sweep(W, free, kind, bound, p, y, tolerance, sweeps) -> tuple[float, int]:
    """Change forces ``p`` and slacks ``y`` row by row until the contact law holds; return what is left and the sweeps done."""
    rows = len(p)
    for sweep in range(sweeps):
        for i in range(rows):
            if kind[i] == TANGENT:
                continue
            change = _projected(W, kind, bound, p, y, i) - p[i]
            if change != 0.0:
                p[i] += change
                y += W[i] * change
            if kind[i] == CONTACT:
                u, v = _on_disk(W, p, y, i)
                du, dv = u - p[i + 1], v - p[i + 2]
                if du != 0.0 or dv != 0.0:
                    p[i + 1], p[i + 2] = u, v
                    y += W[i + 1] * du + W[i + 2] * dv
        if sweep % 20 == 19:
            y[:] = free + W @ p  # free of the sums' rounding
            error = _violation(W, kind, bound, p, y)
            if error <= tolerance:
                return error, sweep + 1
    return _violation(W, kind, bound, p, y), sweeps
