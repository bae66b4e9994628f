"""``treadline export``: the controller for other places."""

from pathlib import Path
from typing import get_args

from treadline.cli.answer import Answer
from treadline.cli.numbers import choice


def export(
    controller: Path,
    /,
    *,
    to: str,
    out: Path,
    chair: str | None = None,
    allocation: str = "climb-safe",
    reconstruct: str | None = None,
    speed: float = 0.2,
) -> Answer:
    """Write a controller as C99, as parameters of a ROS node, or as JSON with a log to test a copy with.

    The C code allocates nothing, has no globals and needs no library; with it comes a program that replays a log:
    cc -std=c99 heading_controller.c heading_selftest.c -o heading_selftest && ./heading_selftest

    Args:
        controller: A file that treadline tune wrote.
        to: c, ros or json.
        out: The folder for the files.
        chair: Whose belts' limit holds; the chair the controller was tuned for when left out.
        allocation: climb-safe, or paper.
        reconstruct: observer, or static for Eq. (11b); as the controller's file says when left out.
        speed: Climb speed in m/s: the C code takes it at every step, the others as a setting.
    """
    from treadline.control import ControllerConfig
    from treadline.control.export import Target, exported
    from treadline.errors import SettingsError
    from treadline.mechanics.chair import read_chair
    from treadline.models import ControllerDesign, Reconstruct, write_whole

    target = choice("--to", to, get_args(Target))
    shared = choice("--allocation", allocation, ("climb-safe", "paper"))
    chosen = None if reconstruct is None else choice("--reconstruct", reconstruct, get_args(Reconstruct))
    if not 0.0 < speed <= 0.3:
        raise SettingsError(f"--speed is {speed}; it must be above 0 and at most 0.3 m/s")
    design = ControllerDesign.load(controller)
    limit_m_s = read_chair(design.vehicle if chair is None else chair).drives.max_speed_m_s
    config = ControllerConfig(
        climb_speed_m_s=speed,
        max_speed_m_s=limit_m_s,
        allocation=shared,
        reconstruct=chosen,
        period_s=design.period_s,
    )
    files = exported(target, design, config)
    for name, text in files.items():
        write_whole(out / name, text)
    return Answer(
        values={"path": str(out), "files": sorted(files), "vehicle": design.vehicle, "period_s": design.period_s},
        summary=[f"{', '.join(sorted(files))} written to {out}; call it every {design.period_s:g} s"],
    )
