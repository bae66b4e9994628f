"""Colours of chair, person and stair: light, and distinguishable with colour-blindness (Okabe and Ito, 2008)."""

Colour = tuple[float, float, float]
"""Red, green and blue, each 0 to 1."""


def _rgb(code: int) -> Colour:
    """Return a colour of the form 0xRRGGBB."""
    return (code >> 16) / 255.0, (code >> 8 & 0xFF) / 255.0, (code & 0xFF) / 255.0


FRAME = _rgb(0xA9B4C0)
COVER = _rgb(0xE8ECEF)
BATTERY = _rgb(0x4A5A6A)
DRIVE = _rgb(0x6E7A86)
BELT = _rgb(0x30343A)
LUG = _rgb(0x555B63)
WHEEL = _rgb(0xC9CFD6)
FLIPPER = _rgb(0xE69F00)
LINKAGE = _rgb(0xD55E00)
RAIL = _rgb(0x009E73)
SEAT_FRAME = _rgb(0x7C8894)
CUSHION = _rgb(0x0072B2)
CAMERA = _rgb(0x222831)
LENS = _rgb(0x56B4E9)
SKIN = _rgb(0xE3B896)
SHIRT = _rgb(0xCC79A7)
TROUSERS = _rgb(0x5B6B8C)
SHOES = _rgb(0x3B3F46)
HAIR = _rgb(0x5A4636)
PAYLOAD = _rgb(0xF0C987)
TREAD = _rgb(0xE6E2DA)
RISER = _rgb(0xC8C3B9)
LANDING = _rgb(0xDCD8CF)
FLOOR = _rgb(0xD2D6D9)
WALL = _rgb(0xEFEDE8)
NOSING = _rgb(0xF0E442)
SEEN_NOSING = _rgb(0x009E73)
OBSTACLE = _rgb(0xD55E00)
