"""World file for gzserver: stair and chair in the common description, and the plugin that drives the tracks."""

from xml.etree.ElementTree import Element, tostring

from treadline.core.angles import DEG
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.sdf import sdf_world
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.start_pose import standing
from treadline.vehicle.xml_elements import child, text

SOLVER_TOLERANCE = 1e-3
"""Tolerance of ODE's solver (``sor_lcp_tolerance``), which ends its iterations: left and right turns stay mirror images, in half
the time (docs/gazebo.md)."""


def world_sdf(scenario: Scenario, staircase: Staircase, chair: ChairDescription, *, plugin: str, port: int) -> str:
    """Return the world of a scenario at its start.

    Args:
        plugin: File of the lock-step plugin, in gzserver's file system.
        port: Port of the plugin on the loopback interface.
    """
    start = standing(staircase, chair.tracks, scenario.start)
    element = plugin_sdf(chair, plugin=plugin, port=port, seat_rad=start.seat_rad)
    return sdf_world(staircase, chair, scenario.chair.leaning(), start=start, plugins=(element,), belts_on_bodies=True)


def plugin_sdf(chair: ChairDescription, *, plugin: str, port: int, seat_rad: float) -> str:
    """Return the ``<plugin>`` element of a chair."""
    element = Element("plugin", name="treadline", filename=plugin)
    child(element, "body", "chair")
    for side in ("left", "right"):
        # Both belts are parts of the same bodies; the plugin distinguishes them by the names of their shapes.
        child(element, f"{side}_track", "chair")
        if chair.flipper is not None:
            child(element, f"{side}_flipper", "flipper")
    child(element, "tracks_separation", text(chair.tracks.gauge_m))
    # Table I: 3.07 rad/s at ±1 m/s is the speed difference of the belts divided by the gauge.
    child(element, "steering_efficiency", "1")
    child(element, "max_linear_speed", text(chair.drives.max_speed_m_s))
    child(element, "solver_tolerance", text(SOLVER_TOLERANCE))
    # Placeholder, set before the first step: the plugin can only modify existing elements.
    child(element, "track_mu", "1")
    child(element, "track_mu2", "1")
    child(element, "seat_start", text(seat_rad))
    if chair.flipper is not None:
        child(element, "flipper_start", text(chair.tracks.approach_angle_deg * DEG))
        child(element, "flipper_torque", text(chair.flipper.torque_n_m))
    child(element, "port", str(port))
    return tostring(element, encoding="unicode")
