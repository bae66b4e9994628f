"""The functions of ``import treadline as tl``: arrays, paths and names in, results that print as tables out.

Nothing heavy is imported at the top: each function loads what it needs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from shutil import copyfile, copytree, rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, TypeAlias, Unpack
from weakref import finalize

from treadline.core.errors import ModelError, SettingsError, TreadlineError, closest
from treadline.core.printing import Printable, pandas_for

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from treadline.core.models import ControllerDesign, InputOutputRecord, LinearModel, Reconstruct
    from treadline.identification import IdentificationOptions, Identified
    from treadline.identification.options import IdentificationKeywords
    from treadline.run.episode import Traverse
    from treadline.run.resolve import ControllerSource, DetectorSource, EstimatorSource, Opener, PlantName
    from treadline.run.run_scores import Scores
    from treadline.run.verdict import CheckReport
    from treadline.scenario import Scenario

    Source: TypeAlias = str | Path | Scenario | Mapping[str, object]
    Data: TypeAlias = ArrayLike | InputOutputRecord | str | Path

OnProgress = Callable[[float, float], None]
"""Receives the mission time and the time limit of a run [s]."""


def scenarios() -> dict[str, str]:
    """Return the shipped scenarios: names, and a line about each.

    Examples:
        >>> import treadline as tl
        >>> "up-28" in tl.scenarios()
        True
    """
    from treadline.core.printing import PrintedDict
    from treadline.scenario import shipped_scenarios

    first = {name: path.read_text(encoding="utf-8").partition("\n")[0] for name, path in shipped_scenarios().items()}
    return PrintedDict("shipped scenarios", {name: line.removeprefix("# ") for name, line in first.items()})


def read_scenario(scenario: "Source", *, set: "Mapping[str, object] | None" = None) -> "Scenario":  # noqa: A002 - as --set
    """Return a scenario, for instance to change it.

    Args:
        scenario: Scenario file, the name of a shipped scenario, a scenario, or what a file holds as a dict of its tables. There a
            dict stands for the files of chair and camera as well: ``{"chair": {"model": {...}}}``.
        set: Values in place of the scenario's, by dotted key; ``treadline check --keys`` lists the keys. A key that cannot stand
            next to one of them is left out, such as ``rise_m`` next to ``slope_deg``.

    Raises:
        SettingsError: If the scenario cannot be read, a key is unknown, or a value is out of range.

    Examples:
        >>> import treadline as tl
        >>> tl.read_scenario("up-28", set={"stair.slope_deg": 30, "stair.run_m": 0.28}).stair.run_m
        0.28
        >>> tl.read_scenario({"stair": {"steps": 6}}).stair.steps
        6
    """
    from treadline.scenario import Scenario, with_values
    from treadline.scenario import read_scenario as read

    if isinstance(scenario, Scenario):
        return with_values(scenario.model_dump(), set) if set else scenario
    if isinstance(scenario, Mapping):
        return with_values(scenario, set or {})
    if not isinstance(scenario, str | Path):
        known = ", ".join(scenarios())
        raise SettingsError(
            f"scenario is of type {type(scenario).__name__}; give a file, a shipped name ({known}), a tl.Scenario or a dict"
        )
    return read(scenario, set)


def check(scenario: "Source", *, set: "Mapping[str, object] | None" = None) -> "CheckReport":  # noqa: A002 - as --set
    """Return the mechanical feasibility of a scenario: track length, traction, stability and seat range.

    No controller is needed, so that the answer is available for a chair for which none exists yet.

    Args:
        scenario, set: As for ``tl.read_scenario``.

    Returns:
        The report, which is true if the scenario may be driven: ``report.verdict`` is ``go`` or ``refuse``, ``report.reasons``
        lists why.

    Raises:
        SettingsError: If the scenario or its chair cannot be read, or a value is out of range.
        MechanicsError: If the chair cannot stand at the start.

    Examples:
        >>> import treadline as tl
        >>> tl.check("up-28").verdict
        'go'
        >>> bool(tl.check("up-28", set={"stair.slope_deg": 44}))
        False
    """
    from treadline.run.resolve import checked

    return checked(read_scenario(scenario, set=set))


def identify(
    u: "Data | Sequence[Data] | None",
    y: "ArrayLike | Sequence[ArrayLike] | None" = None,
    dt: float | None = None,
    options: "IdentificationOptions | None" = None,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    channels_first: bool = False,
    resample: bool = False,
    allow_gaps: bool = False,
    **keywords: "Unpack[IdentificationKeywords]",
) -> "Identified":
    """Return the linear model x[k+1] = Ax[k] + Bu[k], y[k] = Cx[k] + Du[k] that fits recorded data.

    The data are one experiment, or a list of experiments, in one of these forms:

    * ``u`` and ``y``: arrays of one row per sample, or data frames (pandas, polars), whose column names are kept.
    * ``u``: a file (CSV, NPZ, MAT, Parquet, MCAP, ROS bag) or a run folder, or a data frame with all columns, with ``inputs`` and
      ``outputs``; of a file without them, belt speeds ``left_m_s`` and ``right_m_s``, ``heading_rad`` and ``yaw_rate_rad_s``.
    * ``u``: a ``treadline.core.models.InputOutputRecord``, or a ``TimeResponseData`` of python-control.
    * ``u``: None, and ``y``; or a file with ``inputs=[]`` and ``outputs``: outputs alone, of a plant that noise drives.

    Args:
        u: Inputs, or whole experiments.
        y: Outputs, sampled together with ``u``; left out where ``u`` holds whole experiments.
        dt: Sampling period [s]; of a file the step of its time column when left out.
        options: Options of the identification; the data decide what is left out.
        inputs: Input columns of files and whole data frames; names of the channels of arrays.
        outputs: Output columns, likewise.
        channels_first: Whether arrays have one row per channel instead of one row per sample.
        resample: Whether files with an irregular time axis are resampled to the period.
        allow_gaps: Whether files may lack up to 20 % of their rows; arrays may hold NaN in any case.
        keywords: Fields of ``IdentificationOptions``, instead of ``options``: ``order=2, method="okid-era", validation=0.3``.

    Returns:
        ``.model``, the ``LinearModel``, and ``.report``, its quality with warnings. Both offer ``simulate``, ``predict``,
        ``compare``, ``step``, ``bode``, ``plot`` and more. Of outputs alone the modes, an ``OutputModes``: natural frequency and
        damping of each.

    Raises:
        RecordError: If the data cannot carry what is asked, or a file holds no such data.
        SettingsError: If an option is unknown or out of range.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> u = np.random.default_rng(0).normal(size=(200, 1))
        >>> y = 0.1 * np.vstack([[0.0], np.cumsum(u, axis=0)[:-1]])
        >>> found = tl.identify(u, y, 0.25, order=1, method="okid-era", lags=2)
        >>> found.model.A.round(3)
        array([[1.]])
        >>> tl.identify([u, u], [y, y], 0.25, order=1, method="okid-era", lags=2).report.samples
        396
        >>> swing = np.zeros(2000)
        >>> for k in range(2, 2000):
        ...     swing[k] = 1.9 * swing[k - 1] - 0.98 * swing[k - 2] + u[k % 200, 0]
        >>> bool(abs(tl.identify(None, swing, 0.1, order=2).frequency_hz[0] - 0.45) < 0.02)
        True
    """
    from treadline.identification import identify as identified
    from treadline.io.experiments import Reading, experiments_of

    chosen = _options(options, keywords)
    if (inputs is None) != (not outputs):
        raise SettingsError(f"{'outputs' if outputs else 'inputs'} are named alone; name inputs and outputs, or neither")
    columns = (tuple(inputs), tuple(outputs)) if inputs is not None and outputs else None
    how = Reading(period_s=dt, resample=resample, allow_gaps=allow_gaps)
    records = experiments_of(u, y, how, columns, channels_first=channels_first)
    if any(record.u.shape[1] for record in records):
        return identified(records, chosen)
    from treadline.identification.output_only import output_modes

    modes: Any = output_modes(records, chosen)  # for type checkers, the result is that of data with inputs
    return modes


def _options(options: "IdentificationOptions | None", keywords: "IdentificationKeywords") -> "IdentificationOptions":
    """Return the options, given as one object or as keywords."""
    from treadline.identification import IdentificationOptions

    if options is not None and keywords:
        raise SettingsError(f"{', '.join(keywords)} and options are given; put every option into one IdentificationOptions")
    known = [item.name for item in fields(IdentificationOptions)]
    for name in keywords:
        if name not in known:
            meant = closest(name, known)
            hint = f"known here: {', '.join(known)}" if meant is None else f"did you mean {meant}?"
            raise SettingsError(f"identify has no option '{name}'; {hint}")
    return IdentificationOptions(**keywords) if options is None else options


def load_model(path: str | Path) -> "LinearModel":
    """Return the model in a JSON file that ``treadline identify`` or ``model.save`` wrote.

    Raises:
        SettingsError: If the file is missing, not JSON, or not a model.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> u = np.random.default_rng(0).normal(size=(200, 1))
        >>> y = 0.1 * np.vstack([[0.0], np.cumsum(u, axis=0)[:-1]])
        >>> tl.identify(u, y, 0.25, order=1, method="okid-era", lags=2).model.save("model.json")
        >>> tl.load_model("model.json").order
        1
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
    vehicle: str | None = None,
    accept_poor_fit: bool = False,
) -> "ControllerDesign":
    """Return the LQR gain (Eq. 10) and the observer of a model.

    Args:
        model: Model, result of ``tl.identify``, or model file.
        state_weight: Diagonal of Q on the states, as in Eq. (13).
        output_weight: Diagonal of Q on the outputs instead: heading, yaw rate; 1, 0 when left out.
        input_weight: Diagonal of R, or one number for all inputs; 0.02 when left out.
        period_s: Control period [s], a multiple of 0.01; another period than the model's resamples the model.
        reconstruct: State reconstruction: ``observer``, or ``static`` for Eq. (11b).
        vehicle: Name of the chair that the controller is for; another chair rejects it. That which drove, where the model's log
            says so, or ``wheelchair`` when left out.
        accept_poor_fit: Tune an identified model that explains less than half of each output's variance.

    Raises:
        ModelError: If the model cannot be stabilised or observed, explains too little, or a weight is not definite.
        SettingsError: If weights are given twice, or the period is no multiple of 0.01 s.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> belts_m_s = np.random.default_rng(0).normal(0.2, 0.05, size=(400, 2))
        >>> yaw_rate = np.append(0.0, (belts_m_s[:-1, 1] - belts_m_s[:-1, 0]) / 0.64)
        >>> motion = np.column_stack([0.25 * np.cumsum(yaw_rate), yaw_rate])
        >>> found = tl.identify(belts_m_s, motion, 0.25, order=2, method="okid-era")
        >>> tl.tune(found).K.shape
        (2, 2)
    """
    from treadline.control import tune as tuned
    from treadline.core.models import LinearModel

    given = load_model(model) if isinstance(model, str | Path) else getattr(model, "model", model)
    if not isinstance(given, LinearModel):
        raise ModelError(f"model is of type {type(model).__name__}; tl.identify(u, y, dt) makes a model of inputs and outputs")
    return tuned(
        given,
        state_weight=state_weight,
        output_weight=output_weight,
        input_weight=input_weight,
        period_s=period_s,
        reconstruct=reconstruct,
        vehicle=vehicle,
        accept_poor_fit=accept_poor_fit,
    )


