"""A vehicle's file from the belts of a robot description.

``DescribedBelts, answers -> TOML``. A value that the description lacks is asked for, or is a default; the file marks either.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError
from treadline.core.rotations import Vector3
from treadline.scenario.chair import ROUNDING
from treadline.vehicle.described_belts import SAME_M, DescribedBelts, Flippers
from treadline.vehicle.description_links import CollisionSolid, DescribedLink, summed
from treadline.vehicle.tracks import IN_LINE_M

Answer = Callable[[str, float, str], tuple[float, str]]
"""Function of a question, its default and the default's reason: the value, and where it comes from."""
Line = tuple[str, Any, str]
"""Key, value and comment of a line; a value of None is a heading."""
MARK = "not in the file: "
"""Words before the source of a value that the description lacks."""
LEFT_OUT = 1e-6
"""Distance [m] of a flipper's centre of mass from the line of its axes that is named: below it is rounding."""
SQUARE_DEG = 90.0
"""Largest angle of a flipper to either side."""


def vehicle_file(file: str, name: str, links: Sequence[DescribedLink], belts: DescribedBelts, answer: Answer) -> str:
    """Return the TOML of a vehicle.

    Args:
        file: Description, for comments and errors.
        name: Name of the vehicle.
        links: All links of the description.
        belts: Belts among them.
        answer: Source of the values that the description lacks.

    Raises:
        SettingsError: If the belts do not stand on two axes, a section is not where the model has it, or a mass is 0.
    """

    def marked(question: str, default: float, reason: str) -> tuple[float, str]:
        value, source = answer(question, default, reason)
        return value, f"{MARK}{source}"

    sized, asked = _with_sizes(belts, marked)
    rear, front, remark = _flat_run(file, sized)
    middle_m = 0.5 * (rear.centre_m + front.centre_m)
    origin_m = np.array([middle_m[0], _across(sized)[0], front.centre_m[2] - front.half_m[0]])
    mass_kg = sum(link.mass_kg for link in links)
    head = [f"# From {file}: {len(links)} links, {mass_kg:.6g} kg. x points ahead, z up, as ROS has it."]
    head += [f"# Joints held at zero: {', '.join(sized.held)}."] if sized.held else []
    lines: list[Line] = [("name", _slug(name), "")]
    lines += _masses(file, sized, origin_m)
    lines += _sections(file, sized, (rear, front), origin_m, remark, marked)
    lines += _drives(marked)
    lines += _camera(front.centre_m[0] - origin_m[0], marked)
    return "\n".join([*head, *(_written(key, value, comment or asked(key, value)) for key, value, comment in lines)]) + "\n"


def _written(key: str, value: Any, comment: str) -> str:
    text = f"\n{key}" if value is None else f"{key} = {_toml(value)}"
    return text if not comment else f"{text}  # {comment}"


