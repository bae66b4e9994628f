"""``treadline check``: mechanics before driving."""

from treadline.cli.answer import Answer


def check(scenario: str, /) -> Answer:
    """Say whether physics allows a scenario: track length, traction, stability, seat stroke.

    Args:
        scenario: A scenario file, or the name of a shipped one.
    """
    from dataclasses import asdict

    from treadline.mechanics.chair import read_chair
    from treadline.mechanics.verdict import check as judge
    from treadline.scenario import read_scenario

    settings = read_scenario(scenario)
    report = judge(settings, read_chair(settings.chair.model))
    margins = ", ".join(f"{side} {angle:.1f}°" for side, angle in report.stability_margin_deg.items())
    return Answer(
        values=asdict(report),
        summary=[
            f"{report.verdict}: track {report.track_length_margin_m:+.3f} m over 2√(h²+w²); friction needed "
            f"{report.friction_needed_with_reserve:.2f} ({report.friction_needed:.2f} to stand, and a reserve for jolts), "
            f"available {report.friction_available:.2f}; tipping margins {margins}",
            *report.reasons,
        ],
        code=0 if report.verdict == "go" else 1,
    )
