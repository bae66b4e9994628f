"""Groups of the traversal's phases, for the rules of the guard."""

FLIGHT = ("drive", "climb", "descend")
"""Phases on the flight; the cruise limit holds instead of the planned speed, because steering adds to the mean."""
TIPPING = ("crest", "edge")
"""Phases on one nosing and the flipper's tip; without a measured pitch the chair must stop at once."""
OVER = (*TIPPING, "land", "leave")
"""Phases from the end of the flight to flat ground, with no stair in view."""
PITCHING = ("mount", *TIPPING, "leave")
"""Phases in which the chair pitches; the mean belt speed stays low even during a turn."""
STEADY = ("search", "align", "approach", *FLIGHT)
"""Phases with constant pitch; a seat near horizontal moves slowly."""
ENDS = ("arrived", "refused")
"""Final phases."""
