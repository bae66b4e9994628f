"""``treadline compare``: fits of one or several models on a log that none of them may know."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from treadline.cli._arguments import Force, claim, words
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError

if TYPE_CHECKING:
    from treadline.core.model_scores import Comparison
    from treadline.core.models import InputOutputRecord, LinearModel


def compare(
    models: list[Path],
    /,
    *,
    on: Annotated[Path, Parameter(name="--on")],
    inputs: str | None = None,
    outputs: str | None = None,
    resample: bool = False,
    allow_gaps: bool = False,
    plot: Path | None = None,
    force: Force = False,
) -> Answer:
    """Compare models on a log: fit, prediction one step ahead, tests of the residuals.

    A free run starts from the state that the first tenth of the log determines, and is scored after it. For an unstable model a
    forecast of ten samples stands in its place.

    Examples:
        treadline compare old.json new.json --on other-day.csv --plot fits.svg

    Args:
        models: Model files, as treadline identify writes them.
        on: Log: CSV, NPZ, MAT, Parquet, MCAP or ROS bag, or a run folder; best one that was not fitted.
        inputs: Input columns of the log. Default: the names in the model.
        outputs: Output columns, likewise.
        resample: Resample the log to the period of the model.
        allow_gaps: Accept up to 20 % of rows with NaN or missing.
        plot: Figure to write: .svg, .png or .pdf. Default: none.
    """
    from treadline.core.models import LinearModel

    if not models:
        raise SettingsError("compare needs at least one model: treadline compare model.json --on log.csv")
    if plot is not None:
        claim(plot, force=force, kind="file", option="--plot")
    found: dict[str, Comparison] = {}
    for path in models:
        model = LinearModel.load(path)
        found[str(path)] = model.compare(_record(model, path, on, inputs, outputs, resample=resample, allow_gaps=allow_gaps))
    written = {} if plot is None else {"plot": str(plot)}
    if plot is not None:
        from treadline.report.model_plots import write_comparisons

        write_comparisons(found, plot)
    return Answer(
        values={"log": str(on), "models": [{"model": name, **_values(item)} for name, item in found.items()], **written},
        summary=[*_table(found), *(f"{name}: {item.conditions}" for name, item in found.items()), *_written(plot)],
    )


def _record(
    model: "LinearModel", path: Path, log: Path, inputs: str | None, outputs: str | None, *, resample: bool, allow_gaps: bool
) -> "InputOutputRecord":
    from treadline.io.records import read_record

    names = [
        known if given is None else words(option, given)
        for option, given, known in (("--inputs", inputs, model.input_names), ("--outputs", outputs, model.output_names))
    ]
    if not all(names):
        raise SettingsError(f"{path}: the model does not name its channels; give --inputs and --outputs")
    period_s = model.dt_s if resample else None
    record = read_record(log, *names, period_s=period_s, resample=resample, allow_gaps=allow_gaps)
    if abs(record.dt_s - model.dt_s) > 1e-6 * model.dt_s:
        raise SettingsError(
            f"{log}: the period is {record.dt_s:g} s, that of {path} {model.dt_s:g} s; --resample brings the log to the model's"
        )
    return record


def _values(found: "Comparison") -> dict[str, Any]:
    """Return the JSON values of a comparison."""
    names = ("fit_percent", "fit_prefix_s", "forecast_percent", "forecast_horizon_s", "one_step_vaf_percent", "samples")
    return {name: getattr(found, name) for name in (*names, "whiteness_p", "crosscorrelation_p")}


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


def _written(plot: Path | None) -> list[str]:
    return [] if plot is None else [f"written: {plot}"]
