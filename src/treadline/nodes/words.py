"""What only nodes tell each other: the clock, that one is alive, and why the guard holds."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """The mission clock as its owner has it."""

    t_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Beat:
    """A node is alive; it has spoken once and must go on."""

    t_s: float
    node: str
    state: str = "ready"
    """``ready``, or what it waits for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardState:
    """Why the guard holds the chair, or that it does not."""

    t_s: float
    holding: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Speed and turn asked by a person's stick or another planner (``/cmd_vel``); it has no stamp."""

    speed_m_s: float
    turn_rad_s: float