def _toml(value: Any) -> str:
    """Return a value as TOML; twelve digits, so that a description's own come back."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (list, tuple, np.ndarray)):
        return f"[{', '.join(_toml(item) for item in value)}]"
    text = f"{float(value) + 0.0:.12g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _slug(name: str) -> str:
    """Return a name of small letters, digits and underscores, without the words of a side."""
    words = re.sub(r"[^a-z0-9]+", "_", re.sub(r"left|right|^[lr]_", "", name.lower())).strip("_")
    return words if words[:1].isalpha() else f"robot_{words}".rstrip("_")


def _with_sizes(belts: DescribedBelts, answer: Answer) -> tuple[DescribedBelts, Callable[[str, Any], str]]:
    """Return belts whose pulleys all have a radius and a width, and the comment of a line with one that was asked."""
    known = [pulley.half_m for pulley in (*belts.pulleys, *(one for pair in belts.flippers for one in pair.pulleys))]
    if not np.isnan(known).any():
        return belts, lambda _key, _value: ""
    radius_m, of_radius = answer("radius of the pulleys with their belt [m]", 0.1, "a usual one")
    width_m, of_width = answer("width of a belt [m]", 0.08, "a usual one")
    asked = np.array([radius_m, radius_m, 0.5 * width_m])

    def whole(pulleys: Sequence[CollisionSolid]) -> list[CollisionSolid]:
        return [replace(pulley, half_m=np.where(np.isnan(pulley.half_m), asked, pulley.half_m)) for pulley in pulleys]

    def comment(key: str, value: Any) -> str:
        if key == "radii_m" and radius_m in value:
            return of_radius
        return of_width if key == "width_m" and value == width_m else ""

    pairs = [replace(pair, pulleys=whole(pair.pulleys)) for pair in belts.flippers]
    return replace(belts, pulleys=whole(belts.pulleys), flippers=pairs), comment


def _flat_run(file: str, belts: DescribedBelts) -> tuple[CollisionSolid, CollisionSolid, str]:
    """Return rear and front pulley of the flat run, and a remark: what stands lowest, or the axes of the flippers."""
    low_m = min((pulley.centre_m[2] - pulley.half_m[0] for pulley in belts.pulleys), default=0.0)
    bearing = [pulley for pulley in belts.pulleys if pulley.centre_m[2] - pulley.half_m[0] < low_m + IN_LINE_M]
    remark = ""
    if not bearing:
        remark = f"{MARK}the flippers have no belt between their axes; one is assumed"
        bearing = [_first_pulley(pair, pair.pulleys) for pair in belts.flippers]
    rear, front = (choose(bearing, key=lambda pulley: float(pulley.centre_m[0])) for choose in (min, max))
    if front.centre_m[0] - rear.centre_m[0] < SAME_M:
        raise SettingsError(f"{file}: its belts stand on one axis, that of '{front.name}'; name all belts with --belts 'REGEX'")
    nose = max(belts.pulleys, key=lambda pulley: float(pulley.centre_m[0]), default=front)
    above = [pulley.name or "unnamed" for pulley in belts.pulleys if pulley is not nose and pulley not in bearing]
    parts = [f"pulleys above the flat run: {', '.join(dict.fromkeys(above))}"] if above else []
    if abs(front.half_m[0] - rear.half_m[0]) > SAME_M:
        parts.append(f"its rear pulley has {rear.half_m[0]:.4g} m")
    return rear, front, remark or _dropped(parts)


def _first_pulley(pair: Flippers, pulleys: Sequence[CollisionSolid]) -> CollisionSolid:
    """Return the pulley on the axis of a pair, or one as large as its last there."""
    on_axis = [pulley for pulley in pulleys if math.dist(pulley.centre_m[::2], pair.axis_m[::2]) < SAME_M]
    if on_axis:
        return max(on_axis, key=lambda pulley: float(pulley.half_m[0]))
    x, _, z = pair.axis_m
    return replace(pair.tip, centre_m=np.array([x, pair.tip.centre_m[1], z]))


def _across(belts: DescribedBelts) -> tuple[float, float, float]:
    """Return middle, gauge and width of the belts of the chassis, or of the flippers where it has none [m]."""
    pulleys = belts.pulleys or [pulley for pair in belts.flippers for pulley in pair.pulleys]
    return _lanes(pulleys)


def _lanes(pulleys: Sequence[CollisionSolid]) -> tuple[float, float, float]:
    """Return middle, gauge and width of belts [m]."""
    places = [float(pulley.centre_m[1]) for pulley in pulleys]
    left_m, right_m = max(places), min(places)
    return 0.5 * (left_m + right_m), left_m - right_m, 2.0 * max(float(pulley.half_m[2]) for pulley in pulleys)


def _masses(file: str, belts: DescribedBelts, origin_m: Vector3) -> Iterator[Line]:
    mass_kg, com_m, J = summed(belts.chassis)
    if mass_kg <= 0.0:
        raise SettingsError(f"{file}: link '{belts.chassis[0].name}' has a mass of 0; give its <inertial> the mass of the chassis")
    yield "[masses]", None, ""
    yield "chassis_kg", mass_kg, ""
    yield "chassis_com_m", com_m - origin_m, ""
    yield "inertia_kg_m2", [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]], ""
    low, high, remark = _hull(belts, com_m, mass_kg, J, float(origin_m[2]))
    yield "hull_m", 0.5 * (low + high) - origin_m, remark
    yield "chassis_size_m", high - low, remark


def _hull(
    belts: DescribedBelts, com_m: Vector3, mass_kg: float, inertia: Float[np.ndarray, "3 3"], floor_m: float
) -> tuple[Vector3, Vector3, str]:
    """Return lowest and highest corner of the shapes between the belts, or of the box with the inertia of the chassis."""
    middle_m, gauge_m, width_m = _across(belts)
    inner_m = 0.5 * (gauge_m - width_m)
    moved = {link.name for link in belts.chassis if link.joint is not None and link.joint.kind != "fixed"}
    solids = [solid for link in belts.chassis if link.name not in moved and link.parent not in moved for solid in link.solids]
    boxes = [(solid.centre_m - solid.extent_m, solid.centre_m + solid.extent_m) for solid in solids]
    between = [(low, high) for low, high in boxes if low[1] < middle_m + inner_m - SAME_M and high[1] > middle_m - inner_m + SAME_M]
    if between:
        low_m, high_m = (choose([box[end] for box in between], axis=0) for end, choose in ((0, np.min), (1, np.max)))
        return low_m, high_m, ""
    moments = np.diag(inertia)
    half_m = 0.5 * np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / mass_kg, SAME_M**2))
    half_m[2] = min(half_m[2], 0.5 * (com_m[2] - floor_m))
    return com_m - half_m, com_m + half_m, f"{MARK}the uniform box with its inertia, no deeper than halfway to the floor"


def _sections(
    file: str, belts: DescribedBelts, flat: tuple[CollisionSolid, CollisionSolid], origin_m: Vector3, remark: str, answer: Answer
) -> Iterator[Line]:
    """Yield the sections: the flat run, the front one, and all further pairs of flippers."""
    (rear, front), (_, gauge_m, width_m) = flat, _across(belts)
    half_m, radius_m = 0.5 * (front.centre_m[0] - rear.centre_m[0]), float(front.half_m[0])
    yield from _section("main", [-half_m, radius_m], [half_m, radius_m], [radius_m, radius_m], remark)
    yield "gauge_m", gauge_m, ""
    yield "width_m", width_m, ""
    ahead = [pair for pair in belts.flippers if pair.raises < 0.0]
    misplaced = next((pair for pair in ahead if math.dist(pair.axis_m[::2], front.centre_m[::2]) > SAME_M), None)
    if misplaced is not None:
        behind_m, name = front.centre_m[0] - misplaced.axis_m[0], misplaced.links[0].name
        raise SettingsError(
            f"{file}: link '{name}' turns {behind_m:.3f} m behind the front pulley; a front flipper turns about that pulley: "
            "move its joint there, or name the belts with --belts 'REGEX'"
        )
    if ahead:
        yield from _front_flipper(ahead[0], (half_m, radius_m), _across(belts), answer)
    else:
        yield from _fixed_front(belts, front, (half_m, radius_m), origin_m)
    for number, pair in enumerate(pair for pair in belts.flippers if pair.raises > 0.0):
        start, end = pair.axis_m - origin_m, pair.tip.centre_m - origin_m
        radii = [float(_first_pulley(pair, [*pair.pulleys, *belts.pulleys]).half_m[0]), float(pair.tip.half_m[0])]
        yield from _section(_slug(pair.links[0].name) or f"rear_{number}", start[::2], end[::2], radii, "")
        middle_m, gauge_m, width_m = _lanes(pair.pulleys)
        beside_m = middle_m - float(origin_m[1])
        yield "gauge_m", gauge_m, _dropped([f"its middle is {beside_m:.4f} m left of the belts'"] if abs(beside_m) > SAME_M else [])
        yield "width_m", width_m, ""
        length_m = math.dist(start[::2], end[::2])
        up_rad = math.asin((end[2] - start[2]) / length_m) + math.asin((radii[0] - radii[1]) / length_m)
        low_deg, high_deg, _ = _range(pair, 0.0)
        in_line_deg = min(max(-math.degrees(up_rad), low_deg), high_deg)
        angle_deg, comment = answer(
            "angle of the rear flippers on a drive [deg]", in_line_deg, "their lower side in line with that of the belts"
        )
        yield "angle_deg", angle_deg, comment
        yield from _joint(pair, 0.0, float(origin_m[1]), answer)


def _section(name: str, start: Any, end: Any, radii: Any, remark: str) -> Iterator[Line]:
    yield "[[belt]]", None, remark
    yield "name", name, ""
    yield "start_m", start, ""
    yield "end_m", end, ""
    yield "radii_m", radii, ""


def _front_flipper(
    pair: Flippers, axis_m: tuple[float, float], lanes: tuple[float, float, float], answer: Answer
) -> Iterator[Line]:
    """Yield the front flippers, whose angle counts from the line of the belts, in their lanes and about their front pulley."""
    half_m, radius_m = axis_m
    x, _, z = pair.tip.centre_m - pair.axis_m
    radii = [radius_m, float(pair.tip.half_m[0])]
    own = [*_lanes(pair.pulleys), float(_first_pulley(pair, pair.pulleys).half_m[0])]
    words = zip(("middle", "gauge", "width", "first radius"), own, (*lanes, radius_m), strict=True)
    remark = _dropped([f"its {word} is {own_m:.4g} m" for word, own_m, belts_m in words if abs(own_m - belts_m) > SAME_M])
    yield from _section("front", [half_m, radius_m], [half_m + math.hypot(x, z), radius_m], radii, remark)
    zero_rad = math.atan2(z, x)
    joint = list(_joint(pair, zero_rad, lanes[0], answer))
    high_deg = next(value[1] for key, value, _ in joint if key == "range_deg")
    yield "angle_deg", min(30.0, high_deg), f"{MARK}its rest angle"
    yield from joint


def _fixed_front(belts: DescribedBelts, front: CollisionSolid, axis_m: tuple[float, float], origin_m: Vector3) -> Iterator[Line]:
    """Yield a section ahead without a joint: up to the foremost pulley, or a short one where there is none."""
    nose = max(belts.pulleys, key=lambda pulley: float(pulley.centre_m[0]))
    half_m, radius_m = axis_m
    if nose.centre_m[0] < front.centre_m[0] + SAME_M:
        short_m = 0.5 * radius_m
        remark = f"{MARK}the belts end at the front pulley; a short rise stands for its rim"
        yield from _section("front", [half_m, radius_m], [half_m + short_m, radius_m + short_m], [radius_m, radius_m], remark)
        return
    end = nose.centre_m - origin_m
    yield from _section("front", [half_m, radius_m], end[::2], [radius_m, float(nose.half_m[0])], "")


def _joint(pair: Flippers, zero_rad: float, middle_m: float, answer: Answer) -> Iterator[Line]:
    """Yield the joint of a pair, whose angle is raised by ``zero_rad`` where the file's is zero, with the belts' middle at y."""
    mass_kg, com_m, inertia = summed(pair.whole)
    (x, _, z), (out_x, _, out_z) = pair.tip.centre_m - pair.axis_m, com_m - pair.axis_m
    length_m = math.hypot(x, z)
    c, s = x / length_m, z / length_m
    beside_m = c * out_z - s * out_x
    axes = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    low_deg, high_deg, remark = _range(pair, zero_rad)
    torques = [link.joint.torque_n_m for link in pair.links if link.joint is not None and link.joint.torque_n_m is not None]
    rates = [link.joint.rate_rad_s for link in pair.links if link.joint is not None and link.joint.rate_rad_s is not None]
    torque_n_m, asked = (
        (sum(torques), "")
        if torques
        else answer(f"torque of '{pair.links[0].name}', both sides [N m]", 60.0, "that of a robot of 20 kg")
    )
    yield "[belt.flipper]", None, ""
    yield "range_deg", [low_deg, high_deg], remark
    yield "torque_n_m", torque_n_m, asked
    yield "max_rate_deg_s", math.degrees(min(rates, default=math.radians(30.0))), _of_rates(rates)
    yield "lost_damping_n_m_s_rad", 50.0, f"{MARK}a dead motor, as in the shipped chairs"
    yield "mass_kg", mass_kg, ""
    places = [(beside_m, "above that line"), (com_m[1] - middle_m, "left of the middle")]
    yield (
        "com_m",
        c * out_x + s * out_z,
        _dropped([f"{place_m:.4f} m {word}" for place_m, word in places if abs(place_m) > LEFT_OUT]),
    )
    along = axes @ inertia @ axes.T
    products = along[(0, 0, 1), (1, 2, 2)]
    are_some = np.abs(products).max() > ROUNDING * np.trace(along)
    yield "inertia_kg_m2", np.diag(along), _dropped([f"its products xy, xz, yz of {_toml(products)}"] if are_some else [])


def _of_rates(rates_rad_s: Sequence[float]) -> str:
    """Return the comment of the rate of a pair: the slower of both sides."""
    if not rates_rad_s:
        return f"{MARK}that of the shipped chairs"
    fast_deg_s = math.degrees(max(rates_rad_s))
    return _dropped([f"the faster side has {fast_deg_s:.4g}"] if max(rates_rad_s) > min(rates_rad_s) else [])


def _dropped(parts: Sequence[str]) -> str:
    """Return the comment that names what the description has and the vehicle's file cannot."""
    return f"not written: in the file {', '.join(parts)}" if parts else ""


