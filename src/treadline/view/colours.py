"""Colours of the scene, which its legend names."""

GOOD, WARN, BAD = (0, 158, 115), (230, 159, 0), (213, 94, 0)
"""Colours of a value within its limit, near it and beyond (Okabe and Ito, 2008)."""
TRUE, SEEN, MISSED, GHOST = (0, 114, 178), (220, 40, 180), (213, 94, 0), (86, 180, 233)
"""Colours of true, perceived and missed nosings, and of the ghost."""
TREAD, RISER = (70, 150, 255), (255, 150, 50)
"""Colours of detected treads and risers, as in the camera image."""
CONTACT = (60, 60, 160)
"""Colour of contact forces."""
SWEPT = (150, 110, 200)
"""Colour of the swept volume: violet, which nothing else of the scene has."""
