"""``treadline mount``: mount angles of the camera on the chair, estimated from a minute of driving."""

from pathlib import Path
from typing import Any

from treadline.cli._arguments import Force, claim
from treadline.cli._output import Answer
from treadline.cli.compile import report_compiling

OUT = Path("camera.toml")


def mount(
    log: Path,
    /,
    *,
    camera: Path | None = None,
    topics: str | None = None,
    out: Path = OUT,
    force: Force = False,
) -> Answer:
    """Estimate the mount angles of the camera on the chair from ordinary driving on a flight.

    The log is a run folder (treadline climb --log-images keeps the frames), an MCAP file or a ROS bag with depth images and the
    chair's IMU; an IMU inside the camera turns with the mount and does not observe it. On the flight the belts lie on the nosing
    plane, which the camera sees: pitch and roll follow within a minute, yaw once the chair has turned to both sides. The nominal
    mount must be within 15 degrees.

    treadline mount runs/climb --out camera.toml

    Args:
        log: Run folder, an .mcap, .bag or .db3 file, or the folder of a bag.
        camera: Calibration and nominal mount, in place of the log's CameraInfo and the chair's file.
        topics: Topics by role, where their types are ambiguous: depth=/a,color=/b,info=/c,imu=/d,accel=/e.
        out: Calibration file to write. Default: camera.toml.
    """
    from treadline.cli._output import Share
    from treadline.experiments.mount_calibration import MountStudy, write_calibration
    from treadline.io.topics import parse_topics
    from treadline.scenario.camera_file import read_camera

    claim(out, force=force, kind="file")
    report_compiling()
    study = MountStudy(log, camera=None if camera is None else read_camera(camera), topics=parse_topics(topics))
    with Share("mount", lambda: study.share) as progress:
        for _ in progress.of(study.readings()):
            pass
    values, found = study.result()
    if values["reason"] is not None:
        return Answer(values=values | {"path": None}, summary=[f"no mount: {values['reason']}"], code=1)
    write_calibration(out, values, found)
    return Answer(values=values | {"path": str(out)}, summary=_lines(values, log, out))


def _lines(values: dict[str, Any], log: Path, path: Path) -> list[str]:
    """Return the summary for people."""
    angles = ", ".join(_angle(name, values) for name in ("pitch", "roll", "yaw"))
    change = ", ".join(f"{name} {value:+.2f}°" for name, value in values["change_deg"].items() if value is not None)
    return [
        angles,
        f"changed by {change}; {values['counted']} of {values['frames']} frames count",
        *(f"  left out {count}: {why}" for why, count in values["left_out"].items()),
        *(f"  dropped {count}: {why}" for why, count in values["dropped"].items()),
        f"calibration: {path}; the drive again with it: treadline replay {log} --camera {path} --out RUN",
    ]


def _angle(name: str, values: dict[str, Any]) -> str:
    degrees, sigma = values[f"{name}_deg"], values[f"{name}_sigma_deg"]
    return f"{name} not known: too few turns" if degrees is None else f"{name} {degrees:.2f}° ± {1.96 * sigma:.2f}° (95 %)"
