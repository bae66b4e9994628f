"""The page of one identification: what was fitted, how well, how sure, and how to read each figure.

It takes a model, its report and the records as values: whoever identified hands them over.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.figure import Figure

from treadline.core.models import InputOutputRecord, LinearModel, write_whole
from treadline.core.printing import p_text
from treadline.identification.stabilisation import StabilisationDiagram
from treadline.identification.validate import head
from treadline.report import _model_figures as figures
from treadline.report import _model_runs as runs
from treadline.report._html import page_of
from treadline.report.labels import channel
from treadline.report.svg_figures import short_svg

PAIRS_MOST = 4
"""Largest number of inputs and of outputs drawn: sixteen panels fill a screen."""
SAMPLES_MOST = 20_000
"""Largest number of samples simulated for the figures: half a second of CPU time."""
CLOSER = 160
"""Length of the enlarged section [samples], in which single samples are visible."""
LAGS = 25
"""Number of lags in the residual tests."""
CANDIDATES_MOST = 40
"""Largest number of candidate structures listed."""
CHOSEN = "chosen"
"""Remark of the candidate structure that the model has."""


@runtime_checkable
class IntervalsLike(Protocol):
    """How sure a model's responses are."""

    def impulse(self, steps: int) -> Float[np.ndarray, "steps p m"]:
        """Return the standard deviation of the impulse response."""

    def frequency(self, omega_rad: Float[np.ndarray, " w"]) -> Float[np.ndarray, "w p m"]:
        """Return the standard deviation of |G| at frequencies in rad per sample."""


def write_identification_page(
    path: Path,
    model: LinearModel,
    report: Mapping[str, Any],
    records: Sequence[InputOutputRecord],
    judged: Sequence[InputOutputRecord],
    *,
    title: str,
    intervals: IntervalsLike | None = None,
    stabilisation: StabilisationDiagram | None = None,
) -> None:
    """Write one HTML file that shows an identification and needs nothing else.

    Args:
        report: The report of the identification as JSON values.
        records: The records that were fitted.
        judged: The records on which the model was judged; the longest is drawn.
        intervals: How sure the model's responses are.
        stabilisation: The poles of every order, for the stabilisation diagram.

    Raises:
        TreadlineError: If the file cannot be written.
    """
    write_whole(path, _Page(model, report, records, judged, intervals, stabilisation).html(title))


