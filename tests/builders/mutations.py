"""Hostile bytes in place of those of a sound file or message."""

import struct

import numpy as np

FLOATS = (1e38, -1e38, float("nan"), float("inf"), 3.3e-43, 0.0, -1.0)
PATTERNS = [struct.pack(f"<{kind}", value) for kind in "fd" for value in FLOATS]
PATTERNS += [b"\0", b"\x80", b"\xff", b"\xff\xff\xff\0", b"\xff" * 7 + b"\0", b"\x7f\xff\xff\xff", b"\0" * 8]


def lengthened(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with 20,000 times one more: what takes a time that grows faster than the file."""
    place = int(rng.integers(0, len(data) + 1))
    return data[:place] + bytes(rng.choice([*b'[("-0, \t'], 1).tolist()) * 20_000 + data[place:]


def mutated_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes cut off, lengthened, or with one to three places overwritten by hostile numbers; headers stand in front."""
    if rng.random() < 0.1:
        return data[: int(rng.integers(len(data) + 1))]
    if rng.random() < 0.1:
        return lengthened(data, rng)
    changed = bytearray(data)
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        pattern = PATTERNS[int(rng.integers(len(PATTERNS)))] if rng.random() < 0.7 else rng.bytes(1)
        place = int(rng.integers(max(1, min(len(data), 800) if rng.random() < 0.3 else len(data))))
        place -= place % 4 if rng.random() < 0.5 else 0
        changed[place : place + len(pattern)] = pattern
    return bytes(changed[: len(data)])
