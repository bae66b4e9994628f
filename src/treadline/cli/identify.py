"""``treadline identify``: from anybody's logs to a linear model, a report and a page of plots."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from treadline.cli.answer import Answer
from treadline.cli.numbers import words
from treadline.errors import SettingsError

if TYPE_CHECKING:
    from treadline.identification import Identified

STREAMED_BYTES = 256 * 1024**2
"""Size from which a CSV or Parquet file is read in chunks: some four million rows of five columns."""
STREAMED = (".csv", ".tsv", ".txt", ".parquet")


def identify(
    logs: list[Path],
    /,
    *,
    inputs: str = "left_m_s,right_m_s",
    outputs: str = "heading_rad,yaw_rate_rad_s",
    period: float | None = None,
    resample: bool = False,
    allow_gaps: bool = False,
    order: int | None = None,
    lags: int | None = None,
    method: str | None = None,
    delays: str | None = None,
    solver: str = "gram",
    stable: bool = False,
    validate: float | None = None,
    validate_on: Path | None = None,
    update: Path | None = None,
    forgetting: float = 1.0,
    stream: bool | None = None,
    sums: Path | None = None,
    page: Path | None = None,
    no_page: bool = False,
    out: Path = Path("model.json"),
) -> Answer:
    """Fit x[k+1] = Ax[k] + Bu[k], y[k] = Cx[k] + Du[k] to recorded runs.

    Examples:
        treadline identify run.csv --inputs left_m_s,right_m_s --outputs yaw_rate_rad_s --validate 0.5
        treadline identify drive.mcap --inputs /cmd.data[0],/cmd.data[1] --outputs /imu.angular_velocity.z --period 0.05

    Args:
        logs: CSV, NPZ, MAT, Parquet, MCAP or ROS bag files, or run folders; several are separate experiments.
        inputs: Columns that drove the system; of bags as topic.field, of arrays as name[column].
        outputs: Columns that answered.
        period: Sampling period in seconds; read from the time column when left out.
        resample: Bring an irregular time axis to the period (inputs held, outputs interpolated).
        allow_gaps: Accept NaN in up to 20 % of the rows.
        order: Number of states; chosen when left out.
        lags: Observer lags p; chosen from the data when left out.
        method: best (several ways, judged by cross-validation), okid-era (the paper's), era-dc, pbsid, or deconvolution
            (Eq. 9c as printed). Left out: best; pbsid with --update or --stream. Where all names end in _m_s or _rad_s, best
            takes zero for rest unless held-out data speak against it.
        delays: Dead time of each input in samples (0,2), or auto to find it.
        solver: gram, or qr: slower, exact on data without noise.
        stable: Mirror poles outside the unit circle.
        validate: Share of each record, at its end, kept for validation.
        validate_on: Another log to validate on.
        update: Sums of earlier data (--sums) to go on from.
        forgetting: Factor on the weight of earlier data for each new sample, for example 0.999; 1 forgets nothing.
        stream: Read the file in chunks, in bounded memory; by itself above 256 MB.
        sums: Where the sums of all data are written, for --update.
        page: Where the page of plots is written; beside the model when left out.
        no_page: Write no page.
        out: Where the model is written, .json or .mat.
    """
    from treadline.identification import METHODS, SOLVERS
    from treadline.io.model_files import write_model

    if not logs:
        raise SettingsError("identify needs at least one log: a file or a run folder")
    for option, value, allowed in (("--method", method, METHODS), ("--solver", solver, SOLVERS)):
        if value is not None and value not in allowed:
            raise SettingsError(f"{option} is '{value}'; allowed: {', '.join(allowed)}")
    _check_pairs(
        (
            (validate, validate_on, "give --validate or --validate-on, not both"),
            (delays, sums or update, "--delays shifts the inputs before they are summed: sums, saved or updated, cannot know it"),
        )
    )
    u, y = _channels(inputs, outputs)
    long = [path for path in logs if path.suffix.lower() in STREAMED and path.is_file() and path.stat().st_size > STREAMED_BYTES]
    if stream or (stream is None and long and method != "best" and update is None):
        for name, given in (
            ("--validate", validate),
            ("--validate-on", validate_on),
            ("--update", update),
            ("--delays", delays),
            ("--resample", resample or None),
            ("--stable", stable or None),
            ("--forgetting", None if forgetting == 1.0 else forgetting),
        ):
            if given is not None:
                raise SettingsError(f"{name} needs the whole record; give --no-stream")
        found = _streamed(logs, u, y, period, order, lags, method or "pbsid", solver, allow_gaps=allow_gaps)
    else:
        found = _whole(
            logs,
            u,
            y,
            period,
            order,
            lags,
            method,
            _delays(delays),
            solver,
            validate if validate_on is None else validate_on,
            update,
            forgetting,
            resample=resample,
            allow_gaps=allow_gaps,
            stable=stable,
        )
    report = found.report
    write_model(found.model, out)
    if sums is not None:
        found.gram.save(sums)
    written = {"model": str(out)} | ({} if sums is None else {"sums": str(sums)})
    if not no_page:
        written["page"] = str(_write_page(found, page if page is not None else out.with_suffix(".html"), logs))
    fits = ", ".join(f"{name} {value:.1f} %" for name, value in report.fit_percent.items())
    ahead = ", ".join(f"{name} {value:.1f} %" for name, value in report.one_step_vaf_percent.items())
    on = "data held out" if validate is not None or validate_on is not None else "the data that were fitted"
    return Answer(
        values=report.as_json() | written,
        summary=[
            f"order {report.order} with {report.lags} lags ({report.method}: {report.subspace}, {report.step}), "
            f"{report.samples} samples",
            f"on {on}: free run fits {fits} (100 is perfect, 0 no better than the mean)",
            f"one step ahead: {ahead} of the variance",
            f"written: {', '.join(written.values())}",
            *(f"warning: {warning}" for warning in report.warnings),
        ],
    )


def _whole(
    logs: Sequence[Path],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    period: float | None,
    order: int | None,
    lags: int | None,
    method: str | None,
    delays: list[int] | str | None,
    solver: str,
    validation: float | Path | None,
    update: Path | None,
    forgetting: float,
    *,
    resample: bool,
    allow_gaps: bool,
    stable: bool,
) -> "Identified":
    from treadline.cli.progress import Status
    from treadline.identification import Gram
    from treadline.identification import identify as fit
    from treadline.io.records import read_record
    from treadline.models import InputOutputRecord

    def read(path: Path) -> InputOutputRecord:
        return read_record(path, inputs, outputs, period_s=period, resample=resample, allow_gaps=allow_gaps)

    with Status("reading") as status:
        records = [read(path) for path in logs]
        judged = read(validation) if isinstance(validation, Path) else validation
        status.say("identifying")
        found = fit(
            records,
            order=order,
            lags=lags,
            method=method,
            delays=delays,
            solver=solver,
            stable=stable,
            validation=judged,
            prior=None if update is None else Gram.load(update),
            forgetting=forgetting,
            told=status.say,
        )
        status.say("judging")
        found.report  # noqa: B018 - computed here, where a person sees what takes time
    return found


def _streamed(
    logs: Sequence[Path],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    period: float | None,
    order: int | None,
    lags: int | None,
    method: str,
    solver: str,
    *,
    allow_gaps: bool,
) -> "Identified":
    from treadline.cli.progress import Share
    from treadline.identification import identify_chunks
    from treadline.io.chunks import read_chunks

    if len(logs) > 1:
        raise SettingsError(f"{len(logs)} logs; a stream is one experiment: give one log, or --no-stream")
    reader = read_chunks(logs[0], inputs, outputs, period_s=period, allow_gaps=allow_gaps)
    with Share(f"reading {logs[0].name}", lambda: reader.fraction) as share:
        return identify_chunks(share.of(reader), order=order, lags=lags, method=method, solver=solver)


def _check_pairs(pairs: Sequence[tuple[object, object, str]]) -> None:
    for one, other, why in pairs:
        if one is not None and other is not None:
            raise SettingsError(why)


def _channels(inputs: str, outputs: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    u, y = words("--inputs", inputs), words("--outputs", outputs)
    both = [name for name in u if name in y]
    if both:
        raise SettingsError(f"'{both[0]}' is given to --inputs and to --outputs; a column is one or the other")
    return u, y


def _delays(text: str | None) -> list[int] | str | None:
    if text is None or text == "auto":
        return text
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise SettingsError(f"--delays is '{text}'; give auto, or one whole number per input, for example 0,2") from None


def _write_page(found: "Identified", path: Path, logs: Sequence[Path]) -> Path:
    from treadline.cli.progress import Status
    from treadline.identification.stabilisation import stabilisation_of_svd
    from treadline.report.identification import write_identification_page

    title = ", ".join(path.name for path in logs[:3]) + (f" and {len(logs) - 3} more" if len(logs) > 3 else "")
    with Status("drawing"):
        diagram = stabilisation_of_svd(found.svd, found.model.dt_s)
        write_identification_page(path, found, found.fitted, found.judged, title=title, stabilisation=diagram)
    return path
