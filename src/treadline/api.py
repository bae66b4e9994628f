"""The functions of ``import treadline as tl``: arrays, paths and names in, results that print as tables out.

Nothing heavy is imported at the top: each function loads what it needs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from treadline.core.errors import ImageError, RecordError, SettingsError, TreadlineError
from treadline.core.printing import Printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

    from treadline.core.camera_images import PinholeCamera
    from treadline.core.models import ControllerDesign, LinearModel, Reconstruct
    from treadline.identification import IdentificationOptions, Identified
    from treadline.perception import StairDetection
    from treadline.run.episode import Traverse
    from treadline.run.resolve import ControllerSource, DetectorSource, EstimatorSource
    from treadline.run.run_scores import Scores
    from treadline.scenario import Scenario
    from treadline.vehicle.verdict import CheckReport

OnProgress = Callable[[float, float], None]
"""Receives the mission time and the time limit of a run [s]."""


def check(scenario: "str | Path | Scenario") -> "CheckReport":
    """Return the mechanical feasibility of a scenario: track length, traction, stability and seat range.

    No controller is needed, so that the answer is available for a chair for which none exists yet.

    Args:
        scenario: Scenario file, the name of a shipped scenario, or a scenario.

    Returns:
        The report; ``report.verdict`` is ``go`` or ``refuse``, ``report.reasons`` lists why.

    Raises:
        SettingsError: If the scenario or its chair cannot be read.
    """
    from treadline.scenario import Scenario, read_scenario
    from treadline.scenario.chair import read_chair
    from treadline.vehicle.verdict import check as checked

    settings = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
    return checked(settings, read_chair(settings.chair.model))


def identify(
    u: Any,
    y: Any,
    dt: float,
    options: "IdentificationOptions | None" = None,
    **keywords: Any,
) -> "Identified":
    """Return the linear model x[k+1] = Ax[k] + Bu[k], y[k] = Cx[k] + Du[k] that fits recorded data.

    Args:
        u: Inputs: array of one row per sample, or a data frame, whose column names are kept.
        y: Outputs, likewise, sampled together with ``u``.
        dt: Sampling period [s].
        options: Options of the identification; the data decide what is left out.
        keywords: Fields of ``IdentificationOptions``, instead of ``options``: ``order=2, method="okid-era", validation=0.3``.

    Returns:
        ``.model``, the ``LinearModel``, and ``.report``, its quality with warnings.

    Raises:
        RecordError: If the data cannot carry what is asked.
        SettingsError: If an option is unknown or out of range.
    """
    from treadline.core.models import InputOutputRecord
    from treadline.identification import identify as identified

    (inputs, input_names), (outputs, output_names) = _columns("u", u), _columns("y", y)
    record = InputOutputRecord(u=inputs, y=outputs, dt_s=dt, input_names=input_names, output_names=output_names)
    return identified(record, _options(options, keywords))


def _options(options: "IdentificationOptions | None", keywords: dict[str, Any]) -> "IdentificationOptions":
    """Return the options, given as one object or as keywords."""
    from treadline.identification import IdentificationOptions

    if options is not None and keywords:
        raise SettingsError(f"{', '.join(keywords)} and options are given; put every option into one IdentificationOptions")
    known = [item.name for item in fields(IdentificationOptions)]
    for name in keywords:
        if name not in known:
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
            raise SettingsError(f"identify has no option '{name}'; {hint}")
    return IdentificationOptions(**keywords) if options is None else options


def _columns(name: str, given: Any) -> tuple[Any, tuple[str, ...]]:
    """Return samples and column names; only a data frame or a series (pandas, polars) has names."""
    if not hasattr(given, "to_numpy"):
        return given, ()
    try:
        values = given.to_numpy().astype(float)
    except (TypeError, ValueError):
        raise RecordError(f"{name}: a column of the data frame holds no numbers; select the columns that were measured") from None
    columns = getattr(given, "columns", None)
    series = getattr(given, "name", None)
    names = [series] if columns is None and series is not None else [] if columns is None else list(columns)
    return values, tuple(str(item) for item in names)


def load_model(path: str | Path) -> "LinearModel":
    """Return the model in a JSON file that ``treadline identify`` wrote.

    Raises:
        SettingsError: If the file is missing, not JSON, or not a model.
    """
    from treadline.core.models import LinearModel

    return LinearModel.load(Path(path))


def tune(
    model: "LinearModel | Identified | str | Path",
    *,
    state_weight: Sequence[float] | None = None,
    output_weight: Sequence[float] | None = None,
    input_weight: Sequence[float] | None = None,
    period_s: float | None = None,
    reconstruct: "Reconstruct" = "observer",
    vehicle: str = "wheelchair",
) -> "ControllerDesign":
    """Return the LQR gain (Eq. 10) and the observer of a model.

    Args:
        model: Model, result of ``tl.identify``, or model file.
        state_weight: Diagonal of Q on the states, as in Eq. (13).
        output_weight: Diagonal of Q on the outputs instead: heading, yaw rate; 1, 0 when left out.
        input_weight: Diagonal of R, or one number for all inputs; 0.02 when left out.
        period_s: Control period [s], a multiple of 0.01; another period than the model's resamples the model.
        reconstruct: State reconstruction: ``observer``, or ``static`` for Eq. (11b).
        vehicle: Name of the chair that the controller is for; another chair rejects it.

    Raises:
        ModelError: If the model cannot be stabilised or observed, or a weight is not definite.
        SettingsError: If weights are given twice, or the period is no multiple of 0.01 s.
    """
    from treadline.control import tune as tuned
    from treadline.core.models import LinearModel

    if isinstance(model, str | Path):
        model = load_model(model)
    return tuned(
        model if isinstance(model, LinearModel) else model.model,
        state_weight=state_weight,
        output_weight=output_weight,
        input_weight=input_weight,
        period_s=period_s,
        reconstruct=reconstruct,
        vehicle=vehicle,
    )


def detect_stair(
    depth_m: "ArrayLike",
    camera: "PinholeCamera | str | Path",
    gravity: "ArrayLike | None" = None,
) -> "StairDetection":
    """Return the heading and the geometry of the stair in one depth image.

    Args:
        depth_m: Distance along the optical axis [m], one row per image row; 0, NaN and infinity mean no return.
        camera: Calibration, or a calibration file (TOML).
        gravity: Vector that points down in the camera's frame (x right, y down, z forward); estimated from the treads when left
            out.

    Returns:
        ``.accepted``, ``.reason`` (None if accepted), ``.heading_rad``, ``.sigma_rad``, ``.shape`` and ``.stair_map``.

    Raises:
        ImageError: If the image is not of the calibration's size.
        SettingsError: If the calibration file cannot be read.
        RecordError: If gravity is not three numbers.
    """
    import numpy as np

    from treadline.core.camera_images import PinholeCamera, RgbdFrame, black
    from treadline.perception import StairDetector
    from treadline.scenario.camera_file import read_camera

    pinhole = camera if isinstance(camera, PinholeCamera) else read_camera(Path(camera)).camera
    depth = np.array(depth_m, dtype=np.float32)
    if depth.ndim != 2:
        raise ImageError(f"depth_m has {depth.ndim} dimensions; give one row per image row and one column per image column")
    depth[~(np.isfinite(depth) & (depth > 0.0))] = np.nan
    # The robust method reads depth alone; the frame type asks for a colour image of the same size.
    frame = RgbdFrame(t_s=0.0, rgb=black(*depth.shape), depth_m=depth, camera=pinhole)
    down = None if gravity is None else np.asarray(gravity, dtype=float)
    return StairDetector().look(frame, down)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Run(Printable):
    """Result of one simulated traversal."""

    episode: "Traverse"
    """The run with its ground truth at every tick."""
    rejections: tuple[str, ...] = ()
    """Reasons of ``check`` for which the scenario was not run."""

    @property
    def verdict(self) -> str:
        """How the run ended: ``arrived``, ``end_of_flight``, ``held``, ``refused``, ``fell``, ``time_up`` or ``diverged``."""
        return self.episode.verdict

    @property
    def cause(self) -> str | None:
        """Reason for the verdict; None where it needs none."""
        return self.episode.cause

    @property
    def scores(self) -> "Scores":
        """Scores by ground truth: heading, roll-back, seat, passenger acceleration, tip-over margin and phases."""
        return self.episode.scores

    @property
    def series(self) -> "dict[str, np.ndarray]":
        """Time series at 100 Hz by column name, as in ``series.csv``: angles in degrees, everything else in SI units."""
        from treadline.run.recorded_run import series

        return series(self.episode.trace, self.episode.estimate_rad)

    def plot(self) -> Any:
        """Return the matplotlib figure of the run: heading, pitch, seat, belts, place and tip-over margin over time.

        Raises:
            TreadlineError: If the run ended before its first tick.
        """
        from treadline.report.run_figure import single_run

        if len(self.episode.trace["t_s"]) < 2:
            raise TreadlineError(f"nothing to plot: the run ended before its first tick ({self.verdict}: {self.cause})")
        return single_run(self.series, self.scores.phases)

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the title and the most important scores."""
        scores = self.scores
        settled = "not settled" if scores.settle_s is None else f"{scores.settle_s:.1f} s to ±2°"
        title = f"{self.verdict}" + (f": {self.cause}" if self.cause else "")
        if scores.duration_s == 0.0:
            return title, []
        return f"{title} after {scores.duration_s:.1f} s", [
            ("heading", f"{scores.rms_heading_deg:.2f}° RMS, {settled}"),
            ("roll-back", f"{scores.roll_back_m:.3f} m"),
            ("lateral", f"{scores.lateral_m:.3f} m"),
            ("seat", "no seat linkage" if scores.seat_max_deg is None else f"at most {scores.seat_max_deg:.1f}° off level"),
            ("passenger", f"at most {scores.passenger_max_m_s2:.2f} m/s²"),
            ("tip-over margin", f"at least {scores.min_stability_margin_deg:.1f}°"),
            ("phases", ", ".join(f"{name} {t_s:.1f} s" for t_s, name in scores.phases)),
        ]


