"""Changes that a person may make to a run: their names, values and meanings, and the form to choose one. ``choice -> Fault``."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

from treadline.report.labels import FAULTS
from treadline.scenario.faults import EXTENTS, Fault, FaultKind

FRICTION_MIN, FRICTION_MAX = 0.1, 2.0
"""Range of the factor on the friction: from oil on the steps to twice the scenario's friction."""
FOREVER_S = 1e6
"""Duration of a change that stays [s]: longer than every run."""
LASTS_S = 3.0
"""Duration of a fault that the form offers first [s], as in a scenario without one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Change that the page offers."""

    kind: FaultKind
    stays: bool = False
    """Whether it lasts to the end of the run."""
    friction_of: str = ""
    """Part whose friction has a factor from ``FRICTION_MIN`` to ``FRICTION_MAX``; empty for every other change."""
    sign: float = 1.0
    """Sign that the value of the fault has."""

    @property
    def means(self) -> str:
        """Meaning of the value; empty if there is none."""
        if self.friction_of:
            return f"factor on the friction of {self.friction_of}, {FRICTION_MIN:g} to {FRICTION_MAX:g}"
        extent = EXTENTS[self.kind]
        return "" if extent.low == extent.high else extent.means

    @property
    def default(self) -> float:
        """Value that the form fills in."""
        return 0.5 if self.friction_of else EXTENTS[self.kind].default


OBSTACLE = "obstacle ahead"
CHANGES: Mapping[str, Change] = {
    "wet steps (friction × 0.5)": Change(kind="low_friction", friction_of="both belts", stays=True),
    "friction of the left belt": Change(kind="track_slip", friction_of="the left belt", stays=True),
    "friction of the right belt": Change(kind="track_slip", friction_of="the right belt", sign=-1.0, stays=True),
    "passenger's weight forward": Change(kind="payload_forward", stays=True),
    "passenger's weight to the left": Change(kind="payload_left", stays=True),
    "passenger's weight up": Change(kind="payload_up", stays=True),
    OBSTACLE: Change(kind="obstacle", stays=True),
    **{FAULTS[kind]: Change(kind=kind) for kind in EXTENTS},
}
"""Changes that stay, and faults that pass, by name."""
NOTHING = "no change (repeats the run)"
FORKS = (
    *(name for name, change in CHANGES.items() if change.stays),
    NOTHING,
    *(name for name, change in CHANGES.items() if not change.stays and change.kind not in ("operator_stop", "link_lost")),
)
"""Choices of a fork; nobody operates one."""
INJECTIONS = (OBSTACLE, *(name for name in CHANGES if name != OBSTACLE))
"""Choices of a live run."""


def meaning(choice: str) -> str:
    """Return a sentence about a choice."""
    if choice == NOTHING:
        return "The plant is deterministic: the fork coincides with the run."
    change = CHANGES[choice]
    value = f"value: {change.means}" if change.means else EXTENTS[change.kind].means.removeprefix("unused: ")
    return value + ("; until the end of the run" if change.stays else "; for the given time")


def fault_of(choice: str, value: float, lasts_s: float) -> Fault | None:
    """Return the fault behind a choice; None without a change.

    Raises:
        ValueError: If the value means nothing for this kind.
    """
    if choice == NOTHING:
        return None
    change = CHANGES[choice]
    if change.friction_of and not FRICTION_MIN <= value <= FRICTION_MAX:
        raise ValueError(f"value is {value:g}; a factor on the friction must be from {FRICTION_MIN:g} to {FRICTION_MAX:g}")
    return Fault(
        kind=change.kind,
        at_s=0.0,
        for_s=FOREVER_S if change.stays else lasts_s,
        value=change.sign * value if change.means else 0.0,
    )


def said_of(choice: str, value: float, lasts_s: float) -> str:
    """Return a choice with its value and duration, to be repeated next to the result."""
    if choice == NOTHING:
        return choice
    change = CHANGES[choice]
    if change.friction_of:
        name, size = choice.partition(" (")[0], f", friction × {value:g}"
    else:
        name, size = choice, f" = {value:g}" if change.means else ""
    return name + size + ("" if change.stays else f" for {lasts_s:g} s")


def last_line(error: ValueError) -> str:
    """Return the sentence about the value: pydantic adds a heading and a link."""
    lines = str(error).splitlines()
    return lines[-2 if len(lines) > 1 else 0].strip()


class ChangeForm:
    """Form with choice, value and duration of a change; a choice fills in its default value.

    Args:
        gui: viser's controls.
        label: Label of the choice.
        choices: Names of the changes.
    """

    def __init__(self, gui: Any, label: str, choices: tuple[str, ...]) -> None:
        self._choice = gui.add_dropdown(label, choices)
        self._value = gui.add_number("value", 0.0, step=0.05)
        self._lasts = gui.add_number("for [s]", LASTS_S, min=0.1, step=0.5)
        self._hint: Any = None
        self._choice.on_update(lambda _event: self._fill())
        self._fill()

    def add_hint(self, gui: Any) -> None:
        """Add the meaning of the choice."""
        self._hint = gui.add_html("")
        self._fill()

    def _fill(self) -> None:
        change = CHANGES.get(self._choice.value)
        self._value.value = 0.0 if change is None else change.default
        self._value.disabled = change is None or not change.means
        self._lasts.disabled = change is None or change.stays
        if self._hint is not None:
            self._hint.content = f'<div style="font-size:12px;margin-right:14px">{escape(meaning(self._choice.value))}</div>'

    def take(self, event: Any) -> tuple[Fault | None, str] | None:
        """Return the chosen fault with its name for people; None after telling the client why its value is refused."""
        chosen = self._choice.value, float(self._value.value), float(self._lasts.value)
        try:
            return fault_of(*chosen), said_of(*chosen)
        except ValueError as error:
            if event.client is not None:
                event.client.add_notification(title="not injected", body=last_line(error), color="red")
            return None
