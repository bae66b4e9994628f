"""Signals as standard messages and back: ROS 1, whose users know the paper's topics, and logs of release 0.3 and before.

Belts, seat and ground truth are ``JointState`` messages: names with numbers. What has words is a ``DiagnosticArray``. Quantities
without a measurement are left out.
"""

import math
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import cache
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from treadline.core import signals
from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.ports import Truth
from treadline.io.message_types import RosMessage, stamp
from treadline.io.messages import (
    CAMERA,
    DETAIL,
    IMU,
    JOINTS,
    OWN,
    SIGNALS,
    STATUS,
    TRUTH_NAMES,
    Form,
    images_of,
    joints,
    messages_of,
    status,
    topic_of,
)

Read = Callable[[Any, float], Any]
"""Decoder from a message and its stamp [s] to a signal."""


def standard_messages_of(signal: Any, topic: str | None = None) -> list[RosMessage]:
    """Return the messages of a signal in standard types, on the default topic of its type unless ``topic`` is given."""
    topic = topic or topic_of(signal)
    match signal:
        case signals.HeadingEstimate() | signals.HeadingMeasurement():
            return [_pose(signal, topic), _Joints(type(signal)).write(signal, topic + DETAIL)]
        case signals.StairMap():
            return [_poses(signal, topic), _write_map(signal, topic + DETAIL)]
        case RgbdFrame():
            return images_of(signal, topic, CAMERA)  # the name of the camera's optical frame in ROS 1
        case signals.MotionPlan():
            return [_write_plan(signal, topic)]
        case signals.PlantState():
            level = 0 if signal.fault is None else 2
            battery = {} if signal.battery_v is None else {"battery_v": f"{signal.battery_v!r}"}
            return [status(topic, signal.t_s, (level, "plant", signal.fault or "", "plant"), battery, "chair")]
        case signals.HeadingHealth():
            return [_write_health(signal, topic)]
        case _ if type(signal) in JOINTED:
            return [_Joints(type(signal)).write(signal, topic)]
    return messages_of(signal, topic)


# ---- poses for viewers ----

POSE, POSES = "geometry_msgs/msg/PoseWithCovarianceStamped", "geometry_msgs/msg/PoseArray"


def _pose(signal: signals.HeadingEstimate | signals.HeadingMeasurement, topic: str) -> RosMessage:
    half = 0.5 * signal.heading_rad
    values = (*(0.0,) * 5, math.sin(half), math.cos(half), *(0.0,) * 35, signal.sigma_rad * signal.sigma_rad)
    return RosMessage(topic, POSE, (*stamp(signal.t_s), "stair", *values))


def _poses(stair: signals.StairMap, topic: str) -> RosMessage:
    values = [x for place in stair.nosings_B for x in (*place, 0.0, 0.0, 0.0, 1.0)]
    count = len(stair.nosings_B)
    return RosMessage(topic, POSES, (*stamp(stair.t_s), "chair", count, *values), (count,))


# ---- JointState ----


class _Jointed(NamedTuple):
    """Signal as a JointState: fields by name of the joint, and the frame: a name, or the field that it holds."""

    frame: str
    joints: dict[str, str]
    in_motion: bool = False
    """Whether the numbers are velocities."""
    held: dict[str, str] = {}  # noqa: RUF012 - a tuple has no factory
    """Joints whose number is a position although those of the others are velocities."""


def _by_name(*names: str) -> dict[str, str]:
    return dict(zip(names, names, strict=True))


