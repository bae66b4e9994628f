"""``treadline replay``: recorded sensor data processed again by perception, fusion, controller and guard."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from treadline.cli._arguments import BLOCKS, BlockOptions, Force, claim
from treadline.cli._output import Answer, SimulatedTime
from treadline.core.errors import SettingsError


def replay(
    log: Path | None = None,
    /,
    *,
    out: Path | None = None,
    camera: Path | None = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    topics: str | None = None,
    blocks: BlockOptions = BLOCKS,
    keys: bool = False,
    log_images: bool = False,
    force: Force = False,
) -> Answer:
    """Process a recording again with perception, fusion, controller and guard.

    The log is a run folder (treadline climb --log-images keeps the frames), an MCAP file or a ROS bag. Depth (sensor_msgs/Image,
    16UC1 or 32FC1), colour, CameraInfo and Imu topics are found by their types. The belt commands are compared with the recorded
    ones. In a log without images the recorded headings and stair maps are used. Plug-ins of the recorded run must be named again,
    because their code is run; shipped names the shipped block instead.

    treadline replay runs/climb --set filter.gate=16 --set vision=paper --out runs/again

    Args:
        log: Run folder, an .mcap, .bag or .db3 file, or the folder of a bag.
        out: Run folder to write: manifest.json, log.mcap, series.csv, result.json, run-controller.json.
        camera: Calibration and mount in place of the log's: a camera file; --set takes precedence.
        changes: Setting to change, as key=value; may be repeated. --keys lists the keys.
        topics: Topics by role, where their types are ambiguous: depth=/a,color=/b,info=/c,imu=/d,accel=/e,headings=/f.
        keys: List the keys of --set with defaults and meanings (of the log's run if a log is given) and exit.
        log_images: Keep the frames in the new log.
    """
    if keys:
        return _keys(log)
    if log is None or out is None:
        raise SettingsError("replay needs a log and --out RUN; treadline replay --keys lists what --set may change")
    from treadline.experiments.replay import camera_items, replayed_run
    from treadline.io.topics import parse_topics
    from treadline.scenario.camera_file import read_camera

    claim(out, force=force)
    settings = () if camera is None else camera_items(read_camera(camera))
    with SimulatedTime("replay") as progress:
        values = replayed_run(
            out,
            log,
            changes=(*settings, *(changes or ())),
            topics=parse_topics(topics),
            **asdict(blocks),
            log_images=log_images,
            on_progress=progress.at,
        )
    return Answer(values=values | {"run": str(out)}, summary=_lines(values, out), code=0 if values["verdict"] == "time_up" else 1)


def _keys(log: Path | None) -> Answer:
    from treadline.experiments.replay import key_table, source_of
    from treadline.mission.mission_config import MissionConfig
    from treadline.scenario.chair import read_chair
    from treadline.scenario.scenario import Chair

    table = key_table(MissionConfig(chair=read_chair(Chair().model)) if log is None else source_of(log).base)
    return Answer(
        values={
            "keys": {key: default for key, (default, _) in table.items()},
            "meanings": {key: meaning for key, (_, meaning) in table.items()},
        },
        summary=[f"{key} = {default}" + (f"  # {meaning}" if meaning else "") for key, (default, meaning) in table.items()],
    )


def _lines(values: dict[str, Any], out: Path) -> list[str]:
    """Return the summary for people."""
    held = f"held: {values['cause']}" if values["verdict"] == "held" else "played to the end"
    lines = [f"{held}, {values['duration_s']:.1f} s at {values['real_time_factor']:.1f} × real time"]
    topics = ", ".join(f"{role} {name}" for role, name in values["topics"].items() if name is not None)
    if values["sees"] == "images":
        lines.append(
            f"{values['frames']} frames, {values['accepted']} accepted, {values['rejected']} of these rejected by the gate; "
            f"{_number(values['ms_per_frame'], ' ms')} a frame"
        )
        lines += [f"  refused {count}: {reason}" for reason, count in values["refusals"].items()]
    else:
        lines.append(
            f"no images in this log: perception was skipped, {values['accepted']} recorded headings went into the fusion, "
            f"{values['rejected']} of these rejected by the gate"
        )
    then, truth, before = (_number(values[key], "°") for key in ("rms_difference_deg", "rms_error_deg", "recorded_rms_error_deg"))
    gap = _number(values["largest_command_gap_m_s"], " m/s")
    lines.append(
        f"heading {then} RMS from the estimate of then, {truth} from the truth (then {before}); commands at most {gap} apart"
    )
    lines += [f"  dropped {count}: {reason}" for reason, count in values["dropped"].items()]
    return [*lines, f"topics: {topics}", f"run folder: {out} (treadline report {out} draws it)"]


def _number(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.3g}{unit}"
