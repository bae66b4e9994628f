"""Prove theorems on the rules of the firmware with an SMT solver, for every state, message, input and time.

Run: ``pip install z3-solver`` and ``python benchmarks/firmware_proof.py``. The rules are those of
``tests/builders/firmware_twin.py``; that the C code follows them is tested on random traffic (``benchmarks/firmware_fuzz.py``), not
proved. The theorems and their assumptions are listed in docs/reference/firmware.md. Ends with 1 and a counterexample if one fails.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import z3

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "builders"))

import firmware_twin as twin

LOGIC = twin.Logic(choose=z3.If, every=z3.And, some=z3.Or, no=z3.Not)
BITS = {"now": 32, "heard": 32} | dict.fromkeys(("sender", "sequence", "latch", "rejections", "drive_error", *twin.AGES), 16)
TIMEOUT_MS = 120_000


def unsigned(name: str, bits: int) -> tuple[Any, Any]:
    """Return a number and its range."""
    number = z3.Int(name)
    return number, z3.And(number >= 0, number < 2**bits)


def signed(name: str, bits: int) -> tuple[Any, Any]:
    """Return a signed number and its range."""
    number = z3.Int(name)
    return number, z3.And(number >= -(2 ** (bits - 1)), number < 2 ** (bits - 1))


def any_box() -> tuple[twin.Values, Any]:
    """Return a box in any state of its memory's types."""
    box, ranges = {}, []
    for name in twin.started():
        if name in twin.FLAGS:
            box[name] = z3.Bool(name)
            continue
        number, within = unsigned(name, BITS[name]) if name in BITS else signed(name, 32 if name.endswith("um_s") else 16)
        box[name] = number
        ranges.append(within)
    return box, z3.And(*ranges)


def any_message() -> tuple[dict[str, Any], Any]:
    """Return any message that the decoder lets through."""
    sizes = {"sender": 16, "sequence": 16, "stamp": 32, "latch": 16}
    parts = {name: unsigned(f"message_{name}", bits) for name, bits in sizes.items()}
    values = [signed(f"value_{number}", 16) for number in range(6)]
    kind = z3.Int("kind")
    message = {name: number for name, (number, _) in parts.items()} | {"kind": kind, "values": [number for number, _ in values]}
    return message, z3.And(kind >= 1, kind <= 5, *(within for _, within in (*parts.values(), *values)))


def any_inputs() -> tuple[dict[str, Any], Any]:
    """Return any inputs."""
    error, within = unsigned("new_error", 16)
    belts = {name: signed(f"new_{name}", 16) for name in ("left_belt", "right_belt")}
    switches = {name: z3.Bool(f"new_{name}") for name in ("dead_man", "stop", "handset", "rearm")}
    numbers = {name: number for name, (number, _) in belts.items()} | {"drive_error": error}
    return switches | numbers, z3.And(within, *(within for _, within in belts.values()))


def is_sound(box: twin.Values) -> Any:
    """Return what holds of each state that the box reaches."""
    limits = [box[name] for name in twin.LIMIT_NAMES]
    unset = z3.And(*(limit == 0 for limit in limits))
    speed, acceleration, hold, watchdog, seat, flipper = limits
    valid = z3.And(
        speed > 0, hold > 0, acceleration >= hold, watchdog > 0, watchdog <= twin.WATCHDOG_MAX_MS, seat >= 0, flipper >= 0
    )
    pairs = zip(twin.JOINTS, (speed, speed, seat, flipper), strict=True)
    within = z3.And(*(z3.And(box[name] <= limit, box[name] >= -limit) for name, limit in pairs))
    belts = [box["left_um_s"], box["right_um_s"]]
    bounded = z3.And(*(z3.And(belt <= 100 * speed, belt >= -100 * speed) for belt in belts))
    stands = z3.And(*(belt == 0 for belt in belts))
    armed = box["cause"] == twin.ARMED
    fresh = (box["now"] - box["heard"]) % 2**32 < watchdog
    cause = z3.And(box["cause"] >= 0, box["cause"] <= twin.RUNAWAY, *(box[age] <= twin.AGAIN_MS for age in twin.AGES))
    return z3.And(z3.Or(unset, valid), cause, z3.If(armed, z3.And(valid, within, bounded, fresh, z3.Not(box["open"])), stands))


