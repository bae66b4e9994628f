"""The page of one identification: what was fitted, how well, how sure, and how to read each figure.

It takes a model, its report and the records as values: whoever identified hands them over.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.figure import Figure

from treadline.core import transfer_function as transfer
from treadline.core.arrays import NORMAL_95, spectral_radius
from treadline.core.files import write_whole
from treadline.core.linear_systems import impulse_response, part
from treadline.core.model_scores import compare
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.other_libraries import as_matlab, as_python, as_transfer_function
from treadline.identification import IdentificationReport
from treadline.report import _model_figures as figures
from treadline.report import _model_runs as runs
from treadline.report.html_pages import page_of
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


@dataclass(eq=False, kw_only=True)
class IdentificationPage:
    """Page of an identification; collects drawings, notes and values on the way through its sections."""

    title: str
    model: LinearModel
    said: IdentificationReport
    """Report of the identification."""
    records: Sequence[InputOutputRecord]
    """Records that were fitted."""
    judged: Sequence[InputOutputRecord]
    """Records that the figures of fit are of; the longest is drawn."""
    judge: LinearModel | None = None
    """Model that is judged, fitted to other data than these; None: the model itself."""
    intervals: Any | None = None
    """Confidence intervals of the identification, as ``Identified.intervals``."""
    stabilisation: transfer.StabilisationDiagram | None = None
    """Poles of every order, for the stabilisation diagram."""
    notes: list[str] = field(default_factory=list)
    drawn: dict[str, Figure] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        model = self.model
        self.inputs = [channel(name) for name in model.input_names or [f"u{j + 1}" for j in range(model.B.shape[1])]]
        self.outputs = [channel(name) for name in model.output_names or [f"y{i + 1}" for i in range(model.C.shape[0])]]
        self.drawn_in, self.drawn_out = self.inputs[:PAIRS_MOST], self.outputs[:PAIRS_MOST]
        self.unstable = transfer.is_unstable(model)

    def write(self, path: Path) -> None:
        """Write one HTML file that shows the identification and needs nothing else.

        Raises:
            TreadlineError: If the file cannot be written.
        """
        write_whole(path, self.html())

    def html(self) -> str:
        """Return the page."""
        self._head()
        self._order()
        self._responses()
        record, ahead = self._fit()
        self._residuals(record, ahead)
        self._poles()
        names = [item.name for item in self.inputs], [item.name for item in self.outputs]
        self.values["copies"] = {
            "Python": as_python(self.model),
            "MATLAB": as_matlab(self.model),
            "Transfer function": as_transfer_function(self.model, *names),
        }
        return page_of(
            "identification.html.j2",
            {name: [short_svg(figure)] for name, figure in self.drawn.items()},
            title=self.title,
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
        self.values["given_samples"] = sum(len(record) for record in self.records)
        self.values["given_records"] = len(self.records)
        tried = self.said.candidates
        self.values["candidates"] = [item for k, item in enumerate(tried) if k < CANDIDATES_MOST or item.chosen]
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
                f"the model is unstable (spectral radius {spectral_radius(self.model.A):.4f}): responses are followed up to "
                f"a {transfer.GROWTH_MOST:.0f}-fold growth, and forecasts stand in place of free runs"
            )

    def _order(self) -> None:
        values = np.asarray(self.said.singular_values, dtype=float)
        if values.size and values[0] > 0.0:
            self.drawn["hankel"] = figures.singular_values(values, self.model.order, self.said.noise_level)
        if self.stabilisation is not None and self.stabilisation.order.size:
            self.drawn["stabilisation"] = figures.stabilisation(self.stabilisation)

    def _responses(self) -> None:
        p, m, dt_s = len(self.drawn_out), len(self.drawn_in), self.model.dt_s
        response = impulse_response(self.model, transfer.response_steps(self.model))[:, :p, :m]
        longest = max((len(record) for record in self.records), default=1000)
        omega = transfer.frequency_grid(self.model, longest)
        modelled = (omega / (2.0 * math.pi * dt_s), transfer.frequency_response(self.model, omega)[:, :p, :m])
        spread = spread_f = None
        if self.intervals is not None:
            spread = self.intervals.impulse(len(response))[:, :p, :m]
            spread_f = self.intervals.frequency(omega)[:, :p, :m]
        estimate = runs.measured_response(self.records)
        measured = None if estimate is None else (estimate[0] / (2.0 * math.pi * dt_s), estimate[1][:, :p, :m])
        channels = (self.drawn_in, self.drawn_out)
        self.drawn["impulse"] = figures.time_response(response, spread, dt_s, *channels)
        self.drawn["step"] = figures.time_response(np.cumsum(response, axis=0), None, dt_s, *channels, after="step")
        self.drawn["frequency"], self.drawn["phase"] = figures.frequency_response(modelled, spread_f, measured, *channels)
        gain = transfer.static_gain(self.model)[:p, :m]
        self.values["static_gain"] = [(item, row.tolist()) for item, row in zip(self.drawn_out, gain, strict=True)]
        self.values["bands"] = self.intervals is not None
        self.values["measured"] = measured is not None
        self.values["steps"] = len(response)

    def _fit(self) -> tuple[InputOutputRecord, Float[np.ndarray, "T p"]]:
        place = int(np.argmax([len(record) for record in self.judged]))
        whole = self.judged[place]
        record = part(whole, 0, SAMPLES_MOST)
        if len(whole) > SAMPLES_MOST:
            self.notes.append(f"figures of fit and residuals show the first {SAMPLES_MOST} of {len(whole)} samples")
        comparison = compare(self.judge or self.model, record)
        free, ahead, p = comparison.modelled, comparison.ahead, len(self.drawn_out)
        shown, left = runs.cut(free[:, :p], record.y[:, :p])
        ahead_shown, left_ahead = runs.cut(ahead[:, :p], record.y[:, :p])
        names = [item.name for item, away in zip(self.drawn_out, left | left_ahead, strict=True) if away]
        if names:
            self.notes.append(f"the run of {', '.join(names)} leaves three spans of the data around their middle and is cut there")
        closer = runs.typical_span(record.y[:, :p] - free[:, :p], CLOSER) if len(record) > 2 * CLOSER else None
        t = np.arange(len(record)) * record.dt_s
        self.drawn["fit"] = figures.fit(t, record.y[:, :p], shown, ahead_shown, closer, self.drawn_out, kind=comparison.kind)
        self.values["conditions"] = comparison.conditions
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
        own_band = NORMAL_95 / np.sqrt(counts)
        self.drawn["residuals"] = figures.residuals(own, own_band, across, band, self.drawn_in, self.drawn_out)

    def _poles(self) -> None:
        values, spread = np.array([complex(*pair) for pair in self.said.poles], dtype=complex), self.said.pole_ci95
        zeros = transfer.zeros(self.model)
        self.drawn["poles"] = figures.poles(values, spread, zeros)
        self.values["zeros"] = _zero_texts(zeros)
        self.values["pair_zeros"] = [
            (item, [", ".join(_zero_texts(transfer.zeros(self.model.pair(i, j)))) or "none" for j in range(len(self.drawn_in))])
            for i, item in enumerate(self.drawn_out)
        ]
        self.values["poles"] = _pole_rows(values, spread, self.model.dt_s)
        self.values["discs"] = spread is not None
        self.values["discs_left"] = sum(not radius < figures.DISC_MOST for radius in spread or [])


def _pole_rows(values: Complex[np.ndarray, " n"], spread: Sequence[float] | None, dt_s: float) -> list[dict[str, str]]:
    known = [None] * len(values) if spread is None else list(spread)
    # The slowest first; of a pair the upper one speaks for both.
    chosen = [k for k in np.argsort(-np.abs(values), kind="stable").tolist() if values[k].imag >= -1e-12]
    return [_pole_row(complex(values[k]), known[k], dt_s) for k in chosen]


def _pole_row(pole: complex, radius: float | None, dt_s: float) -> dict[str, str]:
    pair = pole.imag > 1e-12
    value = _number_text(pole)
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


def _number_text(value: complex) -> str:
    """Return a pole or zero as text; one of a pair stands for both."""
    text = f"{value.real:.5f} ± {value.imag:.5f}i" if value.imag > 1e-12 else f"{value.real:.5f}"
    return text.replace("-", "−")


def _zero_texts(zeros: Complex[np.ndarray, " k"]) -> list[str]:
    """Return zeros as texts; one of a pair stands for both."""
    return [_number_text(complex(value)) for value in zeros if value.imag >= -1e-12]
