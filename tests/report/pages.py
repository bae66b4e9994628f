"""One page of each kind from a small input, and changes of that input, whose effect on the page a golden file lists."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from systems import system, white_record

from treadline.core.linear_systems import impulse_response
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.signals import Event
from treadline.identification import CandidateScore, IdentificationOptions, Identified, identify
from treadline.identification._era import HankelSvd
from treadline.identification.stabilisation import stabilisation_of_svd
from treadline.playback import Recording
from treadline.report import write_report
from treadline.report.identification_page import IdentificationPage
from treadline.report.player_page import player_page
from treadline.scenario.faults import Fault

from .conftest import climbing, reproduced, write_reproduction, write_run

Make = Callable[[Path], str]
"""Writes a page into an empty folder, and returns it."""
MakeRecord = Callable[[], InputOutputRecord]

# ---- runs ----

SEAT = {"settle_s": 1.73, "start_deg": 24.1, "steady_error_deg": 0.001, "steady_rms_deg": 0.01, "max_error_deg": 0.95}
PHASES = [(0.0, "search"), (0.1, "align"), (5.4, "approach"), (9.9, "climb"), (25.0, "arrived")]
SCORES = {"frames": 151, "brakes_differ": 0, "largest_command_gap_m_s": 0.5, "vision_rms_error_deg": 0.0033, "energy_wh": 1.234}
SCORES |= {"seconds_below_7_deg": 0.05, "max_belt_force_n": 312.4, "ms_per_frame": 3.21, "foreign": 7}


def read(folder: Path) -> str:
    """Return the page of a run or of a reproduction."""
    return write_report(folder).read_text(encoding="utf-8")


def of_run(**changes: Any) -> Make:
    return lambda folder: read(write_run(folder / "run", **changes))


RUNS = {
    "a run that was held": of_run(**SCORES),
    "the seat alone": of_run(seat=SEAT, min_stability_margin_deg=22.7, events=(), command="treadline seat paper-28"),
    "a traversal": of_run(events=[{"t_s": 0.2 * k, "name": name, "cause": "known"} for k, (_, name) in enumerate(PHASES)]),
    "a real chair": of_run(settings={"robot": {"name": "chair 7", "mission": {"chair": "wheelchair"}}}, verdict="fell", cause=None),
}

# ---- player ----


def held() -> Recording:
    """Return a run that loses friction at 2 s and is held at 3 s, re-armed at 4 s."""
    run = climbing(cause="nosings in view")
    added = (Event(t_s=3.0, name="hold", cause="rolled back 0.26 m"), Event(t_s=4.0, name="rearmed", cause="attendant"))
    fault = Fault(kind="low_friction", at_s=2.0, for_s=3.0, value=0.35)
    scenario = run.scenario.model_copy(update={"fault": (fault,)})
    return replace(run, events=(*run.events, *added), scenario=scenario, friction_use=np.where(run.t_s < 2.0, 0.8, 2.3))


def unplaced() -> Recording:
    run = climbing()
    return replace(run, p_WB=np.full_like(run.p_WB, np.nan), scenario=None, missing=("The log holds no pose.",))


PLAYERS: dict[str, Make] = {
    "a climb": lambda _: player_page(climbing()),
    "a climb that loses friction and is held": lambda _: player_page(held()),
    "a log without poses": lambda _: player_page(unplaced()),
}

# ---- reproduction ----


def with_pages(folder: Path) -> str:
    """Return the page of the seat alone, with a stage of Fig. 5, its run, a further run, and one whose log is cut."""
    reproduction = write_reproduction(folder / "reproduce", {"quick": False, "fig11": reproduced()["fig11"]})
    (reproduction / "figures").mkdir()
    (reproduction / "figures" / "fig05-2.png").write_bytes(b"\x89PNG\r\n\x1a\nrest")
    for name in ("seat-28", "turn-30-minus30-seed4", "turn-cut"):
        write_run(reproduction / "runs" / name)
    cut = reproduction / "runs" / "turn-cut" / "log.mcap"
    cut.write_bytes(cut.read_bytes()[:-100])
    return read(reproduction)


def changed(folder: Path) -> str:
    """Return the page of a slope that the paper lacks, of runs that ended early or did not settle, and of a lost run."""
    results = reproduced()
    for row in (*results["table2"], *results["fig09"], *results["fig10"], *results["fig08"]["slopes"]):
        row["slope_deg"] = 22.5 if row["slope_deg"] == 25 else row["slope_deg"]
    ended = {"averaged": 4, "ended_early": ["seed 2 fell after 1.7 s"], "rms_heading_deg": None, "settle_s": None}
    results["table2"][0] |= ended | {"paper_deg": None}
    results["table2"][1] |= {"paper_deg": 2.83, "rms_heading_deg": 2.09, "steady_rms_heading_deg": 0.03}
    results["fig05"] |= {"heading_deg": None, "robust_heading_deg": None, "reason": "too dark"}
    results["fig11"]["settle_s"] = None
    reproduction = write_reproduction(folder / "reproduce", results)
    (reproduction / "runs" / results["fig10"][0]["run"]).rename(folder / "away")
    return read(reproduction)


REPRODUCTIONS: dict[str, Make] = {
    "a small reproduction": lambda folder: read(write_reproduction(folder / "reproduce", reproduced())),
    "with pages of runs": with_pages,
    "with other results": changed,
    "with nothing measured": lambda folder: read(write_reproduction(folder / "reproduce", {"quick": True})),
}

# ---- identification ----

A_CALM = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.0], [0.0, 0.0, 0.5]])
TWO = (("left_m_s", "right_m_s"), ("heading_rad", "yaw_rate_rad_s"))
ONE = (TWO[0][:1], TWO[1][:1])


def model_with(A: Float[np.ndarray, "n n"], inputs: Sequence[str], outputs: Sequence[str]) -> LinearModel:
    rng = np.random.default_rng(1)
    n, m, p = len(A), len(inputs), len(outputs)
    B, C, K = rng.standard_normal((n, m)), 0.1 * rng.standard_normal((p, n)), rng.standard_normal((n, p))
    names = {"input_names": tuple(inputs), "output_names": tuple(outputs)}
    return system(A, B, C, dt_s=0.25, input_offset=np.full(m, 0.2), observer_gain=K, **names)


def record_of(model: LinearModel, samples: int = 400, seed: int = 0) -> InputOutputRecord:
    return replace(white_record(model, seed, samples, noise=0.01), input_names=model.input_names, output_names=model.output_names)


@cache
def found(names: tuple[tuple[str, ...], tuple[str, ...]] = ONE) -> Identified:
    """Return what identification hands over for a known plant of order 3."""
    return identify(record_of(model_with(A_CALM, *names)), IdentificationOptions(order=3, lags=4))


def candidates(count: int, chosen: int) -> list[CandidateScore]:
    return [CandidateScore(order=k, decay=0.5, distance=0.2 + 0.001 * k, chosen=k == chosen) for k in range(count)]


def identification_page(folder: Path, model: LinearModel | None = None, judged: MakeRecord | None = None, **changes: Any) -> str:
    """Return the page of an identification whose model and report are changed; ``title``, ``bare``: those of the page."""
    there = found(changes.pop("names", ONE))
    judge = there.judge.free if model is None and judged is None else None
    records = [judged()] if judged is not None else there.fitted if judge is None else there.judge.judged
    said = (
        "the last third, by a model of the first two" if judge else "the fitted data" if judged is None else "the validation data"
    )
    changes = {"judged_on": said, "judged_samples": sum(map(len, records))} | changes
    model = model or there.model
    fitted = there.fitted if model.D.shape == there.model.D.shape else records
    title, bare = changes.pop("title", "a chair"), changes.pop("bare", False)
    svd = changes.pop("svd", there.svd)
    report = replace(there.report, **({"candidates": candidates(3, 1), "seconds": 0.01} | changes))
    path = folder / "page.html"
    diagram = stabilisation_of_svd(svd, model.dt_s, chosen=model.order)
    extras = {"judge": judge} if bare else {"judge": judge, "intervals": there.intervals, "stabilisation": diagram}
    IdentificationPage(title=title, model=model, said=report, records=fitted, judged=records, **extras).write(path)
    return path.read_text(encoding="utf-8")


def identified(*given: Any, **changes: Any) -> Make:
    return lambda folder: identification_page(folder, *given, **changes)


def with_gaps() -> InputOutputRecord:
    record = record_of(found().model, 600)
    record.y[100:110, 0] = np.nan
    record.u[300, 0] = np.nan
    return record


def without_outputs() -> InputOutputRecord:
    record = record_of(found().model)
    record.y[:] = np.nan
    return record


EXACT = HankelSvd(markov=impulse_response(model_with(A_CALM, *ONE), 41), rows=20, columns=20)
"""Impulse response without noise: beyond its order there is nothing that could come back."""
DELAYED = replace(model_with(A_CALM, *ONE), input_delay=(2,))
DEGREES = replace(DELAYED, input_names=("wheel_rad_s",), output_names=("heading_deg",))
INTEGRATOR = model_with(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]), *ONE)
UNSURE = {"warnings": [], "singular_values": [], "pole_ci95": None, "whiteness_p": None, "crosscorrelation_p": None}
IDENTIFICATIONS = {
    "one input and one output": identified(bare=True, **UNSURE),
    "data that were not fitted, with gaps": identified(None, with_gaps, bare=True, **UNSURE),
    "many candidates and a rejected model": identified(
        bare=True,
        **UNSURE
        | {"candidates": candidates(50, 45), "noise_level": 0.02, "mirrored": True, "delays": [2]}
        | {"whiteness_p": 0.0, "crosscorrelation_p": 0.0001, "singular_values": [3.0, 1.0, 0.01, 0.005, 1e-17]},
    ),
    "dead time and degrees": identified(DEGREES, bare=True, **UNSURE),
    "an integrator and a delay of one sample": identified(
        INTEGRATOR, bare=True, **UNSURE | {"poles": [(1.0, 0.0), (0.0, 0.0), (0.0, 0.0)], "pole_ci95": [0.01] * 3}
    ),
    "an unstable model": identified(
        model_with(np.diag([1.05, 0.5]), *ONE), bare=True, **UNSURE | {"fit_percent": None, "poles": [(1.05, 0.0), (0.5, 0.0)]}
    ),
}
IDENTIFICATIONS_OF_TWO = {
    "two inputs and two outputs": identified(names=TWO),
    "no pole is stable, and outputs without a sample": identified(None, without_outputs, svd=EXACT, warnings=[]),
}

PAGES: dict[str, dict[str, Make]] = {
    "run": RUNS,
    "player": PLAYERS,
    "reproduction": REPRODUCTIONS,
    "identification": IDENTIFICATIONS,
    "identification_of_two": IDENTIFICATIONS_OF_TWO,
}
"""Pages by kind; all but the first of a kind are changes of its input."""
