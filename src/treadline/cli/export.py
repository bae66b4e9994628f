"""``treadline export``: the controller as C99, as ROS parameters or as JSON."""

from pathlib import Path
from typing import get_args

from treadline.cli.answer import Answer
from treadline.cli.numbers import choice
from treadline.cli.out import Force, claim


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
    force: Force = False,
) -> Answer:
    """Write a controller as C99, as parameters of a ROS node, or as JSON with a log to test a copy with.

    The C code allocates no memory, has no globals and needs no library. A self-test program that replays a log is included:
    cc -std=c99 heading_controller.c heading_selftest.c -o heading_selftest && ./heading_selftest

    Args:
        controller: Controller file that treadline tune wrote.
        to: Format: c, ros or json.
        out: Folder for the files.
        chair: Chair whose belt speed limit applies. Default: the chair that the controller was tuned for.
        allocation: Allocation of a turn to the belts: climb-safe, or paper.
        reconstruct: State reconstruction: observer, or static for Eq. (11b). Default: as in the controller file.
        speed: Climb speed in m/s: an input of every step in C, a setting in the other formats.
    """
    from treadline.control import ControllerConfig
    from treadline.control.export import Target, exported
    from treadline.errors import SettingsError
    from treadline.mechanics.chair import read_chair
    from treadline.models import ControllerDesign, Reconstruct, write_whole

    target = choice("--to", to, get_args(Target))
    shared = choice("--allocation", allocation, ("climb-safe", "paper"))
    chosen = None if reconstruct is None else choice("--reconstruct", reconstruct, get_args(Reconstruct))
    claim(out, force=force)
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
