"""The page of one identification: offline, escaped, honest about warnings, gaps and models that grow."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from systems import system, white_record

from treadline.core import linear_systems as validate
from treadline.core import transfer_function as transfer
from treadline.core.arrays import decimated
from treadline.core.errors import TreadlineError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.experiments.as_printed import paper_model
from treadline.identification import CandidateScore, IdentificationOptions, IdentificationReport, identify
from treadline.identification._era import HankelSvd
from treadline.identification.stabilisation import StabilisationDiagram, stabilisation_of_svd
from treadline.report import _model_figures as figures
from treadline.report import _model_runs as runs
from treadline.report.identification_page import write_identification_page
from treadline.report.labels import channel

HOSTILE = '<script>alert("x")</script><img src=http://example.org/x onerror=alert(1)>{{ 7*7 }}$x$ --><b>'
SECTIONS = {"identified", "order", "responses", "frequency", "fit", "residuals", "poles", "copy"}
SIZE_MOST = 1_500_000


def candidates(count: int, chosen: int) -> list[CandidateScore]:
    return [CandidateScore(order=k, decay=0.5, distance=0.2 + 0.001 * k, chosen=k == chosen) for k in range(count)]


class FakeIntervals:
    """A deviation of a tenth of a unit everywhere."""

    def __init__(self, outputs: int, inputs: int, deviation: float = 0.1) -> None:
        self._shape, self._deviation = (outputs, inputs), deviation

    def impulse(self, steps: int) -> Float[np.ndarray, "steps p m"]:
        return np.full((steps, *self._shape), self._deviation)

    def frequency(self, omega_rad: Float[np.ndarray, " w"]) -> Float[np.ndarray, "w p m"]:
        return np.full((len(omega_rad), *self._shape), self._deviation)


@dataclass(frozen=True, kw_only=True)
class Found:
    """What identification hands over."""

    model: LinearModel
    report: IdentificationReport
    intervals: FakeIntervals | None = None


class Outline(HTMLParser):
    """Fails on a page whose elements do not close in order; collects ids and figures."""

    VOID = frozenset({"meta", "br", "img"})

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.ids += [value or "" for name, value in attrs if name == "id"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def outline_of(page: str) -> Outline:
    outline = Outline()
    outline.feed(page)
    outline.close()
    assert outline.open == []
    assert len(outline.ids) == len(set(outline.ids))
    return outline


def model_with(A: Float[np.ndarray, "n n"], inputs: Sequence[str], outputs: Sequence[str]) -> LinearModel:
    rng = np.random.default_rng(1)
    n, m, p = len(A), len(inputs), len(outputs)
    B, C, K = rng.standard_normal((n, m)), rng.standard_normal((p, n)), 0.1 * rng.standard_normal((n, p))
    names = {"input_names": tuple(inputs), "output_names": tuple(outputs)}
    return system(A, B, C, dt_s=0.25, input_offset=np.full(m, 0.2), observer_gain=K, **names)


def record_of(model: LinearModel, samples: int = 400, seed: int = 0) -> InputOutputRecord:
    return white_record(model, seed, samples, noise=0.01)


def found_with(model: LinearModel, **changes: Any) -> Found:
    poles = np.linalg.eigvals(model.A)
    report = IdentificationReport(
        order=model.order,
        lags=4,
        method="best",
        subspace="okid-era",
        step="subspace",
        feedthrough=True,
        mirrored=False,
        delays=[0] * model.B.shape[1],
        singular_values=[3.0, 1.0, 0.01, 0.005, 1e-17],
        gap=100.0,
        noise_level=None,
        poles=[(float(pole.real), float(pole.imag)) for pole in poles],
        pole_ci95=[0.01] * len(poles),
        fit_percent=dict.fromkeys(model.output_names, 91.234),
        fit_prefix_s=10.0,
        forecast_percent=None,
        forecast_horizon_s=None,
        fit_conditions="free run from the state of the first 10 s",
        one_step_vaf_percent=dict.fromkeys(model.output_names, 99.5),
        whiteness_p=0.4,
        crosscorrelation_p=None,
        excitation_order=12,
        samples=400,
        dropped=0,
        candidates=[],
        warnings=[],
        seconds=0.01,
    )
    return Found(model=model, report=replace(report, **changes), intervals=FakeIntervals(*model.D.shape))


def page_of(tmp_path: Path, found: Any, judged: list[InputOutputRecord] | None = None, **more: Any) -> str:
    records = more.pop("fitted", None) or [record_of(found.model)]
    path = tmp_path / "page.html"
    title = more.pop("title", "a chair")
    write_identification_page(
        path, found.model, found.report, records, judged or records, title=title, intervals=found.intervals, **more
    )
    return path.read_text(encoding="utf-8")


def diagram_of(model: LinearModel) -> StabilisationDiagram:
    """Return the stabilisation diagram of a model's own impulse response."""
    markov = validate.impulse_response(model, 41)
    return stabilisation_of_svd(HankelSvd(markov=markov, rows=20, columns=20), model.dt_s)


