"""One resolved run: scenario, chair and controller, each read once, and everything that follows from them.

``resolve(scenario, controller, seed) -> Setup``. Command line, experiments, nodes, campaigns and the Python interface start here.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from treadline.core.errors import SettingsError
from treadline.core.models import ControllerDesign, LinearModel
from treadline.core.ports import Plant
from treadline.core.turning import check_turns
from treadline.mission.belt_controllers import Driver
from treadline.mission.loop import Blocks
from treadline.mission.mission_blocks import build_blocks
from treadline.mission.mission_config import (
    ControllerPlugin,
    DetectorPlugin,
    EstimatorPlugin,
    KnownLandings,
    KnownSill,
    MissionConfig,
    Plugins,
    is_full_traversal,
    source_of_plugin,
)
from treadline.mission.plugins import checked_plugin, load_plugin
from treadline.run.verdict import CheckReport, check
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario, read_scenario
from treadline.scenario.shipped_files import shipped_controller
from treadline.scenario.sill import Sill, landing_of
from treadline.scenario.stair import Stair
from treadline.vehicle.staircase import as_designed
from treadline.vehicle.start_checks import outline_of

SHIPPED = "shipped"
"""Source that names the shipped controller, detector or estimator."""

Opener = Callable[[Scenario, int], Plant]
"""Factory of a plant from a scenario and a seed. A run on a plant without ground truth has no scores.

``reports_ground = True`` on the factory, for example on the plant's class, declares that the plant delivers frames, or reports the
ground ahead (``FreeGround``) itself: the guard then awaits it."""
PlantName = Literal["mujoco", "gazebo"]
ControllerSource = str | Path | ControllerDesign | Driver | ControllerPlugin | None
"""File, ``module:Class``, entry point name, design, driver or plug-in class; None for the shipped controller of the vehicle."""
DetectorSource = str | DetectorPlugin | None
"""``module:Class``, entry point name or plug-in class; None for the shipped detector."""
EstimatorSource = str | EstimatorPlugin | None
"""``module:Class``, entry point name or plug-in class; None for the shipped estimator."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setup:
    """One run, resolved: what is run, with which chair, blocks, plant and seed."""

    scenario: Scenario
    """Scenario as it is run: with the seat shifted, where a shift makes it feasible."""
    seed: int
    """Random seed. The same seed gives byte-identical results."""
    chair: ChairDescription
    """Chair as its file describes it, without a shift of the seat."""
    report: CheckReport
    """Result of ``check`` on the scenario as it was given."""
    mission: MissionConfig
    """Mission configuration: what the operator would enter, and no ground truth."""
    rejections: tuple[str, ...] = ()
    """Reasons for which the scenario must not be run; empty if it may. ``drive.check = false`` overrides them."""
    seat_shift: str | None = None
    """Shift of the seat that was applied, and why; None if none was."""
    driver: Driver | None = None
    """An experiment's own driver in place of the configured one."""
    opener: Opener | PlantName = field(default="mujoco", repr=False)

    @property
    def refusal(self) -> str:
        """Reasons for which a run from floor to landing (or back) is refused, as text; empty if it is run."""
        return "; ".join(self.rejections) if is_full_traversal(self.mission, self.driver) else ""

    def build_blocks(self) -> Blocks:
        """Return new blocks for one mission.

        Raises:
            SettingsError: If a block cannot be built, for example because the controller was made for another vehicle.
        """
        return build_blocks(self.mission, self.driver)

    def open_plant(self) -> Plant:
        """Return a new plant of the scenario, with the faults that the scenario injects.

        Raises:
            TreadlineError: If the plant cannot be made.
        """
        from treadline.plant.faults import faulty

        if self.opener == "mujoco":
            from treadline.plant.mujoco import open_plant

            plant: Plant = open_plant(self.scenario, self.seed, chair=self.chair)
        elif self.opener == "gazebo":
            from treadline.plant.gazebo import open_gazebo

            plant = open_gazebo(self.scenario, self.seed, chair=self.chair)
        else:
            plant = self.opener(self.scenario, self.seed)
        return faulty(plant, self.scenario, self.seed)

    def require_controller(self) -> None:
        """Reject a rejected scenario for whose vehicle no controller is shipped: the answer of ``check`` precedes the controller.

        Raises:
            SettingsError: With the reasons of ``check``.
        """
        has_none = self.driver is None and self.mission.controller is None and self.mission.plugins.controller is None
        if self.rejections and has_none and self.mission.loop == "closed":
            raise SettingsError(f"check refuses this scenario: {'; '.join(self.rejections)}")


