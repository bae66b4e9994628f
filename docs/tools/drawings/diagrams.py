"""Two drawings that are boxes and arrows: the control scheme (Fig. 2) and the graph of nodes (Fig. 7)."""

from matplotlib.figure import Figure

from drawings.pen import AMBER, Pen, sheet
from treadline.report.svg_figures import BLUE, GREEN, GREY, RED

SENSOR, BLOCK, GUARD, PLANT, LEARN = "#e5f1f8", "#ffffff", "#fbe6da", "#e3f2ec", "#fdf3dc"
BOX = (2.3, 1.0)


def scheme() -> Figure:
    """Return Fig. 2: from sensors to belts and seat, and where the controller comes from."""
    figure, (pen,) = sheet(9.0, 5.0)
    pen.frame((0.0, 14.4), (0.0, 8.0))
    _learning(pen)
    pen.box((1.5, 4.6), BOX, "RGB-D camera", "10 Hz", SENSOR)
    pen.box((1.5, 2.9), BOX, "IMU", "100 Hz", SENSOR)
    pen.box((1.5, 1.2), BOX, "seat IMU", "100 Hz", SENSOR)
    pen.box((4.9, 4.6), BOX, "stair vision", "perception", BLOCK)
    pen.box((4.9, 2.9), BOX, "heading filter", "estimation", BLOCK)
    pen.box((4.9, 1.2), BOX, "seat leveller", "seat", BLOCK)
    pen.box((8.3, 2.9), BOX, "heading control", "control, 4 Hz", BLOCK)
    pen.box((11.1, 2.05), (1.5, 2.7), "guard", "mission", GUARD)
    pen.box((13.25, 2.05), (1.7, 2.7), "tracks\nand seat", "", PLANT)
    for y in (4.6, 2.9, 1.2):
        pen.arrow((2.65, y), (3.75, y))
    pen.text((3.2, 4.9), "frame", size=9.0)
    pen.text((3.2, 2.62), "γ, ω", size=9.0)
    pen.arrow((2.65, 3.2), (3.75, 4.3))
    pen.text((3.3, 3.62), "gravity", size=9.0, align="left")
    pen.text((3.2, 1.5), "pitch", size=9.0)
    pen.arrow((4.9, 4.1), (4.9, 3.4))
    pen.text((5.15, 3.75), "θ seen", size=9.0, align="left")
    pen.arrow((6.05, 2.9), (7.15, 2.9))
    pen.text((6.6, 3.2), "θ, ω", size=9.0)
    pen.arrow((9.45, 2.9), (10.35, 2.9))
    pen.text((9.9, 3.22), "u₁, u₂", size=9.0)
    pen.arrow((6.05, 1.2), (10.35, 1.2))
    pen.arrow((11.85, 1.2), (12.4, 1.2))
    pen.text((8.1, 1.5), "actuator rate", size=9.0)
    pen.arrow((11.85, 2.9), (12.4, 2.9))
    pen.line([(13.25, 0.7), (13.25, 0.25), (0.15, 0.25), (0.15, 4.6)], GREY)
    for y in (4.6, 2.9, 1.2):
        pen.arrow((0.15, y), (0.35, y), GREY)
    pen.text((6.7, 0.25), "the chair moves, the stair passes", size=9.0, colour=GREY)
    return figure


def _learning(pen: Pen) -> None:
    y = 6.9
    pen.text((0.35, 7.75), "once, before driving", size=9.5, colour=AMBER, align="left")
    names = (
        (1.5, "random speeds", "excitation"),
        (4.9, "OKID", "impulse response"),
        (8.3, "ERA", "A, B, C, D"),
        (11.7, "LQR", "gain K"),
    )
    for x, words, below in names:
        pen.box((x, y), BOX, words, below, LEARN)
    for x in (2.65, 6.05, 9.45):
        pen.arrow((x, y), (x + 1.1, y), AMBER)
    pen.text((3.2, y + 0.3), "u, y", size=9.0, colour=AMBER)
    pen.line([(11.7, 6.4), (11.7, 5.2), (8.3, 5.2)], AMBER)
    pen.arrow((8.3, 5.2), (8.3, 3.4), AMBER)
    pen.text((10.0, 5.2), "model and gain, one JSON file", size=9.0, colour=AMBER)


def nodes() -> Figure:
    """Return Fig. 7: the nodes, and the topics under which their signals are logged."""
    figure, (pen,) = sheet(9.0, 4.6)
    pen.frame((0.0, 14.4), (0.0, 7.36))
    size = (2.7, 1.25)
    pen.oval((1.75, 3.7), size, "plant", "sim", PLANT)
    pen.oval((6.2, 6.2), size, "stair detector", "perception", BLOCK)
    pen.oval((6.2, 3.7), size, "heading filter", "estimation", BLOCK)
    pen.oval((6.2, 1.2), size, "seat leveller", "seat", BLOCK)
    pen.oval((10.4, 3.7), size, "heading control", "control", BLOCK)
    pen.oval((12.6, 1.2), size, "guard", "mission", GUARD)
    pen.arrow((2.4, 4.3), (4.95, 5.95), BLUE)
    pen.text((3.4, 5.45), "/camera/color, /camera/depth, /imu", size=9.0, colour=BLUE)
    pen.arrow((3.1, 3.7), (4.85, 3.7), BLUE)
    pen.text((3.95, 4.0), "/imu", size=9.0, colour=BLUE)
    pen.arrow((2.4, 3.1), (4.95, 1.45), BLUE)
    pen.text((3.75, 2.25), "/seat/state", size=9.0, colour=BLUE)
    pen.arrow((6.2, 5.57), (6.2, 4.33), GREEN)
    pen.text((6.35, 4.95), "/stair/heading_measured", size=9.0, colour=GREEN, align="left")
    pen.arrow((7.55, 3.7), (9.05, 3.7), GREEN)
    pen.text((8.3, 4.0), "/stair/heading", size=9.0, colour=GREEN)
    pen.arrow((10.9, 3.1), (12.1, 1.8), RED)
    pen.text((12.35, 2.6), "speeds asked", size=9.0, colour=RED)
    pen.line([(12.6, 0.57), (12.6, 0.15), (1.55, 0.15)], RED)
    pen.arrow((1.55, 0.15), (1.55, 3.07), RED)
    pen.text((9.4, 0.15), "/tracks/cmd", size=9.0, colour=RED)
    pen.line([(4.85, 1.2), (1.95, 1.2)], RED)
    pen.arrow((1.95, 1.2), (1.95, 3.07), RED)
    pen.text((3.3, 1.2), "/seat/cmd", size=9.0, colour=RED)
    return figure
