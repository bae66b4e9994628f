"""``treadline identify``: from anybody's logs to a linear model, a report and a page of plots; models compared on a log."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from treadline.cli._arguments import Force, choice, claim, words
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError, TooFewSamples

if TYPE_CHECKING:
    from treadline.core.model_scores import Comparison
    from treadline.core.models import InputOutputRecord, LinearModel
    from treadline.identification import Gram, IdentificationOptions, Identified

STREAMED_BYTES = 256 * 1024**2
"""Size from which a CSV or Parquet file is read in chunks: some four million rows of five columns."""
STREAMED = (".csv", ".tsv", ".txt", ".dat", ".parquet", ".feather")
COMPARED = ("inputs", "outputs", "resample", "allow_gaps", "on", "page")
"""Options of a comparison; the others are of a fit."""
NOT_COMPARED = "is of a fit; --on compares models that were fitted"
SCORES = (
    "fit_percent", "fit_prefix_s", "forecast_percent", "forecast_horizon_s", "one_step_vaf_percent", "samples", "whiteness_p",
    "crosscorrelation_p",
)  # fmt: skip


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyOptions:
    """Options of ``treadline identify``: one object from the command line to the identification.

    Attributes:
        on: Log to compare models on, best one that was not fitted: fit, prediction one step ahead, tests of the residuals.
        inputs: Input columns; of bags as topic.field, of arrays as name[column]. Default: left_m_s,right_m_s; with --on, those of
            the model.
        outputs: Output columns, likewise. Default: heading_rad,yaw_rate_rad_s; with --on, those of the model.
        period: Sampling period in seconds. Default: from the time column.
        resample: Resample an irregular time axis to the period (inputs held, outputs interpolated); with --on, to the model's.
        allow_gaps: Accept up to 20 % of rows with NaN (an empty cell), or missing where the others keep the period's grid.
        order: Number of states. Default: chosen from the data.
        lags: Observer lags p. Default: chosen from the data.
        method: best (the model nearest to the median of an ensemble), okid-era (the paper's), pbsid, or deconvolution
            (Eq. 9c as printed). Default: best; pbsid with --update or --stream.
        delays: Dead time of each input in samples (0,2), or of all (0). Default: found with best, else part of the states.
        solver: gram, or qr: slower, exact on data without noise.
        name_prior: Let names decide what the data leave open: a left and a right belt turn a vehicle by their difference, a heading
            is the integral of the yaw rate.
        stable: Mirror poles outside the unit circle.
        validate: Share of each record, at its end, kept for validation. Default: none.
        validate_on: Another log to validate on.
        update: Gram matrix of earlier data (--gram) to continue from.
        forgetting: Factor on the weight of earlier data per new sample, for example 0.999; 1 forgets nothing.
        stream: Read CSV or Parquet in chunks, in bounded memory. Default: above 256 MB.
        gram: Write the Gram matrix of all data to this file, for --update.
        page: Page of plots to write. Default: next to the model. With --on, a figure: .svg, .png or .pdf. Default: none.
        no_page: Write no page.
    """

    on: Path | None = None
    inputs: str | None = None
    outputs: str | None = None
    period: float | None = None
    resample: bool = False
    allow_gaps: bool = False
    order: int | None = None
    lags: int | None = None
    method: str | None = None
    delays: str | None = None
    solver: str = "gram"
    name_prior: bool = True
    stable: bool = False
    validate: float | None = None
    validate_on: Path | None = None
    update: Path | None = None
    forgetting: float = 1.0
    stream: Annotated[bool | None, Parameter(negative="--no-stream")] = None
    gram: Path | None = None
    page: Path | None = None
    no_page: bool = False

    @property
    def input_names(self) -> tuple[str, ...]:
        """Input columns as a list."""
        from treadline.io.runs import INPUTS

        return INPUTS if self.inputs is None else words("--inputs", self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Output columns as a list."""
        from treadline.io.runs import OUTPUTS

        return OUTPUTS if self.outputs is None else words("--outputs", self.outputs)

    @property
    def dead_time(self) -> list[int] | int | None:
        """Dead time of each input in samples, of all inputs, or None.

        Raises:
            SettingsError: If it is not whole numbers.
        """
        if self.delays is None:
            return None
        try:
            found = [int(part) for part in self.delays.split(",")]
        except ValueError:
            raise SettingsError(f"--delays is '{self.delays}'; give one whole number per input, for example 0,2") from None
        return found if len(found) > 1 else found[0]

    def options(self, *, validation: "float | InputOutputRecord | None", prior: "Gram | None") -> "IdentificationOptions":
        """Return the options of the identification.

        Args:
            validation: Share of each record kept for validation, or the record read from ``--validate-on``.
            prior: Gram matrix read from ``--update``.
        """
        from treadline.identification import IdentificationOptions

        same = {name: getattr(self, name) for name in ("order", "lags", "method", "solver", "name_prior", "stable", "forgetting")}
        return IdentificationOptions(**same, delays=self.dead_time, validation=validation, prior=prior)


DEFAULTS = IdentifyOptions()
OUT = Path("model.json")


def identify(logs: list[Path], /, *, options: IdentifyOptions = DEFAULTS, out: Path = OUT, force: Force = False) -> Answer:
    """Fit x[k+1] = Ax[k] + Bu[k], y[k] = Cx[k] + Du[k] to recorded runs; with --on, compare models on a log.

    A free run of a compared model starts from the state that the first tenth of the log determines, and is scored after it. For an
    unstable model a forecast of ten samples stands in its place.

    Examples:
        treadline identify run.csv --inputs left_m_s,right_m_s --outputs yaw_rate_rad_s --validate 0.5
        treadline identify drive.mcap --inputs /cmd.data[0],/cmd.data[1] --outputs /imu.angular_velocity.z --period 0.05
        treadline identify old.json new.json --on other-day.csv --page fits.svg

    Args:
        logs: CSV, NPZ, MAT, Parquet, MCAP or ROS bag files, or run folders; several are separate experiments. With --on, model
            files that treadline identify wrote.
        out: Model file to write, .json or .mat. Default: model.json.
    """
    if options.on is not None:
        if out != OUT:
            raise SettingsError(f"--out {NOT_COMPARED}")
        return _compared(logs, options, options.on, force=force)
    _check(logs, options)
    claim(out, force=force, kind="file")
    if out.suffix.lower() not in {".json", ".mat"}:
        raise SettingsError(f"{out}: unsupported model format '{out.suffix.lower()}'; supported: .json, .mat")
    try:
        found = _streamed(logs, options) if _in_chunks(logs, options) else _whole(logs, options)
    except TooFewSamples as error:
        kept = "" if options.validate is None else f"; --validate {options.validate:g} keeps that share of each record back"
        raise TooFewSamples(f"{_titled(logs)}: {error}{kept}") from None
    return _answer(found, _written(found, logs, options, out))


def _check(logs: Sequence[Path], asked: IdentifyOptions) -> None:
    from treadline.identification import METHODS, SOLVERS

    if not logs:
        raise SettingsError("identify needs at least one log: a file or a run folder")
    if models := [path for path in logs if path.suffix.lower() == ".json"]:
        raise SettingsError(f"{models[0]}: a model, not a log; to compare models on a log, name the log by --on LOG")
    for option, value, allowed in (("--method", asked.method, METHODS), ("--solver", asked.solver, SOLVERS)):
        if value is not None:
            choice(option, value, allowed)
    if asked.validate is not None and asked.validate_on is not None:
        raise SettingsError("give --validate or --validate-on, not both")
    if asked.dead_time is not None and (asked.gram or asked.update) is not None:
        raise SettingsError("--delays cannot be combined with --gram or --update: a Gram matrix does not record shifted inputs")
    if asked.update is None and 0.0 < asked.forgetting < 1.0:
        raise SettingsError("--forgetting needs earlier data; give them with --update")
    if asked.page is not None and asked.no_page:
        raise SettingsError("give --page or --no-page, not both")
    both = [name for name in asked.input_names if name in asked.output_names]
    if both:
        raise SettingsError(f"'{both[0]}' is given to --inputs and to --outputs; a column is one or the other")


def _in_chunks(logs: Sequence[Path], asked: IdentifyOptions) -> bool:
    """Return whether the logs are read in chunks: as chosen, else if they are long and no option needs them whole."""
    can = all(path.suffix.lower() in STREAMED and path.is_file() for path in logs)
    long = can and sum(path.stat().st_size for path in logs) > STREAMED_BYTES
    return asked.stream or (asked.stream is None and long and asked.method != "best" and asked.update is None)


def _whole(logs: Sequence[Path], asked: IdentifyOptions) -> "Identified":
    from treadline.cli._output import status
    from treadline.core.models import InputOutputRecord
    from treadline.identification import Gram
    from treadline.identification import identify as fit
    from treadline.io.records import read_record

    def read(path: Path) -> InputOutputRecord:
        return read_record(
            path, asked.input_names, asked.output_names, period_s=asked.period, resample=asked.resample, allow_gaps=asked.allow_gaps
        )

    with status("reading") as shown:
        records = [read(path) for path in logs]
        judged = asked.validate if asked.validate_on is None else read(asked.validate_on)
        shown.update("identifying")
        prior = None if asked.update is None else Gram.load(asked.update)
        found = fit(records, asked.options(validation=judged, prior=prior), on_progress=shown.update)
        shown.update("judging")
        found.report  # noqa: B018 - computed here, where a person sees what takes time
    return found


def _streamed(logs: Sequence[Path], asked: IdentifyOptions) -> "Identified":
    from treadline.cli._output import Share
    from treadline.identification import identify_chunks
    from treadline.io.records import ChunkReader

    whole = ("validate", "validate_on", "update", "delays", "resample", "stable", "forgetting")
    _reject(asked, whole, "needs the whole record; give --no-stream")
    readers = [
        ChunkReader(log, asked.input_names, asked.output_names, period_s=asked.period, allow_gaps=asked.allow_gaps) for log in logs
    ]
    sizes = [log.stat().st_size for log in logs]

    def fraction() -> float:
        return sum(size * reader.fraction for size, reader in zip(sizes, readers, strict=True)) / max(sum(sizes), 1)

    with Share(f"reading {_titled(logs)}", fraction) as share:
        return identify_chunks(
            *(share.of(reader) for reader in readers),
            options=asked.options(validation=None, prior=None),
        )


def _reject(asked: IdentifyOptions, names: Iterable[str], why: str) -> None:
    for name in names:
        if getattr(asked, name) != getattr(DEFAULTS, name):
            raise SettingsError(f"--{name.replace('_', '-')} {why}")


def _written(found: "Identified", logs: Sequence[Path], asked: IdentifyOptions, out: Path) -> dict[str, str]:
    """Write model, Gram matrix and page; return the path of each."""
    found.model.save(out)
    written = {"model": str(out)}
    if asked.gram is not None:
        found.gram.save(asked.gram)
        written["gram"] = str(asked.gram)
    page = None if asked.no_page else asked.page or out.with_suffix(".html")
    if page is not None:
        _write_page(found, page, logs)
        written["page"] = str(page)
    return written


def _answer(found: "Identified", written: dict[str, str]) -> Answer:
    from treadline.core.printing import percent_text

    report, vehicle = found.report, found.report.skid_steer
    fits = ", ".join(f"{name} {percent_text(value)}" for name, value in report.percent.items())
    ahead = ", ".join(f"{name} {percent_text(value)}" for name, value in report.one_step_vaf_percent.items())
    return Answer(
        values=report.as_json() | written,
        summary=[
            f"order {report.order} with {report.lags} lags ({report.method}: {report.subspace}, {report.step}), "
            f"{_counted(found)}, one sample every {found.model.dt_s:.6g} s",
            *([f"{' and '.join(found.model.input_names)} act by their difference alone"] if report.mirrored else []),
            f"fit of {report.judged_on}: {fits} (100 is perfect, 0 no better than the mean); {report.fit_conditions}",
            f"one step ahead: {ahead} of the variance",
            *([] if vehicle is None else [", ".join(f"{name} {value}" for name, value in vehicle.in_words())]),
            f"written: {', '.join(dict.fromkeys(written.values()))}",
            *(f"warning: {warning}" for warning in report.warnings),
        ],
    )


def _counted(found: "Identified") -> str:
    """Return the amount of data in the words of the page; of a stream, or of earlier data, only the windows are known."""
    given, report = sum(len(record) for record in found.fitted), found.report
    windows = f"{report.samples} windows fitted, {report.dropped} omitted for gaps"
    return f"{given} samples; {windows}" if report.samples <= given else windows


def _write_page(found: "Identified", path: Path, logs: Sequence[Path]) -> None:
    from treadline.cli._output import status
    from treadline.report.identification_page import IdentificationPage

    with status("drawing"):
        IdentificationPage(
            title=_titled(logs),
            model=found.model,
            said=found.report,
            records=found.fitted,
            judged=found.judge.judged,
            judge=found.judge.free,
            intervals=found.intervals,
            stabilisation=found.stabilisation(),
        ).write(path)


def _titled(logs: Sequence[Path]) -> str:
    return ", ".join(path.name for path in logs[:3]) + (f" and {len(logs) - 3} more" if len(logs) > 3 else "")


def _compared(models: Sequence[Path], asked: IdentifyOptions, log: Path, *, force: bool) -> Answer:
    """Compare models on a log that best none of them knows."""
    from treadline import api

    _reject(asked, (item.name for item in fields(asked) if item.name not in COMPARED), NOT_COMPARED)
    if asked.page is not None:
        claim(asked.page, force=force, kind="file", option="--page")
    found: dict[str, Comparison] = {}
    for path in models:
        model = api.load_model(path)
        found[str(path)] = model.compare(_record_of(model, path, asked, log))
    written = {} if asked.page is None else {"plot": str(asked.page)}
    if asked.page is not None:
        from treadline.report.model_plots import write_comparisons

        write_comparisons(found, asked.page)
    values = [{"model": name, **{score: getattr(item, score) for score in SCORES}} for name, item in found.items()]
    return Answer(
        values={"log": str(log), "models": values, **written},
        summary=[
            *_table(found),
            *(f"{name}: {item.conditions}" for name, item in found.items()),
            *(f"written: {path}" for path in written.values()),
        ],
    )


def _record_of(model: "LinearModel", path: Path, asked: IdentifyOptions, log: Path) -> "InputOutputRecord":
    """Return the record in a log, by default of the channels that the model names."""
    from treadline.io.records import read_record

    inputs = model.input_names if asked.inputs is None else asked.input_names
    outputs = model.output_names if asked.outputs is None else asked.output_names
    if not (inputs and outputs):
        raise SettingsError(f"{path}: the model does not name its channels; give --inputs and --outputs")
    period_s = model.dt_s if asked.resample else None
    record = read_record(log, inputs, outputs, period_s=period_s, resample=asked.resample, allow_gaps=asked.allow_gaps)
    if abs(record.dt_s - model.dt_s) > 1e-6 * model.dt_s:
        raise SettingsError(
            f"{log}: the period is {record.dt_s:g} s, that of {path} {model.dt_s:g} s; --resample brings the log to the model's"
        )
    return record


def _table(found: "dict[str, Comparison]") -> list[str]:
    """Return the lines of a table, a line for each model and output."""
    from treadline.core.printing import p_text, percent_text

    head = ("model", "output", "fit", "one step ahead", "white residuals", "independent of inputs")
    rows = [
        (
            name,
            output,
            percent_text(percent),
            percent_text(item.one_step_vaf_percent[output]),
            p_text(item.whiteness_p),
            p_text(item.crosscorrelation_p),
        )
        for name, item in found.items()
        for output, percent in item.percent.items()
    ]
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in (head, *rows)]