def resolve(
    scenario: str | Path | Scenario,
    controller: ControllerSource = None,
    seed: int = 0,
    *,
    detector: DetectorSource = None,
    estimator: EstimatorSource = None,
    open_plant: Opener | PlantName = "mujoco",
) -> Setup:
    """Return a run, resolved: each file read once, the scenario checked once.

    Args:
        scenario: Scenario file, the name of a shipped scenario, or a scenario.
        controller: File that ``treadline tune`` wrote, ``module:Class``, entry point name, design, plug-in class, or an
            experiment's own driver; the controller shipped for the vehicle when left out.
        seed: Random seed. The same seed gives byte-identical results.
        detector: Stair detector as ``module:Class``, entry point name or plug-in class.
        estimator: Heading estimator, likewise.
        open_plant: Simulator: its name, or a factory of the plant.

    Raises:
        SettingsError: If a file or plug-in is missing or says something that it must not.
    """
    given = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
    chair = given.read_chair()
    driver = controller if isinstance(controller, Driver) and not isinstance(controller, type) else None
    design, plugins = resolved_blocks(None if driver is not None else controller, detector, estimator)
    mission = mission_config(given, design, chair=chair, plugins=plugins, open_plant=open_plant)
    report = check(given, chair, mission)
    run, seat_shift = given, None
    rejections: tuple[str, ...] = ()
    if given.drive.check and report.verdict != "go":
        rejections = tuple(report.reasons)
        if is_full_traversal(mission, driver):
            run, refusal, seat_shift = ready(given, report)
            rejections = () if refusal is None else rejections
    if seat_shift is not None:
        mission = replace(mission, chair=chair.with_seat_shifted(run.chair.seat_shift_m))
    is_shipped = design is None and plugins.controller is None and driver is None
    if is_shipped and given.control.loop == "closed":
        # A rejected scenario needs no controller.
        with suppress(SettingsError) if rejections else nullcontext():
            mission = replace(mission, controller=shipped_controller(chair.name))
    return Setup(
        scenario=run,
        seed=seed,
        chair=chair,
        report=report,
        mission=mission,
        rejections=rejections,
        seat_shift=seat_shift,
        driver=driver,
        opener=open_plant,
    )


def mission_config(
    scenario: Scenario,
    controller: ControllerDesign | None,
    *,
    chair: ChairDescription | None = None,
    plugins: Plugins | None = None,
    open_plant: Opener | PlantName = "mujoco",
) -> MissionConfig:
    """Return the mission configuration of a scenario: what the operator would enter, and no ground truth.

    Args:
        chair: The chair, if its file has been read already.
        plugins: Blocks that replace the shipped ones.
        open_plant: Simulator: its name, or a factory of the plant.
    """
    described = scenario.read_chair() if chair is None else chair
    return MissionConfig(
        chair=described.with_seat_shifted(scenario.chair.seat_shift_m),
        controller=controller,
        plugins=plugins or Plugins(),
        direction=scenario.drive.direction,
        payload_kg=scenario.chair.entered.payload_kg,
        climb_speed_m_s=scenario.drive.speed_m_s,
        check=scenario.drive.check,
        flights=scenario.stair.flights,
        sills=_known_sills(scenario.stair, scenario.sill),
        landings=_known_landings(scenario.stair, described),
        reports_ground=isinstance(open_plant, str) or getattr(open_plant, "reports_ground", False) is True,
        loop=scenario.control.loop,
        vision="paper" if scenario.control.vision == "paper" else "robust",
        allocation=scenario.control.allocation,
        reconstruct=scenario.control.reconstruct,
    )


