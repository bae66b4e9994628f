"""``tl.climb``: one simulated traversal, with its scores, time series and figure."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.errors import TreadlineError
from treadline.core.printing import Printable
from treadline.run.episode import Traverse, run_episode
from treadline.run.recorded_run import recorded_run, series
from treadline.run.resolve import ControllerSource, DetectorSource, EstimatorSource, resolve
from treadline.run.run_scores import Scores
from treadline.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Run(Printable):
    """Result of one simulated traversal."""

    episode: Traverse
    """The run with its ground truth at every tick."""

    @property
    def verdict(self) -> str:
        """How the run ended: ``arrived``, ``end_of_flight``, ``held``, ``refused``, ``fell``, ``time_up`` or ``diverged``."""
        return self.episode.verdict

    @property
    def cause(self) -> str | None:
        """Reason for the verdict; None where it needs none."""
        return self.episode.cause

    @property
    def scores(self) -> Scores:
        """Scores by ground truth: heading, roll-back, seat, passenger acceleration, tip-over margin and phases."""
        return self.episode.scores

    @property
    def series(self) -> dict[str, Float[np.ndarray, " T"]]:
        """Time series at 100 Hz by column name, as in ``series.csv``: angles in degrees, everything else in SI units."""
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
    scenario: str | Path | Scenario,
    controller: ControllerSource = None,
    seed: int = 0,
    *,
    detector: DetectorSource = None,
    estimator: EstimatorSource = None,
    out: str | Path | None = None,
) -> Run:
    """Return one simulated traversal in closed loop with vision, fusion, LQR, seat levelling and guard.

    Args:
        scenario: Scenario file, the name of a shipped scenario, or a scenario.
        controller: Controller file or design, plug-in class, ``module:Class``, or entry point name; the controller shipped for the
            vehicle when left out.
        seed: Random seed. The same seed gives byte-identical results.
        detector: Stair detector: plug-in class, ``module:Class``, or entry point name.
        estimator: Heading estimator, likewise.
        out: Run folder to write, as ``treadline climb --out`` does; none when left out.

    Raises:
        SettingsError: If a file or plug-in is missing or says something that it must not.
    """
    setup = resolve(scenario, controller, seed, detector=detector, estimator=estimator)
    return Run(episode=run_episode(setup) if out is None else recorded_run(Path(out), setup))
