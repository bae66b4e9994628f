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
SWEEPS = 400_000
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


def solve_contacts(model: mujoco.MjModel, data: mujoco.MjData, tolerance_m_s2: float = TOLERANCE_M_S2) -> ContactSolution:
    """Return the Coulomb solution of a step whose stages up to ``mj_fwdAcceleration`` are done; ``data`` stay as they are.

    Raises:
        ValueError: If a constraint has a kind that the contact law does not know, or the sweeps do not converge.
    """
    rows = data.nefc
    kind, friction = _kinds(data)
    J = (
        data.efc_J.reshape(rows, model.nv).copy()
        if not mujoco.mj_isSparse(model)
        else _refuse("a sparse Jacobian; set jacobian=dense")
    )
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    # Tangent rows in units of the friction coefficients: the ellipse becomes a disk, f = scale · p.
    scale = np.ones(rows)
    normal = np.flatnonzero(kind == CONTACT)
    scale[normal + 1], scale[normal + 2] = friction[:, 0], friction[:, 1]
    Js = scale[:, None] * J
    response = np.linalg.solve(M, Js.T)
    W = Js @ response + np.diag(scale**2 * data.efc_R)
    free = Js @ data.qacc_smooth - scale * data.efc_aref
    p = np.zeros(rows)
    y, error, sweeps = free.copy(), 0.0, 0
    if rows:
        error, sweeps = _sweep(W, free, kind, data.efc_frictionloss.copy(), p, y, tolerance_m_s2, SWEEPS)
    if not error <= tolerance_m_s2:
        raise ValueError(f"Gauss-Seidel left {error:.1e} m/s² after {sweeps} sweeps; wanted {tolerance_m_s2:.0e}")
    force = scale * p
    qacc = data.qacc_smooth + response @ p
    slack = J @ qacc - data.efc_aref + data.efc_R * force
    return ContactSolution(
        qacc=qacc, force=force, slack=slack, normal=normal, friction=friction, error_m_s2=float(error), sweeps=int(sweeps)
    )


def coulomb_violation_m_s2(model: mujoco.MjModel, data: mujoco.MjData, force: np.ndarray, qacc: np.ndarray) -> float:
    """Return by how much any solver's forces violate the contact law, as an acceleration.

    For each contact: the force-free distance from y_n to its complement, the part of μ y_t that no friction opposes, and the
    excess of the friction over the ellipse in units of the load, times the contact's inverse inertia.
    """
    kind, friction = _kinds(data)
    J = data.efc_J.reshape(data.nefc, model.nv)
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    scale = np.ones(data.nefc)
    normal = np.flatnonzero(kind == CONTACT)
    scale[normal + 1], scale[normal + 2] = friction[:, 0], friction[:, 1]
    Js = scale[:, None] * J
    W = Js @ np.linalg.solve(M, Js.T) + np.diag(scale**2 * data.efc_R)
    y = scale * (J @ qacc - data.efc_aref + data.efc_R * force)
    return float(_violation(W, kind, data.efc_frictionloss.copy(), force / scale, y))


def apply_contacts(model: mujoco.MjModel, data: mujoco.MjData, solution: ContactSolution) -> None:
    """Write a solution where ``mj_fwdConstraint`` writes its own, so that an integrator can follow."""
    data.qacc[:] = solution.qacc
    data.efc_force[:] = solution.force
    data.qfrc_constraint[:] = data.efc_J.reshape(data.nefc, model.nv).T @ solution.force if data.nefc else 0.0


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
        _refuse("a pyramidal friction cone; set cone=elliptic")
    friction = []
    for contact in sorted(range(data.ncon), key=lambda i: data.contact.efc_address[i]):
        row = int(data.contact.efc_address[contact])
        if row < 0 or kind[row] != TANGENT:
            continue
        if data.contact.dim[contact] != 3:
            _refuse(f"a contact of dimension {data.contact.dim[contact]}; set condim=3")
        kind[row] = CONTACT
        friction.append(data.contact.friction[contact, :2].copy())
    return kind, np.array(friction).reshape(-1, 2)


def _refuse(what: str) -> np.ndarray:
    raise ValueError(f"the Gauss-Seidel oracle does not solve {what}")


@njit(cache=True)
def _steepest(W, i):
    """Return the larger eigenvalue of the tangents' block behind normal row i."""
    a, b, c = W[i + 1, i + 1], W[i + 1, i + 2], W[i + 2, i + 2]
    return 0.5 * (a + c) + np.sqrt(0.25 * (a - c) ** 2 + b * b)


@njit(cache=True)
def _projected(W, kind, bound, p, y, i):
    """Return row i's force after one projected step, for a normal with its tangents as of now."""
    if kind[i] == BILATERAL:
        return p[i] - y[i] / W[i, i]
    if kind[i] == BOUNDED:
        return min(bound[i], max(-bound[i], p[i] - y[i] / W[i, i]))
    return max(0.0, p[i] - y[i] / W[i, i])


@njit(cache=True)
def _on_disk(W, p, y, i):
    """Return the tangents' forces behind normal row i after one step along -y, projected on the friction disk."""
    steep = _steepest(W, i)
    u, v = p[i + 1] - y[i + 1] / steep, p[i + 2] - y[i + 2] / steep
    size = np.sqrt(u * u + v * v)
    if size > p[i]:
        u, v = u * p[i] / size, v * p[i] / size
    return u, v


@njit(cache=True)
def _violation(W, kind, bound, p, y):
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
def _sweep(W, free, kind, bound, p, y, tolerance, sweeps):
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