A_CALM = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.0], [0.0, 0.0, 0.5]])
TWO = (("left_m_s", "right_m_s"), ("heading_rad", "yaw_rate_rad_s"))


@pytest.fixture(scope="module")
def calm() -> Found:
    return found_with(model_with(A_CALM, *TWO))


@pytest.fixture(scope="module")
def small() -> Found:
    """One input and one output: drawn three times as fast."""
    return found_with(model_with(A_CALM, TWO[0][:1], TWO[1][:1]))


@pytest.fixture(scope="module")
def small_page(tmp_path_factory: pytest.TempPathFactory, small: Found) -> str:
    return page_of(tmp_path_factory.mktemp("small"), small)


def test_the_page_is_whole_asks_for_nothing_and_has_a_figure_in_each_section(tmp_path: Path, calm: Found) -> None:
    page = page_of(tmp_path, calm, stabilisation=diagram_of(calm.model))
    outline = outline_of(page)
    assert set(outline.ids) >= SECTIONS
    parts = re.split(r'<h2 id="', page)[1:]
    drawn = {part[: part.index('"')]: part.count("<svg") for part in parts}
    one_each = {"fit": 1, "residuals": 1, "poles": 1}
    assert drawn == {"identified": 0, "order": 2, "responses": 2, "frequency": 2, **one_each, "copy": 0}
    assert "91.23 %" in page
    assert len(page.encode()) < SIZE_MOST
    # It asks for nothing and runs nothing.
    assert not re.search(r"https?:|@import|\son\w+=", page)
    assert outline.tags.isdisjoint({"script", "img", "link", "iframe", "object", "image", "foreignObject"})
    assert "default-src 'none'" in page
    assert all(target.startswith("#") for target in re.findall(r'(?:href|src)="([^"]*)"', page))
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", page))


def test_hostile_names_titles_and_warnings_are_text(tmp_path: Path) -> None:
    model = model_with(A_CALM, (HOSTILE, "right\n\x00\x07" + "x" * 300), ("$\\frac{$", "見出し_rad"))
    found = found_with(model, warnings=[HOSTILE], method=HOSTILE, fit_conditions=HOSTILE)
    page = page_of(tmp_path, found, title=HOSTILE)
    outline = outline_of(page)
    assert outline.tags.isdisjoint({"script", "img", "b"})
    assert "<script" not in page
    assert outline.text.count('<script>alert("x")</script>') >= 4
    assert "{{ 7*7 }}" in page


def test_warnings_stand_before_the_first_section(tmp_path: Path, small: Found, small_page: str) -> None:
    said = "no clear gap in the singular values (largest ratio 1.3 at order 1); give --order, or more data"
    page = page_of(tmp_path, found_with(small.model, warnings=[said]))
    assert 0 < page.index(said) < page.index('<h2 id="identified"')
    assert 'class="note' not in small_page


