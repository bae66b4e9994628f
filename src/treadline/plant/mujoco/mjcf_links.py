"""Links of a robot description in MJCF, by MuJoCo's compiler, which resolves defaults, frames and included files."""

from pathlib import Path

import mujoco
import numpy as np

from treadline.core.errors import SettingsError, one_line
from treadline.vehicle.description_links import CollisionSolid, DescribedJoint, DescribedLink

ROUND = (int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE))
BOX = int(mujoco.mjtGeom.mjGEOM_BOX)


def mjcf_links(path: Path) -> tuple[str, list[DescribedLink]]:
    """Return name and links of a robot in MJCF.

    Raises:
        SettingsError: If MuJoCo does not compile it, or it is no single tree of bodies with one joint each.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise SettingsError(f"{path}: MuJoCo does not compile it: {one_line(error)}; correct it") from None
    roots = [model.body(i).name for i in range(1, model.nbody) if model.body_parentid[i] == 0]
    if len(roots) != 1:
        raise SettingsError(f"{path}: has {len(roots)} bodies in the world ({', '.join(roots)}); give the file of the robot alone")
    if model.neq:
        raise SettingsError(
            f"{path}: equality '{model.equality(0).name or 0}' closes a loop; remove it: a robot is a tree of links"
        )
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0  # joints at zero, not at a reference pose
    if model.body_dofnum[1] == 6:
        data.qpos[3] = 1.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return roots[0], [_link(path, model, data, i) for i in range(1, model.nbody)]


def _link(path: Path, model: mujoco.MjModel, data: mujoco.MjData, i: int) -> DescribedLink:
    """Return a body as a link."""
    first, count, name = model.body_jntadr[i], model.body_jntnum[i], model.body(i).name
    is_root = model.body_parentid[i] == 0
    if count > 1:
        raise SettingsError(f"{path}: body '{name}' has {count} joints; give each a body of its own")
    axes = data.ximat[i].reshape(3, 3)
    geoms = range(model.body_geomadr[i], model.body_geomadr[i] + model.body_geomnum[i]) if model.body_geomnum[i] else ()
    return DescribedLink(
        name=name,
        parent=None if is_root else model.body(model.body_parentid[i]).name,
        joint=None if is_root else _joint(model, data, first) if count else FIXED,
        origin_m=data.xanchor[first].copy() if count and not is_root else data.xpos[i].copy(),
        mass_kg=float(model.body_mass[i]),
        com_m=data.xipos[i].copy(),
        inertia=axes @ np.diag(model.body_inertia[i]) @ axes.T,
        solids=tuple(_solid(model, data, k) for k in geoms if _touches(model, k)),
    )


FIXED = DescribedJoint(name="", kind="fixed", axis=np.array([0.0, 1.0, 0.0]))


def _joint(model: mujoco.MjModel, data: mujoco.MjData, j: int) -> DescribedJoint:
    """Return a joint; its torque is that of its actuator."""
    is_hinge = model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
    on_joint = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (model.actuator_trnid[:, 0] == j)
    motors = np.flatnonzero(on_joint & (model.actuator_forcelimited > 0))
    torques = [model.actuator_forcerange[k][1] * abs(model.actuator_gear[k][0]) for k in motors]
    torques += [model.jnt_actfrcrange[j][1]] if model.jnt_actfrclimited[j] else []
    return DescribedJoint(
        name=model.joint(j).name,
        kind="hinge" if is_hinge else "other",
        axis=data.xaxis[j].copy(),
        range_rad=tuple(model.jnt_range[j].tolist()) if model.jnt_limited[j] else None,
        torque_n_m=float(min(torques)) if torques else None,
    )


def _touches(model: mujoco.MjModel, k: int) -> bool:
    """Whether a geom is a box or round, and not drawn alone."""
    return bool((model.geom_type[k] in (*ROUND, BOX)) and (model.geom_contype[k] or model.geom_conaffinity[k]))


def _solid(model: mujoco.MjModel, data: mujoco.MjData, k: int) -> CollisionSolid:
    """Return the solid of a geom."""
    is_round = model.geom_type[k] in ROUND
    size = model.geom_size[k]
    return CollisionSolid(
        name=model.geom(k).name,
        is_round=bool(is_round),
        centre_m=data.geom_xpos[k].copy(),
        R=data.geom_xmat[k].reshape(3, 3).copy(),
        half_m=np.array([size[0], size[0], size[1]]) if is_round else size.copy(),
    )
