"""A traversal's phases, as the guard groups them."""

FLIGHT = ("drive", "climb", "descend")
"""On the flight itself: there the cruise limit holds, whatever the plan's speed, for steering adds to the mean."""
TIPPING = ("crest", "edge")
"""On one nosing and the flipper's tip: a chair that does not know its pitch there must stand at once."""
OVER = (*TIPPING, "land", "leave")
"""From the flight's end to the level: no stair is in view."""
PITCHING = ("mount", *TIPPING, "leave")
"""The chair pitches; there steering gives way to a slow mean even while it turns."""
STEADY = ("search", "align", "approach", *FLIGHT)
"""The chair keeps its pitch: its seat, once level, needs no haste."""
ENDS = ("arrived", "refused")
