"""By how much accelerations and contact forces of one MuJoCo step violate momentum, Signorini's condition and Coulomb friction.

MuJoCo's own solver minimises a convex function whose contacts leave the surface when they slide. This measure keeps MuJoCo's
Jacobian J, inertia M, regularisation R and reference acceleration, and changes only the law of contact. With y = J a - aref + R f:

* normal: f_n >= 0, y_n >= 0, f_n y_n = 0;
* friction: |f_t / μ| <= f_n, and a contact that slides has f_t = -μ² y_t f_n / |μ y_t| (maximum dissipation on the ellipse);
* joint limits and frictionless contacts: as the normal rows; equality: y = 0; friction loss: |f| <= its bound, against y.

Accelerations and forces that obey these and M (a - a_free) = J' f are the solution of the step. Nothing of the plant is used.
"""

import mujoco
import numpy as np

TYPES = mujoco.mjtConstraint
EQUALITY = (TYPES.mjCNSTR_EQUALITY,)
BOUNDED = (TYPES.mjCNSTR_FRICTION_DOF, TYPES.mjCNSTR_FRICTION_TENDON)
ONE_SIDED = (TYPES.mjCNSTR_LIMIT_JOINT, TYPES.mjCNSTR_LIMIT_TENDON, TYPES.mjCNSTR_CONTACT_FRICTIONLESS)


def unbalanced(model: mujoco.MjModel, data: mujoco.MjData, qacc: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the accelerations less those that the forces give, a_free + M^-1 J' f, with a_free of the step without contact."""
    J = data.efc_J.reshape(data.nefc, model.nv)
    return qacc - data.qacc_smooth - np.linalg.solve(_inertia(model, data), J.T @ force)


def coulomb_error_m_s2(model: mujoco.MjModel, data: mujoco.MjData, qacc: np.ndarray, force: np.ndarray) -> float:
    """Return by how much accelerations and forces violate the contact law, as an acceleration.

    The measure is the change of force that one projected Gauss-Seidel step would make (Jean, Comput. Methods Appl. Mech. Engrg.
    177, 1999), times the row's inverse inertia. It needs ``efc_aref`` as the velocity stage left it.

    Raises:
        ValueError: If a constraint has a kind that the contact law does not know.
    """
    J, kind = data.efc_J.reshape(data.nefc, model.nv), data.efc_type[: data.nefc]
    W = J @ np.linalg.solve(_inertia(model, data), J.T) + np.diag(data.efc_R)
    slack = J @ qacc - data.efc_aref + data.efc_R * force
    worst = 0.0
    for row in range(data.nefc):
        stepped = force[row] - slack[row] / W[row, row]
        if kind[row] in BOUNDED:
            stepped = min(max(stepped, -data.efc_frictionloss[row]), data.efc_frictionloss[row])
        elif kind[row] in ONE_SIDED:
            stepped = max(stepped, 0.0)
        elif kind[row] not in EQUALITY:
            continue
        worst = max(worst, abs(stepped - force[row]) * W[row, row])
    for row, friction in _contacts(data, kind):
        worst = max(worst, abs(max(force[row] - slack[row] / W[row, row], 0.0) - force[row]) * W[row, row])
        # In units of the friction coefficients the ellipse is a disk, whose radius is the normal force.
        tangents = slice(row + 1, row + 3)
        steepest = np.linalg.eigvalsh(np.outer(friction, friction) * W[tangents, tangents])[-1]
        on_disk = force[tangents] / friction
        stepped = on_disk - friction * slack[tangents] / steepest
        stepped *= min(1.0, force[row] / max(np.linalg.norm(stepped), 1e-300))
        worst = max(worst, float(np.linalg.norm(stepped - on_disk)) * steepest)
    return worst


def _inertia(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M


def _contacts(data: mujoco.MjData, kind: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Return the normal row of each contact with friction, which two rows of tangents follow, and its two coefficients."""
    rows = [int(row) for row in data.contact.efc_address[: data.ncon]]
    found = [
        (row, data.contact.friction[i, :2])
        for i, row in enumerate(rows)
        if row >= 0 and kind[row] == TYPES.mjCNSTR_CONTACT_ELLIPTIC
    ]
    if 3 * len(found) != np.count_nonzero(kind == TYPES.mjCNSTR_CONTACT_ELLIPTIC) or TYPES.mjCNSTR_CONTACT_PYRAMIDAL in kind:
        raise ValueError("the contact law knows elliptic contacts of dimension 3; set cone=elliptic and condim=3")
    return found
