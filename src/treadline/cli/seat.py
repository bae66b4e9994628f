"""``treadline seat``: the seat alone levels itself (Fig. 11)."""

from pathlib import Path

from treadline.cli._arguments import Force, claim
from treadline.cli._output import Answer


def seat(scenario: str, /, *, out: Path, seed: int = 0, force: Force = False) -> Answer:
    """Level the seat of a chair that stands on a flight, starting parallel to the chassis (Fig. 11).

    The belts are stopped; the seat's loop is closed at t = 0. Exit code 1 if the seat does not settle within one degree.

    Args:
        scenario: Scenario file, or the name of a shipped scenario; only its stair and chair are used.
        out: Run folder: log.mcap, series.csv, result.json, manifest.json.
        seed: Random seed. The same seed gives byte-identical results.
    """
    from treadline.experiments.fig11 import level_seat
    from treadline.scenario.scenario import read_scenario

    claim(out, force=force)
    levelled = level_seat(out, seed, read_scenario(scenario))
    settle = levelled["settle_s"]
    settled = "did not settle" if settle is None else f"within 1° of level after {settle:.1f} s"
    return Answer(
        values=levelled | {"run": str(out)},
        summary=[
            f"from {levelled['start_deg']:.1f}° {settled}; then {round(levelled['steady_error_deg'], 2) + 0.0:+.2f}° off on "
            f"average, {levelled['max_error_deg']:.2f}° at most",
            f"run folder: {out} (treadline report {out} draws it)",
        ],
        code=1 if settle is None else 0,
    )