MAYBE_OF_MAP = tuple(name for name, hint in get_type_hints(signals.StairMap).items() if hint == float | None)
"""Numbers of a stair map that a frame may not show."""
BELTS = {"left": "left_m_s", "right": "right_m_s"}
JOINTED: dict[type, _Jointed] = {
    signals.TrackCommand: _Jointed("sender", BELTS, in_motion=True, held={"brake": "brake"}),
    signals.TrackReading: _Jointed("chair", BELTS, in_motion=True, held={"brake": "brake_on"}),
    signals.SeatCommand: _Jointed("sender", {"stroke": "rate_m_s"}, in_motion=True),
    signals.SeatReading: _Jointed("chair", {"stroke": "stroke_m", "pitch": "pitch_rad"}),
    signals.FlipperCommand: _Jointed("sender", {"flipper": "rate_rad_s"}, in_motion=True),
    signals.FlipperReading: _Jointed("chair", {"angle": "angle_rad", "torque": "torque_n_m"}),
    signals.OperatorInput: _Jointed("operator", _by_name("dead_man", *signals.BUTTONS)),
    signals.HeadingEstimate: _Jointed("source", _by_name("heading_rad", "heading_rate_rad_s", "sigma_rad")),
    signals.HeadingMeasurement: _Jointed("camera", _by_name("heading_rad", "sigma_rad", "edge_count", "correction_rad")),
    signals.FrameQuality: _Jointed("camera", _by_name("fingerprint", "brightness", "contrast", "valid_share", "obstacle_m")),
    signals.FreeGround: _Jointed(
        "view", _by_name("blind_m", "seen_m", "end_m", "end_sigma_m", "direction_rad", "direction_sigma_rad", "drop_m")
    ),
    Truth: _Jointed("simulator", _by_name(*TRUTH_NAMES)),
}


@cache
class _Joints:
    """Encoder and decoder of a signal of ``JOINTED``."""

    def __init__(self, signal: type) -> None:
        self._signal, self._form, self._items = signal, JOINTED[signal], JOINTED[signal].joints | JOINTED[signal].held
        hints = get_type_hints(signal)
        self._converted = [(item, hints[item]) for item in self._items.values() if hints[item] in (int, bool)]
        self._frame = hints.get(self._form.frame)
        self._required = {item.name for item in fields(signal) if item.default is MISSING} - {"t_s", self._form.frame}

    def write(self, signal: Any, topic: str) -> RosMessage:
        """Return the message of a signal."""
        form = self._form
        known = {name: getattr(signal, item) for name, item in form.joints.items()}
        known = {name: float(value) for name, value in known.items() if value is not None}
        held = {name: float(getattr(signal, item)) for name, item in form.held.items()}
        position, velocity = (*known.values(), *held.values()), ()
        if form.in_motion:
            position = (*dict.fromkeys(known, 0.0).values(), *held.values()) if held else ()
            velocity = (*known.values(), *dict.fromkeys(held, 0.0).values())
        return joints(topic, signal.t_s, (*known, *held), position, velocity, getattr(signal, form.frame, form.frame))

    def read(self, message: Any, t_s: float) -> Any:
        """Return the signal of a message; numbers without names are in the order of the form."""
        form, values = self._form, message.velocity if self._form.in_motion else message.position
        names = message.name if message.name and message.name[0] in self._items else list(self._items)[: len(values)]
        known = dict(zip(names, _counted(values, len(names)), strict=True))
        if form.held:
            places = dict(zip(names, _counted(message.position, len(names)), strict=True))
            known |= {name: places[name] for name in form.held}
        found: dict[str, Any] = {item: known[name] for name, item in self._items.items() if name in known}
        lacking = self._required - found.keys()
        if lacking:
            raise LogFormatError(f"a {self._signal.__name__} lacks {min(lacking)}; is it of another version?")
        found |= {item: kind(found[item]) for item, kind in self._converted if item in found}
        if self._frame is not None:
            word = message.header.frame_id
            found[form.frame] = _one_of(self._frame, word) if get_origin(self._frame) is Literal else word
        return self._signal(t_s=t_s, **found)


def _counted(values: Any, count: int) -> list[float]:
    """Return the numbers of a JointState after counting them."""
    if len(values) != count:
        raise LogFormatError(f"a JointState holds {len(values)} numbers; {count} are required")
    return list(values.tolist())