def climb(
    scenario: "str | Path | Scenario",
    controller: "ControllerSource" = None,
    seed: int = 0,
    *,
    detector: "DetectorSource" = None,
    estimator: "EstimatorSource" = None,
    out: str | Path | None = None,
    log_images: bool = False,
    on_progress: OnProgress | None = None,
) -> Run:
    """Return one simulated traversal in closed loop with vision, fusion, LQR, seat levelling and guard.

    A scenario that fails ``check``, even after shifting the seat by up to 0.10 m, is not run, and leaves no run folder.

    Args:
        scenario: Scenario file, the name of a shipped scenario, or a scenario.
        controller: Controller file or design, plug-in class, ``module:Class``, or entry point name; the controller shipped for the
            vehicle when left out.
        seed: Random seed. The same seed gives byte-identical results.
        detector: Stair detector: plug-in class, ``module:Class``, or entry point name.
        estimator: Heading estimator, likewise.
        out: Run folder to write, as ``treadline climb --out`` does; none when left out.
        log_images: Keep every frame in the log of the run folder.
        on_progress: Receives the mission time and the time limit [s] at each tick.

    Raises:
        SettingsError: If a file or plug-in is missing or says something that it must not.
    """
    from treadline.run.episode import rejected_run, run_episode
    from treadline.run.recorded_run import recorded_run
    from treadline.run.resolve import resolve

    setup = resolve(scenario, controller, seed, detector=detector, estimator=estimator)
    if setup.rejections:
        return Run(episode=rejected_run(setup), rejections=setup.rejections)
    limit_s = setup.scenario.drive.duration_s
    watch = None if on_progress is None else lambda tick: on_progress(tick.t_s, limit_s)
    if out is None:
        return Run(episode=run_episode(setup, watch=watch))
    return Run(episode=recorded_run(Path(out), setup, image_every=int(log_images), watch=watch))
