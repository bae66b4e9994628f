"""Changes that a person may make to a run: their names, values and meanings, and how a fork went. ``choice -> Fault``."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any, get_args

from treadline.scenario.faults import EXTENTS, Fault, FaultKind
from treadline.view.pages import BAD_TEXT, STYLE
from treadline.view.session import Session

FRICTION_MIN, FRICTION_MAX = 0.1, 2.0
"""Range of the factor on the friction: from oil on the steps to twice the scenario's friction."""
FOREVER_S = 1e6
"""Duration of a change that stays [s]."""
LASTS_S = 3.0
"""Duration of a fault that the form offers first [s], as in a scenario without one."""
PREPARING = "preparing the simulation; the first run on a computer compiles its kernels once, which takes a minute or two"
"""Sentence about a simulation that has not sent anything yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Change that the page offers."""

    kind: FaultKind
    means: str
    """Meaning of its value; empty if it has none."""
    default: float = 0.0
    sign: float = 1.0
    """Sign that the value of the fault has."""
    stays: bool = False
    """Whether it lasts to the end of the run."""

    @property
    def has_value(self) -> bool:
        """Whether a person may choose a value."""
        return bool(self.means)


def _of_kind(kind: FaultKind) -> Change:
    extent = EXTENTS[kind]
    return Change(kind=kind, means="" if extent.low == extent.high else extent.means, default=extent.default)


FACTOR = f"factor on the friction of {{}}, {FRICTION_MIN:g} to {FRICTION_MAX:g}"
NAMES: Mapping[FaultKind, str] = {
    "camera_lost": "camera sends nothing",
    "camera_frozen": "camera repeats its last frame",
    "camera_dark": "light too dark or too bright",
    "depth_holes": "holes in the depth image",
    "false_edges": "false edge across the nosings",
    "imu_nan": "IMU sends no numbers (NaN)",
    "imu_stuck": "IMU repeats its last sample",
    "imu_bias": "gyro bias or jump of the heading",
    "imu_lost": "IMU sends nothing",
    "clock_back": "clock jumps back",
    "late_tick": "commands arrive late",
    "track_stalled": "one belt stalls",
    "track_slip": "friction of one belt for a time",
    "low_friction": "friction of the steps for a time",
    "operator_stop": "operator's stop",
    "link_lost": "operator's link is lost",
    "seat_stuck": "seat actuator is blocked",
    "process_killed": "a process is killed",
    "power_cut": "power is cut",
    "obstacle": "obstacle ahead for a time",
    "flipper_lost": "flipper motor without power",
    "flipper_stuck": "flipper is blocked",
    "readings_lost": "belts, seat and flipper report nothing",
    "gyro_ramp": "gyro bias grows",
    "wrong_stamp": "message with a wrong time stamp",
    "payload_forward": "passenger leans forward for a time",
    "payload_left": "passenger leans to the left for a time",
    "payload_up": "passenger's weight is raised for a time",
}
"""Name of each kind of fault on the page."""
OBSTACLE = "obstacle ahead"
STAYING: dict[str, Change] = {
    "wet steps (friction × 0.5)": Change(kind="low_friction", means=FACTOR.format("both belts"), default=0.5, stays=True),
    "friction of the left belt": Change(kind="track_slip", means=FACTOR.format("the left belt"), default=0.5, stays=True),
    "friction of the right belt": Change(
        kind="track_slip", means=FACTOR.format("the right belt"), default=0.5, sign=-1.0, stays=True
    ),
    "passenger's weight forward": Change(kind="payload_forward", means=EXTENTS["payload_forward"].means, default=0.15, stays=True),
    "passenger's weight to the left": Change(kind="payload_left", means=EXTENTS["payload_left"].means, default=0.15, stays=True),
    "passenger's weight up": Change(kind="payload_up", means=EXTENTS["payload_up"].means, default=0.15, stays=True),
    OBSTACLE: Change(kind="obstacle", means=EXTENTS["obstacle"].means, default=1.2, stays=True),
}
"""Changes that stay, by name."""
PASSING: dict[str, Change] = {NAMES[kind]: _of_kind(kind) for kind in get_args(FaultKind)}
"""Faults that pass, by name."""
CHANGES = STAYING | PASSING
NOTHING = "no change (repeats the run)"
FORKS = (*STAYING, NOTHING, *(name for name, change in PASSING.items() if change.kind not in ("operator_stop", "link_lost")))
"""Choices of a fork; nobody operates one."""
INJECTIONS = (OBSTACLE, *(name for name in CHANGES if name != OBSTACLE))
"""Choices of a live run."""