def _one_of(words: Any, word: str) -> Any:
    """Return a word after checking for membership in a ``Literal``."""
    known = get_args(words)
    if word not in known:
        raise LogFormatError(f"unknown value '{word[:40]}'; known: {', '.join(known)}; is it of another version?")
    return word


def _write_map(stair: signals.StairMap, topic: str) -> RosMessage:
    maybe = {name: getattr(stair, name) for name in MAYBE_OF_MAP}
    sides = (("left", stair.left_side), ("right", stair.right_side))
    maybe |= {f"{name}_open": None if side is None else float(side == "open") for name, side in sides}
    known = {"rise_m": stair.rise_m, "run_m": stair.run_m, "slope_rad": stair.slope_rad, "ends": float(stair.ends)}
    known |= {name: value for name, value in maybe.items() if value is not None} | {"nosings": float(len(stair.nosings_B))}
    for i, place in enumerate(stair.nosings_B):
        known |= {f"nosing{i}_{axis}_m": value for axis, value in zip("xyz", place, strict=True)}
    return joints(topic, stair.t_s, tuple(known), tuple(known.values()), (), stair.direction)


def _read_map(message: Any, t_s: float) -> signals.StairMap:
    values = dict(zip(message.name, _counted(message.position, len(message.name)), strict=True))
    places = [tuple(values[f"nosing{i}_{axis}_m"] for axis in "xyz") for i in range(int(values["nosings"]))]
    sides = {name: values.get(f"{name}_open") for name in ("left", "right")}
    more: dict[str, Any] = {f"{name}_side": ("wall", "open")[bool(side)] for name, side in sides.items() if side is not None}
    more |= {name: values.get(name) for name in MAYBE_OF_MAP} | {name: values[name] for name in ("rise_m", "run_m", "slope_rad")}
    direction = _one_of(signals.Direction, message.header.frame_id)
    return signals.StairMap(t_s=t_s, direction=direction, nosings_B=tuple(places), ends=bool(values["ends"]), **more)


# ---- DiagnosticArray ----


def _status_of(message: Any) -> Any:
    """Return the status in a diagnostic_msgs/DiagnosticArray."""
    if len(message.status) != 1:
        raise LogFormatError("a DiagnosticArray of treadline holds one status")
    return message.status[0]


def _write_plan(plan: signals.MotionPlan, topic: str) -> RosMessage:
    numbers = {"speed_m_s": plan.speed_m_s, "turn_m_s": plan.turn_m_s, "heading_rad": plan.heading_rad}
    numbers |= {"min_inner_speed_ratio": plan.min_inner_speed_ratio, "pitch_feedforward_m_s": plan.pitch_feedforward_m_s}
    numbers |= {} if plan.flipper is None else {"flipper_t_s": plan.flipper.t_s, "flipper_rad_s": plan.flipper.rate_rad_s}
    values = {name: repr(float(value)) for name, value in numbers.items() if value is not None}
    values |= {"needs_stair": str(plan.needs_stair)} | ({} if plan.hold is None else {"hold": plan.hold})
    return status(topic, plan.t_s, (int(plan.hold is not None), plan.phase, plan.cause, "plan"), values, "chair")


def _read_plan(message: Any, t_s: float) -> signals.MotionPlan:
    found = _status_of(message)
    numbers = {item.key: item.value for item in found.values}
    needs_stair, hold = numbers.pop("needs_stair", None), numbers.pop("hold", None)
    known = {name: float(value) for name, value in numbers.items()}
    flipper = (
        signals.FlipperCommand(t_s=known.pop("flipper_t_s"), rate_rad_s=known.pop("flipper_rad_s"))
        if "flipper_t_s" in known
        else None
    )
    phase = _one_of(signals.Phase, found.name)
    if "speed_m_s" not in known or not known.keys() <= {item.name for item in fields(signals.MotionPlan)}:
        raise LogFormatError("a plan without a speed, or with unknown numbers; is it of another version?")
    more: dict[str, Any] = known
    return signals.MotionPlan(
        t_s=t_s, phase=phase, flipper=flipper, needs_stair=needs_stair == "True", cause=found.message, hold=hold, **more
    )