def _known_landings(stair: Stair, chair: ChairDescription) -> KnownLandings | None:
    """Return the landings between flights; None if the stair turns on none."""
    plans = () if stair.winders else as_designed(stair).plans[:-1]
    if not any(plan.turn_rad for plan in plans):
        return None
    return KnownLandings(plans=plans, width_m=stair.width_m, outline=outline_of(chair))


def _known_sills(stair: Stair, sills: Sequence[Sill]) -> tuple[KnownSill, ...]:
    """Return the outlines of sills and ramps, those between two flights for both."""
    found: list[KnownSill] = []
    for sill in sills:
        landing, outline = landing_of(stair, sill), tuple(sill.vertices(0.0))
        flight, far_m = -1 if landing is None else stair.flight_of(landing), outline[-1][1]
        if landing is not None:
            found.append(KnownSill(flight, "top", outline))
        if landing is None:
            found.append(KnownSill(0, "foot", outline))
        elif flight + 1 < stair.flights:
            depth_m = stair.each[flight + 1].landing_depth_m
            found.append(KnownSill(flight + 1, "foot", tuple((depth_m - out_m, z_m - far_m) for out_m, z_m in outline[::-1])))
    return tuple(found)


def checked(scenario: Scenario, chair: ChairDescription | None = None) -> CheckReport:
    """Return the verdict on a scenario with the shipped blocks.

    Args:
        chair: The chair, if its file has been read already.
    """
    chair = scenario.read_chair() if chair is None else chair
    return check(scenario, chair, mission_config(scenario, None, chair=chair))


def ready(scenario: Scenario, report: CheckReport) -> tuple[Scenario, str | None, str | None]:
    """Return the scenario with a feasible seat position, the reason for a refusal, and the shift that was applied.

    Args:
        report: Result of ``check`` on this scenario, whose remedies have been walked.
    """
    if report.verdict == "go":
        return scenario, None, None
    shift_m = report.proposed_seat_shift_m
    if shift_m is not None and len(report.reasons) == 1:
        moved = scenario.changed(chair={"seat_shift_m": shift_m})
        by_m = shift_m - scenario.chair.seat_shift_m
        return moved, None, f"seat shifted by {by_m * 1000.0:+.0f} mm along the chair: {report.reasons[0]}"
    return scenario, "; ".join(report.reasons), None


def resolved_blocks(
    controller: Any, detector: DetectorSource = None, estimator: EstimatorSource = None
) -> tuple[ControllerDesign | None, Plugins]:
    """Return the controller's design, and the plug-ins; None for each that is shipped.

    Of a controller, an existing or ``.json`` file is a design. Other text is a plug-in: ``module:Class``, or the name of an entry
    point; ``shipped`` is the shipped block.

    Raises:
        SettingsError: If a file or plug-in is missing, or lacks an attribute of its kind.
    """
    design = _design(controller)
    plugins = Plugins(
        controller=None if design is not None else _plugin("controller", controller),
        detector=_plugin("detector", detector),
        estimator=_plugin("estimator", estimator),
    )
    return design, plugins


def _design(source: Any) -> ControllerDesign | None:
    """Return a controller's design; None for a plug-in or the shipped controller."""
    if isinstance(source, ControllerDesign):
        check_turns(source.model)
        return source
    if isinstance(getattr(source, "model", source), LinearModel):
        raise SettingsError("controller is a model; tl.tune(model) makes a controller of it")
    text = str(source) if isinstance(source, str | Path) and source != SHIPPED else ""
    is_file = Path(text).is_file() or Path(text).suffix == ".json" or ("/" in text and ":" not in text)
    return ControllerDesign.load(Path(text)) if is_file and Path(text).suffix != ".py" else None


def _plugin(kind: str, source: Any) -> Any:
    """Return the plug-in class behind a source, or None."""
    if source is None or source == SHIPPED:
        return None
    if isinstance(source, str | Path):
        return load_plugin(kind, str(source))
    return checked_plugin(kind, source, f"{kind} {source_of_plugin(source)}" if isinstance(source, type) else kind)
