"""Twin of the firmware's rules (``firmware/rules.c``), written a second time from the rules' description.

One step is a function of whole numbers and truth values that knows no branch: ``choose`` and the three connectives do. With those
of ``PLAIN`` it runs next to the C code, and with those of an SMT solver the same text is what the theorems are about.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

Values = dict[str, Any]
"""Named numbers and truth values: Python's own, or a solver's."""
WATCHDOG_MAX_MS = 100
ARMED, START, STOPPED, WATCHDOG, TWO_HOSTS, DEAD_MAN, BUTTON, DRIVE_ERROR, RUNAWAY = range(9)
ACCEPTED, BROKEN, VERSION, FOREIGN, STALE, OUT_OF_ORDER, NOT_NOW, OLD_LATCH, NO_LIMITS, BLOCKED, BEYOND = range(11)
DRIVE, HOLD, STOP, REARM, LIMITS = range(1, 6)
JOINTS = ("left", "right", "seat", "flipper")
LIMIT_NAMES = ("speed", "acceleration", "hold", "watchdog", "seat_limit", "flipper_limit")
UM_S_PER_UNIT = 100
HELD_MS, RELEASED_MS, AGAIN_MS, PRESS_MS, TURNS, TURNS_MS = 500, 750, 1000, 300, 500, 200
AGES = ("held", "released", "pressed", "rearmed", "turned")
FLAGS = ("turns", "open", "drives", "dead_man", "stop", "handset", "rearm")


@dataclass(frozen=True)
class Logic:
    """What the step needs in addition to arithmetic and comparison."""

    choose: Callable[[Any, Any, Any], Any]
    every: Callable[..., Any]
    some: Callable[..., Any]
    no: Callable[[Any], Any]


PLAIN = Logic(
    choose=lambda condition, yes, no: yes if condition else no,
    every=lambda *given: all(given),
    some=lambda *given: any(given),
    no=lambda given: not given,
)


def started(now_ms: int = 0) -> Values:
    """Return the memory of a box that has just started."""
    numbers = ("sender", "sequence", "reply", "rejections", *AGES, *JOINTS, *LIMIT_NAMES, "left_um_s", "right_um_s", "drive_error")
    belts = ("left_belt", "right_belt")
    begun = {"now": now_ms, "heard": now_ms, "latch": 1, "cause": START, "pressed": AGAIN_MS, "rearmed": AGAIN_MS}
    return dict.fromkeys((*numbers, *belts), 0) | dict.fromkeys(FLAGS, False) | begun


def received(box: Values, message: Mapping[str, Any], logic: Logic = PLAIN) -> Values:
    """Return the memory after a message: ``kind, sender, sequence, stamp, latch`` and six ``values``."""
    kind, values = message["kind"], message["values"]
    armed = box["cause"] == ARMED
    allowed = logic.choose(box["watchdog"] == 0, WATCHDOG_MAX_MS, box["watchdog"])
    ahead = (message["sequence"] - box["sequence"]) % 2**16
    moves = logic.some(kind == DRIVE, kind == HOLD)
    within = [
        logic.every(value <= limit, value >= -limit)
        for value, limit in zip(values, (box["speed"], box["speed"], box["seat_limit"], box["flipper_limit"]), strict=False)
    ]
    positive = [value > 0 for value in values[:4]] + [value >= 0 for value in values[4:]]
    valid = logic.every(*positive, values[1] >= values[2], values[3] <= WATCHDOG_MAX_MS)
    blocked = logic.some(
        logic.no(box["dead_man"]),
        box["stop"],
        box["drive_error"] != 0,
        box["turns"],
        box["held"] < HELD_MS,
        box["rearmed"] < AGAIN_MS,
        logic.every(box["handset"], box["pressed"] >= PRESS_MS),
    )
    # The first rule that applies decides.
    reasons = [
        (kind == STOP, ACCEPTED),
        (logic.every(armed, message["sender"] != box["sender"]), FOREIGN),
        ((box["now"] - message["stamp"]) % 2**32 >= allowed, STALE),
        (logic.every(armed, logic.some(ahead == 0, ahead >= 2**15)), OUT_OF_ORDER),
        (logic.every(armed, logic.no(moves)), NOT_NOW),
        (logic.every(armed, logic.no(logic.every(*within))), BEYOND),
        (armed, ACCEPTED),
        (kind == LIMITS, logic.choose(valid, ACCEPTED, BEYOND)),
        (kind != REARM, NOT_NOW),
        (message["latch"] != box["latch"], OLD_LATCH),
        (box["speed"] == 0, NO_LIMITS),
        (blocked, BLOCKED),
    ]
    reply: Any = ACCEPTED
    for condition, reason in reversed(reasons):
        reply = logic.choose(condition, reason, reply)
    accepted = reply == ACCEPTED
    heard = logic.every(accepted, kind != STOP)
    limited = logic.every(logic.some(accepted, reply == BEYOND), kind == LIMITS)
    driven = logic.every(heard, moves)
    rearmed = logic.every(heard, kind == REARM)
    halted = logic.every(armed, logic.some(kind == STOP, reply == FOREIGN))

    def after(name: str, condition: Any, value: Any) -> Any:
        return logic.choose(condition, value, box[name])

    new = dict(box)
    new["heard"] = after("heard", heard, message["stamp"])
    new["sequence"] = after("sequence", heard, message["sequence"])
    new["sender"] = after("sender", rearmed, message["sender"])
    new["reply"] = after("reply", logic.no(accepted), reply)
    new["rejections"] = after("rejections", logic.no(accepted), (box["rejections"] + 1) % 2**16)
    new["drives"] = after("drives", logic.some(driven, rearmed), logic.every(driven, kind == DRIVE))
    for name, value in zip(JOINTS, values, strict=False):
        new[name] = after(name, logic.some(driven, rearmed), logic.choose(driven, value, 0))
    for name, value in zip(LIMIT_NAMES, values, strict=True):
        new[name] = after(name, limited, logic.choose(valid, value, 0))
    new["latch"] = after("latch", halted, (box["latch"] + 1) % 2**16)
    for name in ("left_um_s", "right_um_s", "held", "released"):
        new[name] = after(name, halted, 0)
    new["pressed"], new["rearmed"] = after("pressed", rearmed, AGAIN_MS), after("rearmed", rearmed, 0)
    new["open"] = logic.every(box["open"], logic.no(rearmed))
    new["cause"] = logic.choose(halted, logic.choose(kind == STOP, STOPPED, TWO_HOSTS), logic.choose(rearmed, ARMED, box["cause"]))
    return new


def ticked(box: Values, now_ms: Any, inputs: Mapping[str, Any], logic: Logic = PLAIN) -> tuple[Values, Values]:
    """Return the memory after a tick with inputs, and what the drives do."""
    elapsed = (now_ms - box["now"]) % 2**32
    counted = logic.choose(elapsed < WATCHDOG_MAX_MS, elapsed, WATCHDOG_MAX_MS)
    older = {name: logic.choose(box[name] + counted < AGAIN_MS, box[name] + counted, AGAIN_MS) for name in AGES}
    released = logic.choose(box["dead_man"], 0, older["released"])
    pressed = logic.every(
        box["cause"] != ARMED,
        older["held"] >= HELD_MS,
        logic.some(box["dead_man"], released >= RELEASED_MS),
        inputs["rearm"],
        logic.no(box["rearm"]),
    )
    against = logic.some(logic.no(inputs["dead_man"]), inputs["stop"])
    allowed = logic.choose(box["watchdog"] == 0, WATCHDOG_MAX_MS, box["watchdog"])
    causes = [
        (inputs["drive_error"] != 0, DRIVE_ERROR),
        (inputs["stop"], BUTTON),
        (logic.no(inputs["dead_man"]), DEAD_MAN),
        (logic.some(elapsed >= allowed, (now_ms - box["heard"]) % 2**32 >= allowed), WATCHDOG),
    ]
    cause: Any = ARMED
    for condition, name in reversed(causes):
        cause = logic.choose(condition, name, cause)
    was_armed = box["cause"] == ARMED
    runs = logic.every(was_armed, cause == ARMED)
    step = logic.choose(box["drives"], box["acceleration"], box["hold"]) * counted
    new = box | older | {"now": now_ms} | dict(inputs)
    for side in ("left", "right"):
        value, target = box[f"{side}_um_s"], logic.choose(box["drives"], box[side] * UM_S_PER_UNIT, 0)
        down = logic.choose(value - target > step, value - step, target)
        moved = logic.choose(target > value, logic.choose(target - value > step, value + step, target), down)
        new[f"{side}_um_s"] = logic.choose(runs, moved, 0)
    ends = logic.every(logic.no(box["drives"]), new["left_um_s"] == 0, new["right_um_s"] == 0)
    stands = logic.some(logic.no(runs), ends)
    fast = [logic.some(inputs[name] > TURNS, inputs[name] < -TURNS) for name in ("left_belt", "right_belt")]
    new["turned"] = logic.choose(box["turns"], older["turned"], 0)
    new["turns"] = logic.every(stands, logic.some(*fast))
    opens = logic.every(new["turns"], new["turned"] >= TURNS_MS)
    new["open"] = logic.some(box["open"], opens)
    cause = logic.choose(logic.every(runs, opens), RUNAWAY, cause)
    new["cause"] = logic.choose(was_armed, cause, box["cause"])
    armed, halts = logic.every(runs, cause == ARMED), logic.every(was_armed, cause != ARMED)
    new["latch"] = logic.choose(halts, (box["latch"] + 1) % 2**16, box["latch"])
    new["held"], new["released"] = logic.choose(halts, 0, older["held"]), logic.choose(halts, 0, released)
    new["pressed"] = logic.choose(against, AGAIN_MS, logic.choose(pressed, 0, older["pressed"]))
    outputs = {
        "left_um_s": new["left_um_s"],
        "right_um_s": new["right_um_s"],
        "seat": logic.choose(armed, box["seat"], 0),
        "flipper": logic.choose(armed, box["flipper"], 0),
        "brake": stands,
        "contactor": logic.no(new["open"]),
    }
    return new, outputs