OF_HEALTH = ("disagreement_rad", "unseen_s", "bias_rad_s", "scale", "walk_rad_rts")
"""Numbers of a filter's health that are always known."""


def _write_health(health: signals.HeadingHealth, topic: str) -> RosMessage:
    numbers = {name: getattr(health, name) for name in ("since_s", *OF_HEALTH)}
    values = {name: repr(float(value)) for name, value in numbers.items() if value is not None}
    header = (int(health.fault is not None), health.fault or "", health.cause or "", "heading filter")
    return status(topic, health.t_s, header, values, "stair")


def _read_health(message: Any, t_s: float) -> signals.HeadingHealth:
    found = _status_of(message)
    fault = _one_of(signals.HeadingFault, found.name) if found.name else None
    known = {item.key: float(item.value) for item in found.values}
    numbers = {name: known[name] for name in OF_HEALTH}
    return signals.HeadingHealth(t_s=t_s, fault=fault, since_s=known.get("since_s"), cause=found.message or None, **numbers)


def _read_event(message: Any, t_s: float) -> signals.Event:
    """Return the event in a DiagnosticArray."""
    found = _status_of(message)
    return signals.Event(t_s=t_s, name=found.name, cause=found.message)


def _read_plant(message: Any, t_s: float) -> signals.PlantState:
    found = _status_of(message)
    battery_v = next((float(item.value) for item in found.values if item.key == "battery_v"), None)
    return signals.PlantState(t_s=t_s, fault=found.message if found.level else None, battery_v=battery_v)


HEADINGS, EVENTS = OWN[signals.HeadingMeasurement].read, "/diagnostics"
"""Topics of recorded heading measurements and of events."""
STANDARD: dict[tuple[str, str], Read] = {
    **{(OWN[signal].read, JOINTS): _Joints(signal).read for signal in JOINTED},
    (OWN[signals.StairMap].read, JOINTS): _read_map,
    (OWN[signals.HeadingHealth].read, STATUS): _read_health,
    (OWN[signals.MotionPlan].read, STATUS): _read_plan,
    (OWN[signals.PlantState].read, STATUS): _read_plant,
    (EVENTS, STATUS): _read_event,
}
"""Decoder of a topic of a standard type."""


# ---- any signal ----


LOOKED = frozenset(OWN[kind].read for kind in (signals.FrameQuality, signals.FreeGround, signals.StairMap))
"""Topics of frame results besides the heading, for logs without images and for cameras with their own detector."""
OURS = (
    {"/imu"}.union(topic for topic, _ in STANDARD)
    - LOOKED
    - {OWN[kind].read for kind in (signals.MotionPlan, signals.HeadingHealth)}
)
"""Other topics of a run log except images."""


def signal_reader(topic: str, kind: str) -> Read | None:
    """Return the decoder of a topic's messages to signals, from message and stamp [s]; None if the type means something else."""
    if kind in SIGNALS:
        return Form(SIGNALS[kind]).decode
    return imu if kind == IMU else STANDARD.get((topic, kind))


def imu(message: Any, t_s: float) -> signals.ImuSample:
    """Return the sample in a sensor_msgs/Imu; an orientation marked as not measured is a zero quaternion."""
    q, rate, force = message.orientation, message.angular_velocity, message.linear_acceleration
    return signals.ImuSample(
        t_s=t_s,
        orientation=(0.0, 0.0, 0.0, 0.0) if message.orientation_covariance[0] == -1.0 else (q.w, q.x, q.y, q.z),
        angular_velocity_rad_s=(rate.x, rate.y, rate.z),
        linear_acceleration_m_s2=(force.x, force.y, force.z),
    )