def test_fit_says_what_it_was_measured_on(tmp_path: Path, small: Found, small_page: str) -> None:
    assert "on the data that were fitted, 400 samples; free run from the state of the first 10 s" in small_page
    other = record_of(small.model, 150, seed=7)
    assert "on data that were not fitted, 150 samples" in page_of(tmp_path, small, [other])


def test_what_is_not_known_is_said_to_be_unknown(tmp_path: Path, small: Found) -> None:
    bare = replace(found_with(small.model, pole_ci95=None, singular_values=[], whiteness_p=None), intervals=None)
    page = page_of(tmp_path, bare)
    assert "No singular values in the report" in page
    assert "No stabilisation diagram was made" in page
    assert page.count("no bands are drawn") + page.count("so no bands are drawn") >= 2
    assert "no discs are" in page


def test_the_model_is_marked_also_where_the_list_is_cut_before_it(tmp_path: Path, small: Found) -> None:
    found = found_with(small.model, candidates=candidates(50, 45), noise_level=0.02, delays=[2], mirrored=True)
    page = page_of(tmp_path, found)
    (row,) = re.findall(r'<tr class="chosen">(.*?)</tr>', page)
    assert re.findall("<td>(.*?)</td>", row) == ["45", "0.5", "0.245", "the model"]
    text = " ".join(outline_of(page).text.split())
    assert "50 models of the ensemble" in text
    assert "9 more are not listed" in text
    assert "dead time [samples]2" in text
    assert "dashed line" in text


def test_an_output_that_answers_for_a_second_is_not_drawn_for_a_minute() -> None:
    t = 0.25 * np.arange(345)
    spike, slow = np.exp(-4.0 * t) + 0.01 * np.exp(-0.05 * t), np.exp(-0.05 * t)
    response = np.stack([slow, spike], axis=1)[:, :, None]
    figure = figures.time_response(response, None, 0.25, [channel("left_m_s")], [channel("heading_rad"), channel("yaw_rate_rad_s")])
    ends = [ax.lines[-1].get_xdata()[-1] for ax in figure.axes]
    assert ends[0] == t[-1]
    assert ends[1] < 6.0
    assert runs.answering(np.ones((100, 2))) == 100  # an integrator answers for good
    assert runs.answering(np.zeros((100, 2))) == transfer.STEPS_LEAST


def test_the_page_offers_zeros_gains_and_the_model_as_text(tmp_path: Path) -> None:
    model = replace(model_with(A_CALM, TWO[0][:1], TWO[1][:1]), input_delay=(2,))
    text = outline_of(page_of(tmp_path, found_with(model))).text
    zero = model.zeros()[0]
    assert f"{zero.real:.5f}".replace("-", "−") in text
    assert f"{abs(model.dcgain()[0, 0]):.4g}" in text
    assert "model = tl.LinearModel(" in text
    assert "ss(A, B, C, D, 0.25, 'InputDelay', [2])" in text
    assert "heading_rad / left_m_s = (" in text


def test_p_values_carry_their_verdict(tmp_path: Path, small: Found, small_page: str) -> None:
    assert "not rejected at 5 %" in small_page
    page = page_of(tmp_path, found_with(small.model, whiteness_p=0.0, crosscorrelation_p=0.0001))
    assert page.count("p &lt; 0.001") == 2
    assert "not rejected" not in page


def test_gaps_are_drawn_around_and_counted(tmp_path: Path, small: Found) -> None:
    record = record_of(small.model, 600)
    record.y[100:110, 0] = np.nan
    record.u[300, 0] = np.nan
    page = page_of(tmp_path, small, [record])
    assert "11 of them with a gap" in page
    record.y[:] = np.nan  # an output without a single sample is drawn empty
    outline_of(page_of(tmp_path, small, [record]))
    assert not re.search(r"\bnan\b", re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL), flags=re.IGNORECASE)


