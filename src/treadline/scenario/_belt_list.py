"""A vehicle written as a list of belt sections alone: its main section and its front one as ``[tracks]`` and ``[flipper]``.

``tables of a file -> tables with tracks``. The rest of the program knows one form.
"""

import math
from collections.abc import Mapping
from typing import Any

MAIN = "main"
"""Name of the section that is the flat run."""
APART_M = 1e-6
"""Distance up to which two axes in a file are one [m]: its digits are fewer than those of a number."""
OWN_KEYS = {"name", "start_m", "end_m", "radii_m", "gauge_m", "width_m"}


def short_form(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a vehicle with its main section and the one that begins at its front axis as the short form.

    Raises:
        ValueError: If the list has no such sections, or they are none that ``[tracks]`` can describe.
    """
    belts = [dict(section) for section in tables["belt"]]
    main = next((section for section in belts if section.get("name") == MAIN), None)
    if main is None:
        raise ValueError("give [tracks], or a [[belt]] named 'main': the flat run from its rear to its front axis")
    try:
        return _with_tracks(tables, main, [section for section in belts if section is not main])
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(
            f"belt 'main' and the front one have start_m, end_m, radii_m, gauge_m, width_m; {error} is missing"
        ) from None


def _with_tracks(tables: Mapping[str, Any], main: dict[str, Any], others: list[dict[str, Any]]) -> dict[str, Any]:
    (rear_m, _), (front_m, up_m), radius_m = main["start_m"], main["end_m"], main["radii_m"][1]
    _expect(
        "main", main, {"start_m": [-front_m, radius_m], "end_m": [front_m, radius_m], "radii_m": [radius_m, radius_m]}, OWN_KEYS
    )
    front = next((section for section in others if math.dist(section["start_m"], main["end_m"]) < APART_M), None)
    if front is None:
        raise ValueError(
            f"no [[belt]] begins at the front axis of 'main', at [{front_m:g}, {up_m:g}]; give the section ahead there"
        )
    (end_m, end_up_m), name, flipper = front["end_m"], front["name"], front.get("flipper")
    built_rad = math.atan2(end_up_m - up_m, end_m - front_m)
    same = {key: main[key] for key in ("gauge_m", "width_m") if key in front}
    in_line = {} if flipper is None else {"end_m": [end_m, up_m]}
    _expect(name, front, {"radii_m": [radius_m, front["radii_m"][1]]} | same | in_line, {*OWN_KEYS, "angle_deg", "flipper"})
    tracks = {
        "flat_run_m": front_m - rear_m,
        "approach_m": math.dist(front["start_m"], front["end_m"]),
        "approach_angle_deg": math.degrees(built_rad) + front.get("angle_deg", 0.0),
        "pulley_radius_m": radius_m,
        "nose_radius_m": None if abs(front["radii_m"][1] - radius_m) < APART_M else front["radii_m"][1],
        "gauge_m": main["gauge_m"],
        "belt_width_m": main["width_m"],
    }
    further = tuple(section for section in others if section is not front)
    return {**tables, "tracks": tracks, "belt": further} | ({} if flipper is None else {"flipper": flipper})


def _expect(name: str, section: Mapping[str, Any], wanted: Mapping[str, Any], known: set[str]) -> None:
    """Refuse a section that is not as ``[tracks]`` has it.

    Raises:
        ValueError: If it is not.
    """
    if unknown := sorted(section.keys() - known):
        raise ValueError(f"belt '{name}': {unknown[0]} is no key of this section, which is part of the tracks; leave it out")
    for key, value in wanted.items():
        given, expected = (list(item) if isinstance(item, (list, tuple)) else [item] for item in (section[key], value))
        if math.dist(given, expected) > APART_M:
            raise ValueError(f"belt '{name}': {key} is {given}; the tracks stand on the floor about B's origin and need {expected}")
