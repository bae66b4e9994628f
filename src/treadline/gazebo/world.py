"""The world that gzserver loads: the stair and the chair as every simulator gets them, and the plugin that drives the tracks."""

from xml.etree.ElementTree import Element, tostring

from treadline.angles import DEG
from treadline.mechanics.bodies import standing
from treadline.mechanics.chair import ChairDescription
from treadline.mechanics.formats import sdf_world
from treadline.mechanics.formats.elements import child, text
from treadline.mechanics.staircase import Staircase
from treadline.scenario import Scenario

SOLVER_TOLERANCE = 1e-3
"""Of ODE's solver (``sor_lcp_tolerance``), which ends its iterations: turns mirror each other as without, in half the time
(docs/gazebo.md)."""


def world_sdf(scenario: Scenario, staircase: Staircase, chair: ChairDescription, *, plugin: str, port: int) -> str:
    """Return a scenario at its start.

    Args:
        plugin: File of the lock-step plugin, as gzserver finds it.
        port: On which it listens, on the loopback alone.
    """
    start = standing(staircase, chair.tracks, scenario.start)
    element = plugin_sdf(chair, plugin=plugin, port=port, seat_rad=start.seat_rad)
    return sdf_world(staircase, chair, scenario.chair.leaning(), start=start, plugins=(element,), is_whole=True)


def plugin_sdf(chair: ChairDescription, *, plugin: str, port: int, seat_rad: float) -> str:
    """Return the ``<plugin>`` of a chair."""
    element = Element("plugin", name="treadline", filename=plugin)
    child(element, "body", "chair")
    for side in ("left", "right"):
        # Both belts are parts of the same bodies; the plugin tells them apart by the names of their shapes.
        child(element, f"{side}_track", "chair")
        if chair.flipper is not None:
            child(element, f"{side}_flipper", "flipper")
    child(element, "tracks_separation", text(chair.tracks.gauge_m))
    # Table I: 3.07 rad/s at ±1 m/s are the belts' difference over the gauge.
    child(element, "steering_efficiency", "1")
    child(element, "max_linear_speed", text(chair.drives.max_speed_m_s))
    child(element, "solver_tolerance", text(SOLVER_TOLERANCE))
    # Set anew before the first step: the plugin can only change what is there.
    child(element, "track_mu", "1")
    child(element, "track_mu2", "1")
    child(element, "seat_start", text(seat_rad))
    if chair.flipper is not None:
        child(element, "flipper_start", text(chair.tracks.approach_angle_deg * DEG))
        child(element, "flipper_torque", text(chair.flipper.torque_n_m))
    child(element, "port", str(port))
    return tostring(element, encoding="unicode")