@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (3, 4), (6, 1)])
def test_any_number_of_channels_fits(tmp_path: Path, inputs: int, outputs: int) -> None:
    model = model_with(A_CALM, [f"u{j}_m_s" for j in range(inputs)], [f"y{i}_rad" for i in range(outputs)])
    page = page_of(tmp_path, found_with(model), [record_of(model, 1000, seed=2)])
    outline_of(page)
    assert len(page.encode()) < SIZE_MOST
    assert ("the first 4 of each are drawn" in page) == (inputs > 4)


@pytest.mark.parametrize("radius", [1.001, 1.05, 3.0])
def test_an_unstable_model_is_cut_and_said_to_be(tmp_path: Path, radius: float) -> None:
    model = model_with(np.diag([radius, 0.5]), TWO[0][:1], TWO[1][:1])
    record = record_of(model_with(np.diag([0.9, 0.5]), TWO[0][:1], TWO[1][:1]), 3000)
    page = page_of(tmp_path, found_with(model), [record], fitted=[record])
    assert f"the model is unstable (spectral radius {radius:.4f})" in page
    # The disc of 0.01 around 1.001 holds the integrator.
    assert ("grows e-fold" if radius > 1.01 else "consistent with an integrator (95 %)") in page
    assert len(page.encode()) < SIZE_MOST
    assert "forecast 2.5 s ahead (unstable model)" in page
    if radius > 2.0:  # within ten samples
        assert "is cut there" in page


def test_an_integrator_and_a_chain_of_delays_are_drawn(tmp_path: Path) -> None:
    A = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    model = model_with(A, TWO[0][:1], TWO[1][:1])
    page = page_of(tmp_path, found_with(model))
    assert "consistent with an integrator (95 %)" in page
    assert "a delay of one sample" in page


def test_channels_in_degrees_beside_radians_are_pointed_out(tmp_path: Path, small: Found, small_page: str) -> None:
    model = replace(small.model, input_names=("wheel_rad_s",), output_names=("heading_deg",))
    assert "channels in degrees (heading_deg) and in radians (wheel_rad_s)" in page_of(tmp_path, found_with(model))
    assert "in degrees" not in small_page


def test_a_long_record_is_thinned_to_a_small_page(tmp_path: Path, small: Found) -> None:
    page = page_of(tmp_path, small, [record_of(small.model, 30_000)])
    assert "the first 20000 of 30000 samples" in page
    assert len(page.encode()) < SIZE_MOST


def test_the_same_numbers_give_the_same_bytes_and_ten_samples_a_page(tmp_path: Path, small: Found, small_page: str) -> None:
    assert page_of(tmp_path, small) == small_page
    outline_of(page_of(tmp_path, small, [record_of(small.model, 10)]))


def test_a_page_that_cannot_be_written_is_refused(tmp_path: Path, small: Found) -> None:
    with pytest.raises(TreadlineError, match="cannot be written"):
        write_identification_page(tmp_path, small.model, small.report, [record_of(small.model)], [record_of(small.model)], title="")


def test_what_identify_returns_fits_the_page(tmp_path: Path) -> None:
    whole = replace(record_of(paper_model(), 1000), input_names=TWO[0], output_names=TWO[1])
    found = identify(validate.part(whole, 0, 700), IdentificationOptions(validation=validate.part(whole, 700, 1000)))
    text = outline_of(page_of(tmp_path, found, list(found.judged), fitted=found.fitted)).text
    assert "heading_rad" in text
    assert "on data that were not fitted, 300 samples" in text


def test_runs_begin_anew_behind_a_missing_input_and_bridge_missing_outputs(calm: Found) -> None:
    record = record_of(calm.model, 800)
    record.y[50] = np.nan
    record.u[400] = np.nan
    found = calm.model.compare(record)
    for answers in (found.ahead, found.modelled):
        assert np.isnan(answers[400]).all()
        assert np.isfinite(np.delete(answers, 400, axis=0)).all()
        assert not runs.cut(answers, record.y)[1].any()
    # The noise of the record is one per cent of each output's deviation.
    assert (np.nanstd(record.y - found.ahead, axis=0) < 0.05 * np.nanstd(record.y, axis=0)).all()


