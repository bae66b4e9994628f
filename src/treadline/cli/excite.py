"""``treadline excite``: random belt speeds on the stair."""

from pathlib import Path

from treadline.cli._arguments import Force, Set, claim, set_values
from treadline.cli._output import Answer, SimulatedTime

LONGEST_S = 10.0
"""Longest sampling period [s]: the chair climbs two metres in it."""


def excite(
    scenario: str,
    /,
    *,
    changes: Set = None,
    out: Path,
    samples: int = 1000,
    period: float = 0.25,
    seed: int = 0,
    log_images: bool = False,
    force: Force = False,
) -> Answer:
    """Drive with random belt speeds on the stair and record inputs and outputs for identification (Section VI.B).

    A heading feedback is added to the random belt difference, so that the chair stays on the flight. The record holds the sum
    (closed-loop data); manifest.json holds the feedback gain under excitation.

    Args:
        scenario: Scenario file, or the name of a shipped scenario; its flight is lengthened as needed.
        out: Run folder: record.csv and log.mcap.
        samples: Number of input-output samples; at least 57, the minimum of treadline identify.
        period: Time between samples in seconds, a multiple of 0.01.
        seed: Random seed. The same seed gives byte-identical results.
        log_images: Keep every frame in the log.
    """
    from treadline.core.angles import DEG
    from treadline.core.errors import SettingsError
    from treadline.core.signals import TICK_S, on_the_tick
    from treadline.identification.options import fewest_samples
    from treadline.io.runs import INPUTS, OUTPUTS
    from treadline.run.excitation_run import excite as drive
    from treadline.scenario.scenario import read_scenario

    claim(out, force=force)
    fewest = fewest_samples(len(INPUTS), len(OUTPUTS))
    if samples < fewest:
        raise SettingsError(f"--samples is {samples}; treadline identify needs at least {fewest} of them")
    if not on_the_tick(period) or period > LONGEST_S:
        raise SettingsError(f"--period is {period}; it must be a multiple of {TICK_S} s between {TICK_S} and {LONGEST_S:g}")
    settings = read_scenario(scenario, set_values(changes))
    with SimulatedTime("excite") as progress:
        record, run = drive(
            settings,
            folder=out,
            samples=samples,
            period_s=period,
            seed=seed,
            image_every=1 if log_images else 0,
            watch=lambda tick: progress.at(tick.t_s, samples * period),
        )
    ran = f"{run.verdict} ({run.cause})"
    values = {"samples": len(record), "heading_range_deg": None, "record": None, "verdict": run.verdict}
    if len(record) == 0:
        return Answer(values=values, summary=[f"no sample: {ran}; see {out}"], code=1)
    heading, path = record.y[:, 0] / DEG, out / "record.csv"
    ended = "" if len(record) == samples else f" ({run.verdict}: {run.cause})"
    return Answer(
        values=values | {"heading_range_deg": [float(heading.min()), float(heading.max())], "record": str(path)},
        summary=[f"{len(record)} samples{ended}, heading within {heading.min():+.1f}…{heading.max():+.1f}°; written to {path}"],
        code=0 if len(record) == samples else 1,
    )
