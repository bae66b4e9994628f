"""Memory of the firmware's rules (``tl_rules``), read from a box and compared with the twin's."""

import ctypes
import random
import shutil
from typing import Any

import firmware_twin as twin

from treadline.hardware._frame import HostMessage, Kind
from treadline.hardware.emulators._firmware import DriveBox, Inputs, Outputs

HAS_COMPILER = any(map(shutil.which, ("cc", "gcc", "clang")))
"""Whether the firmware can be compiled here."""


class Rules(ctypes.Structure):
    """``tl_rules``, at the beginning of a box."""

    _fields_ = [
        ("now", ctypes.c_uint32),
        ("heard", ctypes.c_uint32),
        ("sender", ctypes.c_uint16),
        ("sequence", ctypes.c_uint16),
        ("latch", ctypes.c_uint16),
        ("cause", ctypes.c_int),
        ("reply", ctypes.c_int),
        ("rejections", ctypes.c_uint16),
        *((name, ctypes.c_uint16) for name in twin.AGES),
        *((name, ctypes.c_bool) for name in ("turns", "open", "drives")),
        *((name, ctypes.c_int16) for name in (*twin.JOINTS, *twin.LIMIT_NAMES)),
        ("left_um_s", ctypes.c_int32),
        ("right_um_s", ctypes.c_int32),
        *((name, ctypes.c_bool) for name in ("dead_man", "stop", "handset", "rearm")),
        ("drive_error", ctypes.c_uint16),
        ("left_belt", ctypes.c_int16),
        ("right_belt", ctypes.c_int16),
    ]


NAMES = tuple(name for name, _ in Rules._fields_)


def memory_of(box: DriveBox) -> twin.Values:
    """Return the memory of a box under the twin's names."""
    rules = Rules.from_buffer(box.memory)
    return {name: getattr(rules, name) for name in NAMES}


def outputs_of(outputs: Outputs) -> twin.Values:
    """Return the outputs of a tick under the twin's names."""
    left, right = outputs.belts_um_s
    names = ("seat", "flipper", "brake", "contactor")
    return {"left_um_s": left, "right_um_s": right, **{name: getattr(outputs, name) for name in names}}


def given_to(box: DriveBox, now_ms: int, inputs: dict[str, Any]) -> twin.Values:
    """Return the outputs of a tick with the twin's inputs."""
    belts = (inputs["left_belt"], inputs["right_belt"])
    switches = {name: value for name, value in inputs.items() if not name.endswith("belt")}
    return outputs_of(box.tick(now_ms, Inputs(**switches, belts=belts)))


class Traffic:
    """Random messages and inputs: mostly a sound host, with everything that can be wrong with one."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._sequence = 0
        self._handset, self._button, self._belts, self._away = seed % 2 == 1, False, (0, 0), 0
        self._motion = twin.DRIVE

    def message(self, box: twin.Values) -> dict[str, Any]:
        """Return a message to a box in this state."""
        draw, rare = self._random, self._random.random
        armed = box["cause"] == twin.ARMED
        self._motion = self._motion if rare() < 0.97 else draw.choice((twin.DRIVE, twin.HOLD))
        kind = self._motion if armed else twin.REARM if box["speed"] else twin.LIMITS
        kind = kind if rare() < 0.97 else draw.randint(1, 5)
        self._sequence += 1 if rare() < 0.97 else draw.randint(-3, 40000)
        late = draw.randint(0, 60) if rare() < 0.97 else draw.randint(-200, 2**31)
        return {
            "kind": kind,
            "sender": 7 if rare() < 0.998 else draw.randint(6, 8),
            "sequence": self._sequence % 2**16,
            "stamp": (box["now"] - late) % 2**32,
            "latch": box["latch"] if rare() < 0.9 else draw.randint(0, 2**16 - 1),
            "values": self._values(kind, box),
        }

    def _values(self, kind: int, box: twin.Values) -> list[int]:
        """Return limits, or speeds at, within and beyond them."""
        draw = self._random
        if draw.random() < 0.02:
            return [draw.randint(-(2**15), 2**15 - 1) for _ in range(6)]
        if kind == twin.LIMITS:
            hold, watchdog = draw.randint(1, 4000), draw.choice((100, 100, draw.randint(1, 100)))
            return [draw.randint(1, 32767), draw.randint(hold, 32767), hold, watchdog, draw.randint(0, 900), 500]
        bounds = (box["speed"], box["speed"], box["seat_limit"], box["flipper_limit"])
        return [draw.choice((bound, -bound, draw.randint(-bound, bound))) for bound in bounds] + [0, 0]

    def inputs(self) -> dict[str, Any]:
        """Return what the box senses, now and then a switch or an error."""
        rare, draw = self._random.random, self._random
        self._button = self._button if rare() < 0.7 else not self._button
        if rare() < 0.05:  # a belt turns for long enough, and a switch stays released for long enough, to matter
            fast = (draw.choice((500, 501, 2**15 - 1)), draw.choice((0, -501, -(2**15))))
            self._belts = fast if rare() < 0.2 else (0, 0)
        self._away = max(self._away - 1, 0) if rare() < 0.998 else draw.randint(1, 120)
        switches = {"dead_man": self._away == 0, "stop": rare() < 0.002, "handset": self._handset, "rearm": self._button}
        belts = dict(zip(("left_belt", "right_belt"), self._belts, strict=True))
        return switches | belts | {"drive_error": 0 if rare() < 0.998 else 17}

    def elapsed_ms(self) -> int:
        """Return the time to the next tick [ms]: mostly up to 20, now and then anything, a clock set back included."""
        rare = self._random.random()
        return self._random.randint(*((0, 20) if rare < 0.996 else (-100, 200) if rare < 0.998 else (0, 2**32 - 1)))


def first_difference(seed: int, ticks: int) -> str | None:
    """Return where firmware and twin differ first on random traffic; None if they never do."""
    traffic, box, model, now = Traffic(seed), DriveBox(), twin.started(), 0
    for number in range(ticks):
        message = traffic.message(model)
        fields = {"kind": Kind(message["kind"]), "stamp_ms": message["stamp"], "values": tuple(message["values"])}
        box.receive(HostMessage(**fields, **{name: message[name] for name in ("sender", "sequence", "latch")}).frame())
        model = twin.received(model, message)
        now = (now + traffic.elapsed_ms()) % 2**32
        inputs = traffic.inputs()
        outputs = given_to(box, now, inputs)
        model, wanted = twin.ticked(model, now, inputs)
        if memory_of(box) != model or outputs != wanted:
            changed = {name: (value, model[name]) for name, value in memory_of(box).items() if value != model[name]}
            return f"seed {seed}, tick {number}: {message}, {inputs}: {changed}, outputs {outputs} and {wanted}"
    return None