def theorems() -> Iterator[tuple[str, Any, Any]]:
    """Yield name, assumption and claim of each theorem."""
    box, types = any_box()
    message, is_message = any_message()
    inputs, are_inputs = any_inputs()
    now, is_time = unsigned("new_now", 32)
    judged = twin.received(box, message, LOGIC)
    after, outputs = twin.ticked(box, now, inputs, LOGIC)
    reached = z3.And(types, is_sound(box))
    heard, ticked = z3.And(reached, is_message), z3.And(reached, are_inputs, is_time)
    armed, latched = box["cause"] == twin.ARMED, box["cause"] != twin.ARMED
    elapsed = (now - box["now"]) % 2**32
    age = (now - box["heard"]) % 2**32
    belts = (outputs["left_um_s"], outputs["right_um_s"])
    stands = z3.And(*(outputs[name] == 0 for name in ("left_um_s", "right_um_s", "seat", "flipper")), outputs["brake"])
    runs_on = z3.And(armed, after["cause"] == twin.ARMED)
    rearms = z3.And(latched, judged["cause"] == twin.ARMED)

    yield "a started box is sound", z3.BoolVal(True), is_sound(twin.started(0))
    yield "each message leaves a sound box sound", heard, is_sound(judged)
    yield "each tick leaves a sound box sound", ticked, is_sound(after)
    yield (
        "no set point exceeds its limit",
        ticked,
        z3.And(
            *(z3.And(belt <= 100 * box["speed"], belt >= -100 * box["speed"]) for belt in belts),
            outputs["seat"] <= box["seat_limit"],
            outputs["seat"] >= -box["seat_limit"],
            outputs["flipper"] <= box["flipper_limit"],
            outputs["flipper"] >= -box["flipper_limit"],
        ),
    )

    changes = [outputs[name] - box[name] for name in ("left_um_s", "right_um_s")]
    largest = box["acceleration"] * elapsed
    yield (
        "a set point of an armed box changes by acceleration times time at most",
        z3.And(ticked, runs_on),
        z3.And(*(z3.And(change <= largest, change >= -largest) for change in changes)),
    )
    yield "a tick ends no latched stop", z3.And(ticked, latched), after["cause"] == box["cause"]
    yield "a latched box stands, braked", z3.And(ticked, latched), stands
    yield (
        "a re-arm alone ends a latched stop: of the present stop, fresh, with limits, in time, and with no input against it",
        z3.And(heard, rearms),
        z3.And(
            message["kind"] == twin.REARM,
            message["latch"] == box["latch"],
            (box["now"] - message["stamp"]) % 2**32 < twin.WATCHDOG_MAX_MS,
            box["speed"] > 0,
            box["dead_man"],
            z3.Not(box["stop"]),
            box["drive_error"] == 0,
            box["held"] >= twin.HELD_MS,
            box["rearmed"] >= twin.AGAIN_MS,
        ),
    )
    yield "after a re-arm the belts stand until a command", z3.And(heard, rearms), z3.And(judged["left"] == 0, judged["right"] == 0)
    yield "the first cause of a stop stays", z3.And(heard, latched, z3.Not(rearms)), judged["cause"] == box["cause"]
    yield "a stop is obeyed from whomever, however old", z3.And(heard, message["kind"] == twin.STOP), judged["cause"] != twin.ARMED
    yield (
        "a second host stops an armed box",
        z3.And(heard, armed, message["sender"] != box["sender"]),
        judged["cause"] != twin.ARMED,
    )
    yield "a box whose newest command is older than the watchdog stands, braked", z3.And(ticked, age >= box["watchdog"]), stands
    yield "a box that was not called for the watchdog's time stands, braked", z3.And(ticked, elapsed >= box["watchdog"]), stands

    refusal = z3.Or(inputs["stop"], z3.Not(inputs["dead_man"]), inputs["drive_error"] != 0)
    yield "stop button, dead-man switch and drive errors act in the same tick", z3.And(ticked, refusal), stands
    other_key = z3.Or(box["dead_man"], after["released"] >= twin.RELEASED_MS)
    act = z3.And(inputs["rearm"], z3.Not(box["rearm"]), inputs["dead_man"], z3.Not(inputs["stop"]), other_key)
    yield (
        "a press counts if it is an act",
        z3.And(ticked, after["pressed"] == 0, box["pressed"] > 0),
        z3.And(act, latched, after["held"] >= twin.HELD_MS),
    )
    yield (
        "with a handset, a re-arm uses up a press of the last 0.3 s",
        z3.And(heard, rearms, box["handset"]),
        z3.And(box["pressed"] < twin.PRESS_MS, judged["pressed"] >= twin.PRESS_MS),
    )
    turns = z3.Or(*(z3.Or(inputs[name] > twin.TURNS, inputs[name] < -twin.TURNS) for name in ("left_belt", "right_belt")))
    lasts = z3.And(box["turns"], box["turned"] + elapsed >= twin.TURNS_MS, elapsed <= twin.WATCHDOG_MAX_MS)
    yield (
        "a belt that turns for 0.2 s although the box stands opens the contactor",
        z3.And(ticked, outputs["brake"], turns, lasts),
        z3.And(z3.Not(outputs["contactor"]), after["cause"] != twin.ARMED),
    )
    yield (
        "a re-arm alone closes the contactor",
        z3.And(heard, ticked, box["open"]),
        z3.And(z3.Not(outputs["contactor"]), z3.Or(judged["open"], judged["cause"] == twin.ARMED)),
    )
    yield (
        "no product of the C code leaves 32 bits",
        z3.And(ticked, runs_on),
        z3.And(box["acceleration"] * elapsed < 2**31 - 2 * 100 * 2**15, box["hold"] * elapsed < 2**31 - 2 * 100 * 2**15),
    )


def verdict(assumption: Any, claim: Any) -> tuple[str, str]:
    """Return ``proved``, ``sat`` or ``unknown`` for a theorem, and the counterexample or the reason."""
    solver = z3.Solver()
    solver.set("timeout", TIMEOUT_MS)
    solver.add(assumption, z3.Not(claim))
    found = solver.check()
    if found == z3.unsat:
        return "proved", ""
    return str(found), str(solver.model() if found == z3.sat else solver.reason_unknown())


def main() -> None:
    failed = 0
    for number, (name, assumption, claim) in enumerate(theorems(), start=1):
        answer, why = verdict(assumption, claim)
        print(f"{number:2d} {answer}: {name}\n{why}".strip(), flush=True)
        failed += answer != "proved"
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