class _Page:
    """Collects drawings, notes and values on the way through the sections."""

    def __init__(
        self,
        model: LinearModel,
        report: Mapping[str, Any],
        records: Sequence[InputOutputRecord],
        judged: Sequence[InputOutputRecord],
        intervals: IntervalsLike | None,
        stabilisation: StabilisationDiagram | None,
    ) -> None:
        self.model, self.said = model, report
        self.records, self.judged = records, judged
        self.intervals, self.stabilisation = intervals, stabilisation
        self.inputs = [channel(name) for name in model.input_names or [f"u{j + 1}" for j in range(model.B.shape[1])]]
        self.outputs = [channel(name) for name in model.output_names or [f"y{i + 1}" for i in range(model.C.shape[0])]]
        self.drawn_in, self.drawn_out = self.inputs[:PAIRS_MOST], self.outputs[:PAIRS_MOST]
        self.unstable = runs.is_unstable(model)
        self.notes: list[str] = []
        self.drawn: dict[str, Figure] = {}
        self.values: dict[str, Any] = {}

    def html(self, title: str) -> str:
        """Return the page."""
        self._head()
        self._order()
        self._responses()
        record, ahead = self._fit()
        self._residuals(record, ahead)
        self._poles()
        return page_of(
            "identification.html.j2",
            {name: [short_svg(figure)] for name, figure in self.drawn.items()},
            title=title,
            said=self.said,
            notes=self.notes,
            inputs=self.inputs,
            outputs=self.outputs,
            unstable=self.unstable,
            period_s=self.model.dt_s,
            nyquist_hz=0.5 / self.model.dt_s,
            has_gain=self.model.observer_gain is not None,
            **self.values,
        )

    def _head(self) -> None:
        same = len(self.records) == len(self.judged) and all(
            a is b or (a.y.shape == b.y.shape and np.array_equal(a.y, b.y, equal_nan=True))
            for a, b in zip(self.records, self.judged, strict=True)
        )
        self.values["judged_on"] = "the data that were fitted" if same else "data that were not fitted"
        self.values["judged_samples"] = sum(len(record) for record in self.judged)
        self.values["given_samples"] = sum(len(record) for record in self.records)
        self.values["given_records"] = len(self.records)
        fit, ahead = self.said.get("fit_percent", {}), self.said.get("one_step_vaf_percent", {})
        self.values["fits"] = [(item, _number(fit.get(item.name)), _number(ahead.get(item.name))) for item in self.outputs]
        self.values["extra"] = {
            label: _words(self.said[key])
            for key, label in (("delays", "delays [samples]"), ("excitation_order", "order the inputs excite"))
            if self.said.get(key) is not None
        }
        if self.said.get("mirrored"):
            self.values["extra"]["the inputs act by"] = "their difference alone"
        self.values["gap"] = _number(self.said.get("gap"))
        self.values["candidates"], self.values["candidates_left"] = _table(self.said.get("candidates"))
        self.values["marked"] = any(chosen for chosen, _ in (self.values["candidates"] or ((), ()))[1])
        degrees, radians = ([c.name for c in (*self.inputs, *self.outputs) if mark in (c.unit or "")] for mark in ("°", "rad"))
        if degrees and radians:
            self.notes.append(
                f"channels in degrees ({', '.join(degrees)}) and in radians ({', '.join(radians)}) stand side by side; "
                "each axis names its own unit"
            )
        if len(self.inputs) > PAIRS_MOST or len(self.outputs) > PAIRS_MOST:
            self.notes.append(
                f"{len(self.inputs)} inputs and {len(self.outputs)} outputs: the first {PAIRS_MOST} of each are drawn"
            )
        if self.unstable:
            self.notes.append(
                f"the model is unstable (spectral radius {runs.radius(self.model):.4f}): responses are followed up to a "
                f"{runs.GROWTH_MOST:.0f}-fold growth, free runs are cut where they leave the data"
            )

    def _order(self) -> None:
        values = np.asarray(self.said.get("singular_values", []), dtype=float)
        if values.size and values[0] > 0.0:
            noise = self.said.get("noise_level")
            self.drawn["hankel"] = figures.singular_values(values, self.model.order, noise)
            self.values["noise_known"] = bool(noise)
        if self.stabilisation is not None and self.stabilisation.order.size:
            self.drawn["stabilisation"] = figures.stabilisation(self.stabilisation, self.model.order, 0.5 / self.model.dt_s)

    def _responses(self) -> None:
        p, m = len(self.drawn_out), len(self.drawn_in)
        response = runs.shown_response(self.model)
        longest = max((len(record) for record in self.records), default=1000)
        omega = runs.frequencies(self.model, longest)
        size = runs.frequency_response(self.model, omega)
        spread = spread_f = None
        if self.intervals is not None:
            spread = self.intervals.impulse(len(response))[:, :p, :m]
            spread_f = self.intervals.frequency(omega)[:, :p, :m]
        channels = (self.model.dt_s, self.drawn_in, self.drawn_out)
        self.drawn["impulse"] = figures.impulse(response[:, :p, :m], spread, *channels)
        self.drawn["frequency"] = figures.frequency(omega, size[:, :p, :m], spread_f, *channels)
        self.values["bands"] = self.intervals is not None
        self.values["steps"] = len(response)

    def _fit(self) -> tuple[InputOutputRecord, Float[np.ndarray, "T p"]]:
        place = int(np.argmax([len(record) for record in self.judged]))
        whole = self.judged[place]
        record = head(whole, SAMPLES_MOST)
        if len(whole) > SAMPLES_MOST:
            self.notes.append(f"figures of fit and residuals show the first {SAMPLES_MOST} of {len(whole)} samples")
        free, ahead = runs.free_run(self.model, record), runs.one_step_ahead(self.model, record)
        p = len(self.drawn_out)
        shown, left = runs.cut(free[:, :p], record.y[:, :p])
        ahead_shown, left_ahead = runs.cut(ahead[:, :p], record.y[:, :p])
        names = [item.name for item, away in zip(self.drawn_out, left | left_ahead, strict=True) if away]
        if names:
            self.notes.append(f"the run of {', '.join(names)} leaves three spans of the data around their middle and is cut there")
        closer = runs.typical_span(record.y[:, :p] - free[:, :p], CLOSER) if len(record) > 2 * CLOSER else None
        t = np.arange(len(record)) * record.dt_s
        self.drawn["fit"] = figures.fit(t, record.y[:, :p], shown, ahead_shown, closer, self.drawn_out)
        self.values["shown_record"] = f"record {place + 1} of {len(self.judged)}" if len(self.judged) > 1 else "the record"
        self.values["shown_samples"] = len(record)
        self.values["closer"] = None if closer is None else closer.stop - closer.start
        self.values["gaps"] = int(np.count_nonzero(~np.isfinite(np.hstack([record.u, record.y])).all(axis=1)))
        return record, ahead

    def _residuals(self, record: InputOutputRecord, ahead: Float[np.ndarray, "T p"]) -> None:
        lags = min(LAGS, len(record) // 4)
        e = (record.y - ahead)[:, : len(self.drawn_out)]
        u = record.u[:, : len(self.drawn_in)]
        counts = np.maximum(np.isfinite(e).sum(axis=0), 1)
        own = np.array([runs.correlation(column, column, lags) for column in e.T])
        given = [runs.correlation(column, column, lags) for column in u.T]
        across = np.array([[runs.correlation(column, other, lags) for other in u.T] for column in e.T])
        band = np.array([[runs.correlation_band(r, s, n) for s in given] for r, n in zip(own, counts.tolist(), strict=True)])
        own_band = figures.BAND / np.sqrt(counts)
        self.drawn["residuals"] = figures.residuals(own, own_band, across, band, self.drawn_in, self.drawn_out)
        self.values["lags_tested"] = lags
        self.values["tests"] = [
            (label, _p_value(self.said.get(key)), _smallest(self.said.get(key)))
            for label, key in (
                ("residuals are white", "whiteness_p"),
                ("residuals are independent of the inputs", "crosscorrelation_p"),
            )
            if self.said.get(key) is not None
        ]

    def _poles(self) -> None:
        values = np.array([complex(*pair) for pair in self.said.get("poles", [])])
        if not values.size:
            values = np.linalg.eigvals(self.model.A).astype(complex)
        spread = self.said.get("pole_ci95")
        if spread is not None and len(spread) != len(values):
            spread = None
        self.drawn["poles"] = figures.poles(
            values, None if spread is None else [math.nan if r is None else float(r) for r in spread]
        )
        self.values["poles"] = _pole_rows(values, spread, self.model.dt_s)
        self.values["discs"] = spread is not None
        self.values["discs_left"] = sum(r is not None and not r < figures.DISC_MOST for r in spread or [])


def _pole_rows(values: Complex[np.ndarray, " n"], spread: Sequence[float | None] | None, dt_s: float) -> list[dict[str, str]]:
    known = [None] * len(values) if spread is None else list(spread)
    # The slowest first; of a pair the upper one speaks for both.
    chosen = [k for k in np.argsort(-np.abs(values), kind="stable").tolist() if values[k].imag >= -1e-12]
    return [_pole_row(complex(values[k]), known[k], dt_s) for k in chosen]


def _pole_row(pole: complex, radius: float | None, dt_s: float) -> dict[str, str]:
    pair = pole.imag > 1e-12
    value = (f"{pole.real:.5f} ± {pole.imag:.5f}i" if pair else f"{pole.real:.5f}").replace("-", "−")
    said = "–" if radius is None else f"{radius:.2g}"
    if pole == 0:
        rest = {"frequency": "–", "damping": "–", "time_constant": "0", "remark": "a delay of one sample"}
        return {"value": value, "radius": said, **rest}
    rate = complex(np.log(pole))
    size, decay = abs(rate), -rate.real
    sure = radius is not None and abs(pole - 1.0) <= radius and not pair
    remark = (
        "consistent with an integrator (95 %)"
        if sure
        else "grows e-fold in this time"
        if decay < -1e-9
        else "one sample up, one down: sampling, not motion"
        if not pair and pole.real < 0.0
        else ""
    )
    return {
        "value": value,
        "radius": said,
        "frequency": f"{size / (2.0 * math.pi * dt_s):.4g}",
        "damping": f"{decay / size:.4g}".replace("-", "−") if size > 0.0 else "–",
        "time_constant": "∞" if abs(decay) < 1e-12 else f"{dt_s / abs(decay):.4g}",
        "remark": remark,
    }


def _number(value: Any) -> str:
    if not isinstance(value, int | float):
        return "–"
    return f"{value:.2e}" if abs(value) >= 1e5 else f"{round(value, 2) + 0.0:.2f}"


def _words(value: Any) -> str:
    """Return any JSON value as a few words."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {_words(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_words(item) for item in value)
    return str(value)


def _p_value(value: Any) -> str:
    return p_text(value) if isinstance(value, int | float) else f"p = {_words(value)}"


def _smallest(value: Any) -> float | None:
    """Return the smallest number in a JSON value."""
    if isinstance(value, int | float):
        return float(value)
    inner = list(value.values()) if isinstance(value, Mapping) else list(value) if isinstance(value, list | tuple) else []
    found = [number for number in map(_smallest, inner) if number is not None]
    return min(found, default=None)


def _table(candidates: Any) -> tuple[tuple[list[str], list[tuple[bool, list[str]]]] | None, int]:
    """Return heads and rows of a list of tried structures, and how many are left out; the chosen one is listed in any case."""
    if not isinstance(candidates, list | tuple) or not all(isinstance(item, Mapping) for item in candidates) or not candidates:
        return None, 0
    heads = [head for head in dict.fromkeys(str(key) for item in candidates for key in item) if head != CHOSEN]
    listed = [item for k, item in enumerate(candidates) if k < CANDIDATES_MOST or item.get(CHOSEN) is True]
    rows = [(item.get(CHOSEN) is True, [_words(item.get(head)) for head in heads]) for item in listed]
    return ([head.replace("_", " ") for head in heads], rows), len(candidates) - len(listed)