@pytest.mark.parametrize("A", [A_CALM, [[0.5, 1.0], [0.0, 0.5]]], ids=["diagonalisable", "defective"])
def test_responses_are_those_of_the_model(A: Any) -> None:
    model = model_with(np.array(A), *TWO)
    response = validate.impulse_response(model, transfer.response_steps(model))
    assert np.abs(response[-1]).max() < 0.05 * np.abs(response).max()
    omega = transfer.frequency_grid(model, 1000)
    assert omega[-1] == pytest.approx(math.pi)
    markov = validate.impulse_response(model, 400)
    np.testing.assert_allclose(response, markov[: len(response)], atol=1e-12)
    summed = np.einsum("wk,kpm->wpm", np.exp(-1j * np.outer(omega, np.arange(400))), markov)
    np.testing.assert_allclose(transfer.frequency_response(model, omega), summed, atol=1e-6)


@pytest.mark.parametrize("gap", [False, True])
def test_a_measured_response_follows_the_model_that_made_the_record(gap: bool) -> None:
    model = model_with(A_CALM, *TWO)
    record = record_of(model, 20_000)
    if gap:
        record.y[9_000:9_010] = np.nan
    estimate = runs.measured_response([record])
    assert estimate is not None
    omega, response = estimate
    true = transfer.frequency_response(model, omega)
    # Windows of 2500 samples resolve the resonance; with 15 of them and 1 % noise the median error is a few per cent.
    assert np.median(np.abs(response - true) / np.abs(true).max(axis=0)) < 0.03


def test_no_response_is_measured_where_inputs_explain_nothing_or_data_are_few() -> None:
    model = model_with(A_CALM, *TWO)
    record = record_of(model, 2000)
    noise = replace(record, y=np.random.default_rng(9).standard_normal(record.y.shape))
    estimate = runs.measured_response([noise])
    assert estimate is not None
    assert len(estimate[0]) < 0.2 * 125  # of 125 frequencies few pass by chance
    assert runs.measured_response([record_of(model, 100)]) is None


def test_a_delayed_copy_correlates_at_its_positive_lag() -> None:
    given = np.random.default_rng(0).standard_normal(500)
    late = np.concatenate([np.zeros(3), given[:-3]])
    r = runs.correlation(late, given, 10)
    assert int(np.argmax(r)) - 10 == 3
    assert r.max() > 0.95


def test_independent_white_series_stay_within_the_band_as_often_as_said() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 4000))
    band = runs.correlation_band(runs.correlation(a, a, 200), runs.correlation(b, b, 200), 4000)
    inside = np.abs(runs.correlation(a, b, 200)) <= band
    # 401 trials of 95 %: three deviations are 3.3 %.
    assert inside.mean() > 0.917


def test_thinning_keeps_peaks_and_gaps() -> None:
    values = np.zeros(100_000)
    values[54_321], values[60_000:70_000] = 7.0, np.nan
    t, thin = decimated(np.arange(100_000.0), values)
    assert len(thin) <= 600
    assert np.nanmax(thin) == 7.0
    assert np.isnan(thin).any()
    assert len(t) == len(thin)


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("left_m_s", "left", "m/s"),
        ("heading_rad", "heading", "rad"),
        ("yaw_rate_rad_s", "yaw_rate", "rad/s"),
        ("pitch_deg", "pitch", "°"),
        ("jerk_m_s2", "jerk", "m/s²"),
        ("channel_a", "channel_a", None),
        ("_m", "_m", None),
        ("cost_$", "cost_$", None),
    ],
)
def test_a_name_contains_its_unit(name: str, quantity: str, unit: str | None) -> None:
    said = channel(name)
    assert (said.quantity, said.unit) == (quantity, unit)
