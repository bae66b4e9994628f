"""The page of the box at the drives says what the code does: byte tables, test vector, theorems."""

import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest

from treadline.hardware._frame import HOST, STATE, BoxState, HostMessage, Kind

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "firmware.md").read_text(encoding="utf-8")
TYPES = {"B": "u8", "H": "u16", "h": "i16", "I": "u32", "i": "i32"}
HEAD = ["version", "kind", "length"]
SENT = [*HEAD, "sender", "sequence", "stamp", "latch", "values"]
RECEIVED = [*HEAD, *BoxState.__slots__]


def rows(layout: struct.Struct, names: list[str], counts: dict[str, int]) -> Iterator[str]:
    """Yield the beginning of each row of a byte table."""
    letters = iter("".join(letter * int(count or 1) for count, letter in runs(layout.format)))
    place = 0
    for name in names:
        count = counts.get(name, 1)
        letter, *_ = islice(letters, count)
        yield f"| {place} | {f'{count} × ' if count > 1 else ''}{TYPES[letter]} | {name} |"
        place += count * struct.calcsize(f"<{letter}")
    assert place == layout.size


def runs(layout: str) -> Iterator[tuple[str, str]]:
    """Yield count and letter of each part of a layout."""
    count = ""
    for letter in layout.removeprefix("<"):
        if letter.isdigit():
            count += letter
        else:
            yield count, letter
            count = ""


def test_byte_tables_are_those_of_the_code() -> None:
    wide = {
        "limits": 6,
        "set_points_um_s": 2,
        "belts": 2,
        "orientation": 4,
        "rates": 3,
        "accelerations": 3,
        "seat": 2,
        "flipper": 2,
    }
    wanted = [*rows(HOST, SENT, {"values": 6}), *rows(STATE, RECEIVED, wide | {"limits": 6, "orientation": 4})]
    assert [row for row in wanted if row not in PAGE] == []


def test_the_test_vector_is_the_frame_of_the_code() -> None:
    message = HostMessage(kind=Kind.DRIVE, sender=7, sequence=1, stamp_ms=1000, values=(2000, -2000, 0, 0, 0, 0))
    assert message.frame().hex(" ") in PAGE


def test_theorems_are_those_that_are_proved() -> None:
    pytest.importorskip("z3", reason="z3-solver is not installed")
    from firmware_proof import theorems

    listed = [f"{number}. {name[0].upper()}{name[1:]}." for number, (name, _, _) in enumerate(theorems(), start=1)]
    assert [theorem for theorem in listed if theorem not in PAGE] == []
