"""Terms of the player page, as its tooltips and its legend explain them; the full list is docs/glossary.md."""

TERMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "nosing": ("front edge of a step's tread; the edge that the belts rest on. Nosings are counted from 1 at the lowest step.", ()),
    "missed nosing": (
        "true nosing between two perceived ones, or with riser and tread in the camera image and no farther than the farthest "
        "perceived one, that the detector did not report.",
        ("missed",),
    ),
    "flipper": ("driven section of the belts ahead of the front pulley; it can be raised and lowered.", ()),
    "heading": (
        "rotation of the chair about the normal of the stair [°]; 0° is square to the nosings, positive is anticlockwise from "
        "above.",
        ("heading",),
    ),
    "estimate ± 2 σ": (
        "heading from camera and gyro with its interval of two standard deviations; if the error model holds, the true heading "
        "lies in it 95 % of the time.",
        ("estimate ± 2 σ", "estimated heading ± 2 σ"),
    ),
    "ground truth": ("value known to the simulator; the chair itself does not have it.", ("true", "true heading", "true nosing")),
    "perceived": ("measured by the chair's own camera.", ("nosing as perceived",)),
    "guard": ("monitor that slows the chair or holds it, brakes applied, when a limit is exceeded or a signal is lost.", ()),
    "hold": ("the guard has stopped the chair and applied its brakes; only a person can re-arm it.", ()),
    "traction test, test pulse": (
        "short drive of the belts on the first two nosings; the share of the belts' travel that the chair does not follow shows "
        "whether there is enough friction to climb.",
        (),
    ),
    "slip": (
        "share of the belts' travel that the chair does not follow: 0 is none, 1 means that the belts run and the chair stands.",
        (),
    ),
    "roll-back": ("distance that the chair has slid down the flight [m].", ()),
    "friction use": (
        "friction that the slope and the heading need, as a share of the friction there is; the chair slides at 100 %.",
        (),
    ),
    "tip-over margin": (
        "angle by which the chair could still tilt before it tips over [°], in the direction in which it would tip first.",
        ("tip-over margin",),
    ),
    "pitch": (
        "elevation of the front above horizontal [°]; on the flight it is the slope.",
        ("pitch rate", "seat and chassis pitch"),
    ),
    "asked": ("speed commanded to a belt; the solid curves are the actual speeds.", ("left asked", "right asked")),
}
"""Explanation of each term, and the labels of the page that carry it as a tooltip."""
PHASES: dict[str, str] = {
    "search": "the chair stands or turns until it perceives a stair",
    "align": "the chair turns until it is square to the stair",
    "approach": "the chair drives to the stair",
    "mount": "the front of the belts climbs the first nosings",
    "traction": "traction test: a pulse of the belts shows whether there is enough friction",
    "climb": "the chair climbs the flight",
    "crest": "from the recognition of the flight's end until the flipper's tip carries the chair on the landing",
    "land": "the chair drives clear of the last nosing",
    "edge": "the chair presses its flipper down and backs over the top edge",
    "descend": "the chair descends the flight",
    "leave": "the chair leaves the flight at its foot",
    "back_off": "the chair drives back from the stair",
    "arrived": "the chair stands level beyond the flight",
    "refused": "the stair was rejected",
}
"""Explanation of each phase of a traversal."""