@dataclass(frozen=True, slots=True, weakref_slot=True, kw_only=True, eq=False, repr=False)
class Run(Printable):
    """Result of one simulated traversal, as ``tl.climb`` returns it.

    Examples:
        >>> import treadline as tl
        >>> run = tl.climb("default", set={"drive.duration_s": 0.5, "sensors.camera": "statistical"})
        >>> run.verdict, len(run.series["heading_deg"])
        ('time_up', 51)
        >>> run.plot().savefig("run.svg")
        >>> run.plot("pitch_deg", "y_m").savefig("pitch.svg")
        >>> run.report("run.html").name
        'run.html'
    """

    episode: "Traverse"
    """The run with its ground truth at every tick."""
    folder: Path | None = None
    """Run folder; None of a run that was rejected. Without ``out`` a temporary one, which is removed with the run."""
    rejections: tuple[str, ...] = ()
    """Reasons of ``check`` for which the scenario was not run."""

    @property
    def verdict(self) -> str:
        """How the run ended, as ``Traverse.verdict`` lists it: ``arrived``, ``held`` and others."""
        return self.episode.verdict

    @property
    def cause(self) -> str | None:
        """Reason for the verdict; None where it needs none."""
        return self.episode.cause

    @property
    def scores(self) -> "Scores":
        """Scores by ground truth: heading, roll-back, seat, passenger acceleration, tip-over margin and phases.

        Raises:
            TreadlineError: If the run has none: it was rejected, or its plant has no ground truth.
        """
        if self.episode.scores is None:
            raise TreadlineError(f"no scores ({self.verdict}): the ground truth is known of a simulated run that has begun")
        return self.episode.scores

    @property
    def series(self) -> "dict[str, np.ndarray]":
        """Time series at 100 Hz by column name, as in ``series.csv``: angles in degrees, everything else in SI units."""
        from treadline.core.printing import PrintedDict
        from treadline.run.recorded_run import series

        return PrintedDict("time series at 100 Hz", series(self.episode.trace, self.episode.estimate_rad))

    def __bool__(self) -> bool:
        """Return whether the run did what was asked: it arrived, or lasted as long as it was to."""
        from treadline.io.runs import SUCCEEDED

        return self.verdict in SUCCEEDED

    def frame(self) -> Any:
        """Return the time series as a data frame of pandas, with the time as index.

        Raises:
            TreadlineError: If pandas is not installed.
        """
        return pandas_for("run.frame()").DataFrame(self.series).set_index("t_s")

    def plot(self, *what: str) -> "Figure":
        """Return the matplotlib figure of the run: heading, pitch, seat, belts, place and tip-over margin over time.

        Args:
            what: Columns of ``series`` to draw instead.

        Raises:
            SettingsError: If there is no such column.
            TreadlineError: If the run ended before its first tick.
        """
        from treadline.report.run_figure import single_run

        series = self.series
        if len(self.episode.trace["t_s"]) < 2:
            raise TreadlineError(f"nothing to plot: the run ended before its first tick ({self.verdict}: {self.cause})")
        unknown = next((name for name in what if name not in series), None)
        if unknown is not None:
            raise SettingsError(f"the run has no column '{unknown}'; known here: {', '.join(series)}")
        return single_run(series, self.episode.phases, columns=what)

    def save(self, folder: str | Path) -> Path:
        """Copy the run folder, as ``treadline climb --out`` writes it, and return its path; a run that is there is replaced."""
        from treadline.io.runs import clear_run

        source, target = self._written(), Path(folder)
        clear_run(target)
        return Path(copytree(source, target, dirs_exist_ok=True))

    def report(self, file: str | Path | None = None) -> Path:
        """Write the page of the run, as ``treadline report`` does, and return its path.

        Args:
            file: HTML file; ``report.html`` in the run folder when left out.
        """
        from treadline.report import write_report

        page = write_report(self._written())
        return page if file is None else Path(copyfile(page, file))

    def view(self, *, open_browser: bool = True) -> None:
        """Show the run in the browser, as ``treadline view`` does, until Ctrl-C."""
        from treadline.view.opening import open_recorded
        from treadline.view.serving import serve

        serve("view", partial(open_recorded, str(self._written())), no_browser=not open_browser)

    def _written(self) -> Path:
        """Return the run folder.

        Raises:
            TreadlineError: If the run was rejected.
        """
        if self.folder is None:
            raise TreadlineError(f"there is no run folder: the run was rejected: {self.cause}")
        return self.folder

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the title and the most important scores."""
        scores = self.episode.scores
        title = f"{self.verdict}" + (f": {self.cause}" if self.cause else "")
        if scores is None or scores.duration_s == 0.0:
            return title, []
        return f"{title} after {scores.duration_s:.1f} s", [
            ("heading", f"{scores.rms_heading_deg:.2f}° RMS, {scores.settling}"),
            ("roll-back", f"{scores.roll_back_m:.3f} m"),
            ("lateral", f"{scores.lateral_m:.3f} m"),
            ("seat", "no seat linkage" if scores.seat_max_deg is None else f"at most {scores.seat_max_deg:.1f}° off level"),
            ("passenger", f"at most {scores.passenger_max_m_s2:.2f} m/s²"),
            ("tip-over margin", f"at least {scores.min_stability_margin_deg:.1f}°"),
            ("phases", ", ".join(f"{name} {t_s:.1f} s" for t_s, name in scores.phases)),
        ]


def climb(
    scenario: "Source",
    controller: "ControllerSource" = None,
    seed: int = 0,
    *,
    set: "Mapping[str, object] | None" = None,  # noqa: A002 - as --set
    detector: "DetectorSource" = None,
    estimator: "EstimatorSource" = None,
    plant: "PlantName | Opener" = "mujoco",
    out: str | Path | None = None,
    log_images: bool = False,
    on_progress: OnProgress | None = None,
) -> Run:
    """Return one simulated traversal in closed loop with vision, fusion, LQR, seat levelling and guard.

    A scenario that fails ``check``, even after shifting the seat by up to 0.10 m, is not run, and leaves no run folder.

    Args:
        scenario: As for ``tl.read_scenario``.
        controller: Controller file or design, plug-in class, ``module:Class``, or entry point name; the controller shipped for the
            vehicle when left out.
        seed: Random seed. The same seed gives byte-identical results.
        set: Values in place of the scenario's, by dotted key, as in ``tl.read_scenario``.
        detector: Stair detector: plug-in class, ``module:Class``, or entry point name.
        estimator: Heading estimator, likewise.
        plant: Simulator: mujoco, gazebo, or a factory of the plant.
        out: Run folder to write, as ``treadline climb --out`` does; a temporary one when left out, see ``Run.save``.
        log_images: Keep every frame in the log of the run folder.
        on_progress: Receives the mission time and the time limit [s] at each tick.

    Raises:
        SettingsError: If a file or plug-in is missing or says something that it must not, or a value is out of range.

    Examples:
        >>> import treadline as tl
        >>> tl.climb("up-28", set={"drive.duration_s": 0.5, "sensors.camera": "statistical"}, seed=1).verdict
        'time_up'
    """
    from treadline.run.episode import rejected_run
    from treadline.run.recorded_run import recorded_run
    from treadline.run.resolve import resolve

    setup = resolve(read_scenario(scenario, set=set), controller, seed, detector=detector, estimator=estimator, open_plant=plant)
    if setup.rejections:
        return Run(episode=rejected_run(setup), rejections=setup.rejections)
    limit_s = setup.scenario.drive.duration_s
    watch = None if on_progress is None else lambda tick: on_progress(tick.t_s, limit_s)
    folder = Path(mkdtemp(prefix="treadline-"), "run") if out is None else Path(out)
    run = Run(episode=recorded_run(folder, setup, image_every=int(log_images), watch=watch), folder=folder)
    if out is None:
        finalize(run, rmtree, folder.parent, ignore_errors=True)
    return run
