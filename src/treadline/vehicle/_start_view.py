"""View of the stair from the start pose, a part of the verdict: ``Scenario, ChairDescription -> nosings in view, problem``.

Nosings are projected into the camera that faces the direction of travel. The rendered and the statistical camera share this
geometry, and so does ``vision = "truth"``; an open loop uses no camera.
"""

from collections.abc import Callable

from treadline.scenario.chair import CameraMount, ChairDescription
from treadline.scenario.scenario import Scenario, Start
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.start_pose import LANDING_SPARE_M, from_edge_m, length_m, standing
from treadline.vehicle.visibility import Geometry, least_nosings

FURTHER_M = [0.01 * cm for cm in range(101)]
"""Distances from the edge of a landing that are tried for the remedy, beyond the present one [m]."""
PITCHES_DEG = range(-90, 91, 5)
"""Mount pitches that are tried for the remedy [°]."""


class StartView:
    """Nosings that the camera of one scenario resolves from a start.

    Args:
        mount: Mount of the camera that faces the direction of travel.
    """

    def __init__(self, scenario: Scenario, chair: ChairDescription, staircase: Staircase, mount: CameraMount) -> None:
        self._scenario, self._chair, self._staircase, self._mount = scenario, chair, staircase, mount
        self._least = least_nosings(staircase)
        self._is_up = scenario.drive.direction == "up"
        self._name = "camera" if self._is_up else "rear_camera"
        mounted = chair.model_copy(update={self._name: mount})
        self._geometry = Geometry(staircase, mounted.camera_at(scenario.sensors.rows_px, rear=not self._is_up))

    def nosings(self, start: Start) -> int:
        """Return the number of nosings in the image and within the depth range of the sensor; 0 where fewer than two are.

        On floor and landing the chair turns on the spot to find the stair: the better of start heading and square counts.
        """
        square = start if start.place == "flight" else start.model_copy(update={"heading_deg": 0.0})
        here, turned = (standing(self._staircase, self._chair.tracks, pose) for pose in (start, square))
        views = (self._geometry.visibility(R_WB, here.p_WB) for R_WB in (here.R_WB, turned.R_WB))
        ahead = (view for view in views if view is not None and view.direction == self._scenario.drive.direction)
        count = max((int(view.seen.sum()) for view in ahead), default=0)
        return count if count >= self._least else 0

    def problem(self, fits: Callable[[Start], bool]) -> str | None:
        """Return why the run would find no stair, with a remedy, or None.

        Args:
            fits: Whether the chair can stand at a start.
        """
        hidden = self._hidden_edge()
        if hidden is not None or self.detects(self._scenario.start):
            return hidden
        few = "no nosing is" if self._least == 1 else f"fewer than {self._least} nosings are"
        lacking = f"{few} in view of the {self._name.replace('_', ' ')} from the start"
        return f"{lacking}, too few to detect a stair; {self._step_remedy(fits) or self._mount_remedy()}"

    def _hidden_edge(self) -> str | None:
        """Return by how much to move a chair on a landing whose edge is hidden under the camera; None if it never is in view."""
        further_m = next((cm for cm in FURTHER_M if self._shows_edge(self._scenario.start, cm)), None)
        if not further_m:
            return None
        tracks, stair = self._chair.tracks, self._scenario.stair
        from_m, needs_m = from_edge_m(stair, tracks), length_m(stair, tracks) + LANDING_SPARE_M + further_m
        hidden = f"the edge, {from_m:.2f} m behind the belts, is hidden under the rear camera"
        return f"{hidden}; set the chair {further_m:.2f} m further from it, on a landing of {from_m + needs_m:.2f} m"

    def _shows_edge(self, start: Start, further_m: float = 0.0) -> bool:
        """Return whether a square chair on the landing has its edge or the nosing after it in view, or none is needed.

        Args:
            further_m: Distance by which the chair stands further from the edge.
        """
        if self._is_up or start.place != "landing":
            return True
        square = standing(self._staircase, self._chair.tracks, start.model_copy(update={"heading_deg": 0.0}))
        view = self._geometry.visibility(square.R_WB, square.p_WB + further_m * square.R_WB[:, 0])
        edge = self._staircase.steps[-1].index
        return view is not None and view.direction == "down" and int(view.numbers[view.seen].max(initial=-1)) >= edge - 1

    def detects(self, start: Start) -> bool:
        """Return whether enough nosings are in view from a start, the edge of its landing among them."""
        return self.nosings(start) > 0 and self._shows_edge(start)

    def _step_remedy(self, fits: Callable[[Start], bool]) -> str | None:
        """Return the nearest step for a start on the flight from which the stair is in view."""
        start = self._scenario.start
        if start.place != "flight":
            return None
        steps = range(start.step - 1, -1, -1) if self._is_up else range(start.step + 1, self._scenario.stair.steps)
        starts = (start.model_copy(update={"step": step}) for step in steps)
        other = next((there for there in starts if fits(there) and self.detects(there)), None)
        return None if other is None else f"start at step {other.step} or {'below' if self._is_up else 'above'}"

    def _mount_remedy(self) -> str:
        """Return the mount pitches, next to the present one, from which the stair is in view."""
        present_deg = self._mount.pitch_deg
        mounts = {pitch: self._mount.model_copy(update={"pitch_deg": pitch}) for pitch in PITCHES_DEG}
        views = {pitch: StartView(self._scenario, self._chair, self._staircase, mount) for pitch, mount in mounts.items()}
        seen = [pitch for pitch, view in views.items() if view.detects(self._scenario.start)]
        if not seen:
            return f"no pitch of its mount would do: correct {self._name}.position_m, yaw_deg and roll_deg in the chair's file"
        nearest = min(seen, key=lambda pitch: abs(pitch - present_deg))
        low, high = (_end_of(seen, nearest, step) for step in (-PITCHES_DEG.step, PITCHES_DEG.step))
        return f"{self._name}.pitch_deg is {present_deg:g} in the chair's file: give {low} to {high}"


def _end_of(values: list[int], value: int, step: int) -> int:
    """Return the last of the values without a gap from one of them on."""
    return _end_of(values, value + step, step) if value + step in values else value