def meaning(choice: str) -> str:
    """Return a sentence about a choice."""
    if choice == NOTHING:
        return "The plant is deterministic: the fork coincides with the run."
    change = CHANGES[choice]
    value = f"value: {change.means}" if change.has_value else EXTENTS[change.kind].means.removeprefix("unused: ")
    return value + ("; until the end of the run" if change.stays else "; for the given time")


def fault_of(choice: str, value: float, lasts_s: float) -> Fault | None:
    """Return the fault behind a choice; None without a change.

    Raises:
        ValueError: If the value means nothing for this kind.
    """
    if choice == NOTHING:
        return None
    change = CHANGES[choice]
    if change.stays and change.kind in ("low_friction", "track_slip") and not FRICTION_MIN <= value <= FRICTION_MAX:
        raise ValueError(f"value is {value:g}; a factor on the friction must be from {FRICTION_MIN:g} to {FRICTION_MAX:g}")
    return Fault(
        kind=change.kind,
        at_s=0.0,
        for_s=FOREVER_S if change.stays else lasts_s,
        value=change.sign * value if change.has_value else 0.0,
    )


def said_of(choice: str, value: float, lasts_s: float) -> str:
    """Return a choice with its value and duration, to be repeated next to the result."""
    if choice == NOTHING:
        return choice
    change = CHANGES[choice]
    if change.stays and change.kind in ("low_friction", "track_slip"):
        name, size = choice.partition(" (")[0], f", friction × {value:g}"
    else:
        name, size = choice, f" = {value:g}" if change.has_value else ""
    return name + size + ("" if change.stays else f" for {lasts_s:g} s")


def last_line(error: ValueError) -> str:
    """Return the sentence about the value: pydantic adds a heading and a link."""
    lines = str(error).splitlines()
    return lines[-2 if len(lines) > 1 else 0].strip()


def complain(event: Any, error: ValueError) -> None:
    """Show a client why its value is refused."""
    if event.client is not None:
        event.client.add_notification(title="not injected", body=last_line(error), color="red")


def outcome_html(session: Session, waited_s: float, margins: tuple[str, str]) -> str:
    """Return how a fork went, next to the run.

    Args:
        waited_s: Time since the fork was asked for [s].
        margins: Least margins of the fork and of the run.
    """
    ghost = session.ghost
    if ghost is None:
        return ""
    tape = ghost.tape
    head = f"<b>fork at {session.ghost_from_s:.2f} s: {escape(session.ghost_name)}</b>"
    if ghost.error is not None:
        said = f'<span style="color:{BAD_TEXT}">{escape(ghost.error)}</span>'
    elif not len(tape):
        said = f"{PREPARING} ({waited_s:.0f} s so far)"
    elif tape.verdict is None:
        said = f"simulated to {tape.end_s:.1f} s of about {session.tape.end_s:.1f} s"
    else:
        said = f"ended at {tape.end_s:.2f} s: <b>{escape(tape.verdict)}</b>"
        hold = next((event for event in reversed(tape.events) if event.name == "hold"), None)
        if hold is not None and hold.cause not in tape.verdict:
            said += f"<br>hold at {hold.t_s:.2f} s: {escape(hold.cause)}"
        if margins[0]:
            said += f"<br>{escape(margins[0])}"
        if session.cursor_s > tape.end_s:
            said += f"<br><b>the fork ended {session.cursor_s - tape.end_s:.1f} s before the cursor</b>; its chair stays there"
    ended = session.tape.verdict
    run = f"still runs at {session.tape.end_s:.2f} s" if ended is None else f"ended at {session.tape.end_s:.2f} s: {escape(ended)}"
    run += f"<br>{escape(margins[1])}" if margins[1] else ""
    return f'<div style="{STYLE}">{head}<br>{said}<br><b>run</b>: {run}</div>'