def _range(pair: Flippers, zero_rad: float) -> tuple[float, float, str]:
    """Return the range of a pair's angle [deg], raised positive, with a remark."""
    low, high, remark = -math.inf, math.inf, ""
    for joint in (link.joint for link in pair.links):
        if joint is not None and joint.range_rad is not None:
            same = joint.axis[1] * pair.raises > 0.0
            ends = joint.range_rad if same else (-joint.range_rad[1], -joint.range_rad[0])
            low, high = max(low, math.degrees(ends[0] + zero_rad)), min(high, math.degrees(ends[1] + zero_rad))
    if low == -math.inf:
        return -75.0, 60.0, f"{MARK}turns without end; the range of the shipped chairs"
    if low < -SQUARE_DEG or high > SQUARE_DEG:
        remark = f"in the file {low:.4g} to {high:.4g}"
    return max(low, -SQUARE_DEG), min(high, SQUARE_DEG), remark


def _drives(answer: Answer) -> Iterator[Line]:
    speed_m_s, mark = answer("largest speed of the belts [m/s]", 0.6, "a slow robot's")
    hold_n, hold_mark = answer("force that the brake of one belt holds [N]", 600.0, "twice what 20 kg need at 35°")
    yield "[drives]", None, ""
    yield "max_speed_m_s", speed_m_s, mark
    yield "lag_s", 0.15, f"{MARK}that of the shipped rescue"
    yield "max_acceleration_m_s2", 3.0, f"{MARK}between those of the shipped vehicles"
    yield "brake_hold_n", hold_n, hold_mark


def _camera(front_m: float, answer: Answer) -> Iterator[Line]:
    """Yield both depth cameras, above the first and the last axis."""
    height_m, mark = answer("height of a depth camera above the floor [m]", 0.5, "a mast; the lower, the flatter it should look")
    for table, sign, turn in (("camera", 1.0, 0.0), ("rear_camera", -1.0, 180.0)):
        yield f"[{table}]", None, ""
        yield "position_m", [sign * front_m, 0.0, height_m], mark
        yield "pitch_deg", 25.0, f"{MARK}check says which pitches see the stair"
        yield "yaw_deg", turn, ""
