"""``treadline identify``: from recorded runs to a linear model."""

from pathlib import Path

from treadline.cli.answer import Answer
from treadline.cli.numbers import words


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
    method: str = "okid-era",
    validate: float | None = None,
    validate_on: Path | None = None,
    out: Path = Path("model.json"),
) -> Answer:
    """Fit x[k+1] = Ax[k] + Bu[k], y[k] = Cx[k] + Du[k] to recorded runs (OKID, then ERA).

    Args:
        logs: CSV files or run folders; several are joined as separate experiments.
        inputs: Columns that drove the system.
        outputs: Columns that answered.
        period: Sampling period in seconds; read from the column t_s when left out.
        resample: Bring an irregular time axis to the period (inputs held, outputs interpolated).
        allow_gaps: Accept NaN in up to 20 % of the rows.
        order: Number of states; chosen from the singular values when left out.
        lags: Observer lags p; chosen from the data when left out.
        method: okid-era, or deconvolution (Eq. 9c as printed).
        validate: Share of the record, at its end, kept for validation.
        validate_on: Another log to validate on.
        out: Where the model is written.
    """
    from treadline.errors import SettingsError
    from treadline.identification import METHODS
    from treadline.identification import identify as fit
    from treadline.io.records import read_record
    from treadline.models import InputOutputRecord

    if not logs:
        raise SettingsError("identify needs at least one log: a CSV file or a run folder")
    if method not in METHODS:
        raise SettingsError(f"--method is '{method}'; allowed: {', '.join(METHODS)}")
    if validate is not None and validate_on is not None:
        raise SettingsError("give --validate or --validate-on, not both")
    u, y = words("--inputs", inputs), words("--outputs", outputs)

    def read(path: Path) -> InputOutputRecord:
        return read_record(path, u, y, period_s=period, resample=resample, allow_gaps=allow_gaps)

    found = fit(
        [read(path) for path in logs],
        order=order,
        lags=lags,
        method=method,
        validation=read(validate_on) if validate_on is not None else validate,
    )
    found.model.save(out)
    report = found.report
    fits = ", ".join(f"{name} {value:.1f} %" for name, value in report.one_step_vaf_percent.items())
    return Answer(
        values=report.as_json() | {"model": str(out)},
        summary=[
            f"order {report.order} with {report.lags} lags ({report.method}); one-step VAF {fits}; written to {out}",
            *(f"warning: {warning}" for warning in report.warnings),
        ],
    )
