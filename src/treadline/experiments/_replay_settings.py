"""Settings of a replay: dotted keys of the mission and of every setting of its blocks.

The keys of the tables ``filter``, ``guard``, ``detector`` and ``offset`` are the fields of the blocks' own settings. Angles are in
degrees.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from jaxtyping import Float
from numpy import ndarray
from pydantic import Field, create_model

from treadline.core.angles import DEG
from treadline.core.camera_images import MOUNT_FIELDS, PinholeCamera
from treadline.core.errors import SettingsError, closest
from treadline.core.models import ControllerDesign
from treadline.core.overrides import parse_items, put
from treadline.core.setting_docs import meanings
from treadline.core.settings import Settings, settings_of
from treadline.estimation import FilterConfig, HeadingFilter, OffsetEstimator
from treadline.estimation.offset import AberrationRule
from treadline.guard import Guard
from treadline.mission.loop import Blocks
from treadline.mission.mission_blocks import build_blocks, guard_config, heading_driver
from treadline.mission.mission_config import MissionConfig
from treadline.mission.planner import Cruise
from treadline.perception import DetectorConfig
from treadline.run.excitation_run import PERIOD_S
from treadline.scenario.camera_file import INTRINSICS, MOUNT_ANGLES, CameraFile
from treadline.scenario.scenario import Control, DriveSettings
from treadline.scenario.shipped_files import shipped_controller

CAMERA = ("width", "height", *INTRINSICS, "depth_unit_m", *MOUNT_ANGLES, "mount_m", "sensor")
"""Keys of a calibration file that stand in place of the log's values, or of the chair file's."""
MEANINGS = {
    "camera.width": "Width of the images [px]; images of another size are rejected.",
    "camera.height": "Height of the images [px]; images of another size are rejected.",
    "camera.depth_unit_m": "Depth per count of a 16-bit depth image [m].",
    "camera.mount_m": "Position of the camera on the chair [m], from mid-track.",
    "camera.sensor": "Kind of the depth sensor, which decides what it measures.",
    "imu.axes": "Axes of the IMU: the chair's (x forward, y left, z up), or the camera's (x right, y down, z forward).",
}
"""Meanings of the keys that are neither of a scenario nor of a block."""
UNSET = {
    "estimator": "kalman with robust vision, offset with the paper's",
    "controller": "the one that drove the log's run, else the one shipped for the chair",
    "control.reconstruct": "as the controller's file says",
}
"""Description of the value of a key that is not set and has no default."""
AS_LOGGED = "as logged, or as the chair's file says"
"""Description for the other keys."""
NO_KEYS = ("detector.method", "guard.needs_heading")
"""Settings of blocks that other keys decide."""

Key = tuple[Any, Any, str]
"""One key of ``--set``: type of the value with its range, default, and meaning, empty if the name is sufficient."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplaySettings:
    """Resolved settings of a replay."""

    values: Mapping[str, Any]
    """Value of each key."""
    given: Mapping[str, Any]
    """Values of the keys that are set."""
    mission: MissionConfig
    controller_name: str

    def blocks(self, detector: Any, *, shows_stair: bool = True) -> Blocks:
        """Return the mission's blocks.

        Args:
            detector: Stair detector, which the caller builds.
            shows_stair: Whether the recording holds nosing positions; headings alone are replayed as on an endless flight.
        """
        driver = heading_driver(self.mission)
        blocks = build_blocks(self.mission, driver)
        # Recorded belts and attitude do not respond to the new commands, so the checks of that response are off.
        guard = replace(
            self.changed(guard_config(self.mission, driver.period_s), "guard"), watches_motion=False, watches_slip=False
        )
        return replace(
            blocks,
            detector=detector,
            planner=blocks.planner if shows_stair else Cruise(self.mission.climb_speed_m_s),
            estimator=blocks.estimator if self.mission.plugins.estimator is not None else self._estimator(),
            guard=Guard(guard),
        )

    def _estimator(self) -> Any:
        kind = self.values["estimator"] or ("kalman" if self.mission.vision == "robust" else "offset")
        if kind == "kalman":
            return HeadingFilter(self.changed(FilterConfig(), "filter"))
        return OffsetEstimator(self.changed(AberrationRule(), "offset"))

    @property
    def detector(self) -> DetectorConfig:
        """Settings of the stair detector."""
        return replace(
            self.changed(DetectorConfig(swept_half_m=self.mission.chair.swept_half_m), "detector"), method=self.mission.vision
        )

    @property
    def depth_unit_m(self) -> float:
        """Depth per count of a 16-bit depth image [m]."""
        return float(self.values["camera.depth_unit_m"])

    @property
    def R_BI(self) -> Float[ndarray, "3 3"] | None:
        """Rotation from the IMU's axes to the chair's; None for an IMU with the chair's axes."""
        return None if self.values["imu.axes"] == "chair" else self._mounted(self.mission.chair.camera_at()).R_BC

    def calibrate(self, logged: PinholeCamera | None, size: tuple[int, int]) -> PinholeCamera | None:
        """Return the log's calibration with the values that are set, on the chair's mount; None without intrinsics."""
        given = {name: self.values[f"camera.{name}"] for name in INTRINSICS if self.values[f"camera.{name}"] is not None}
        if logged is None:
            if len(given) < len(INTRINSICS):
                return None
            logged = PinholeCamera(width_px=size[0], height_px=size[1], **given)
        sizes = {f"{side}_px": self.values[f"camera.{side}"] or getattr(logged, f"{side}_px") for side in ("width", "height")}
        return self._mounted(replace(logged, **sizes))

    def _mounted(self, camera: PinholeCamera) -> PinholeCamera:
        """Return a camera on the chair's mount, with the values that are set."""
        nominal = self.mission.chair.camera_at()
        mount: dict[str, Any] = {name: getattr(nominal, name) for name in MOUNT_FIELDS}
        mounted: PinholeCamera = self.changed(replace(camera, **mount), "camera")
        return mounted

    def changed(self, config: Any, table: str) -> Any:
        """Return a block's settings with the keys of a table that are set; angles in radians.

        The other values are not converted to degrees and back, which would change their last bits.
        """
        changed = {}
        for name in (item.name for item in fields(config)):
            value, given = getattr(config, name), self.given.get(f"{table}.{name.replace('_rad', '_deg')}")
            if is_dataclass(value):
                changed[name] = self.changed(value, f"{table}.{name}")
            elif given is not None:
                changed[name] = given * DEG if "_rad" in name else given
        return replace(config, **changed)

    def as_tables(self) -> dict[str, Any]:
        """Return the values as nested tables, with the name of the controller."""
        tables: dict[str, Any] = {}
        for key, value in self.values.items():
            tables = put(tables, tuple(key.split(".")), value, None)
        return tables | {"controller": self.controller_name}


def resolved(base: MissionConfig, items: Sequence[str], controller: str | None = None) -> ReplaySettings:
    """Return the settings of a replay.

    Args:
        base: Mission configuration of the recorded run; its controller is not in the log.
        items: ``key=value``; the last one of a key applies.
        controller: Controller file; None for the controller shipped for the chair. A plug-in controller in ``base`` takes
            precedence.

    Raises:
        SettingsError: If a key is unknown, or a value is of the wrong type or out of range.
    """
    keys = _keys_of(base)
    typed: dict[str, Any] = {name: (hint, default) for name, (hint, default, _) in keys.items()}
    model: type[Settings] = create_model("replay", __base__=Settings, **typed)
    checked = settings_of(_given(items, list(keys)), model, where="--set")
    values = {name: getattr(checked, name) for name in keys}
    if base.plugins.controller is not None:
        design, name = None, base.plugins.sources()["controller"]
    else:
        path = values["controller"] or controller
        design = shipped_controller(base.chair.name) if path is None else ControllerDesign.load(Path(path))
        name = values["controller"] or (f"shipped for {base.chair.name}" if path is None else Path(path).name)
    mission = replace(
        base,
        controller=design,
        climb_speed_m_s=values["control.speed_m_s"],
        loop=values["loop"],
        vision=values["vision"],
        allocation=values["control.allocation"],
        reconstruct=values["control.reconstruct"],
    )
    given = {name: values[name] for name in checked.model_fields_set}
    return ReplaySettings(values=values, given=given, mission=mission, controller_name=name)


def camera_items(camera: CameraFile) -> tuple[str, ...]:
    """Return the values of a calibration file as ``key=value``; missing ones stay as logged, or as in the chair file."""
    given = [name for name in CAMERA if name in camera.model_fields_set]
    # Numbers and lists of JSON are also valid TOML.
    return tuple(f"camera.{name}={json.dumps(getattr(camera, name))}" for name in given)


def key_table(base: MissionConfig) -> dict[str, tuple[str, str]]:
    """Return every key with its default (a description where there is none) and its meaning, empty if the name is sufficient."""
    return {
        name: (str(UNSET.get(name, AS_LOGGED) if default is None else default), meaning)
        for name, (_, default, meaning) in _keys_of(base).items()
    }


def _keys_of(base: MissionConfig) -> dict[str, Key]:
    """Return every key of ``--set``, with the settings of the recorded run as defaults."""
    control, drive, camera = (get_type_hints(model, include_extras=True) for model in (Control, DriveSettings, CameraFile))
    depth_unit_m = CameraFile.model_fields["depth_unit_m"].default
    keys = {
        "vision": (Literal["robust", "paper"], base.vision),
        "estimator": (Literal["kalman", "offset"] | None, None),
        "loop": (control["loop"], base.loop),
        "controller": (str | None, None),
        "control.speed_m_s": (drive["speed_m_s"], base.climb_speed_m_s),
        "control.allocation": (control["allocation"], base.allocation),
        "control.reconstruct": (control["reconstruct"], base.reconstruct),
        **{f"camera.{name}": (camera[name] | None, None) for name in CAMERA},
        "camera.depth_unit_m": (camera["depth_unit_m"], depth_unit_m),
        "imu.axes": (Literal["chair", "camera"], "chair"),
    }
    written = meanings(Control) | meanings(DriveSettings)
    blocks = {
        "detector": DetectorConfig(swept_half_m=base.chair.swept_half_m),
        "filter": FilterConfig(),
        "offset": AberrationRule(),
        "guard": guard_config(base, PERIOD_S),
    }
    found: dict[str, Key] = {
        key: (*typed, MEANINGS.get(key) or written.get(key.rpartition(".")[2], "")) for key, typed in keys.items()
    }
    for table, config in blocks.items():
        found |= _block_keys(config, table)
    return found


def _block_keys(config: Any, table: str) -> dict[str, Key]:
    """Return the keys of a block: its settings that hold one value, angles in degrees, nested settings as tables."""
    hints, written = get_type_hints(type(config), include_extras=True), meanings(type(config))
    found: dict[str, Key] = {}
    for name in (item.name for item in fields(config)):
        value, key = getattr(config, name), f"{table}.{name.replace('_rad', '_deg')}"
        if is_dataclass(value):
            found |= _block_keys(value, f"{table}.{name}")
        elif _is_plain(hints[name]) and key not in NO_KEYS:
            # A limit, sigma, gate or time is not negative.
            at_least_zero = hints[name] in (float, int, float | None) and value is not None and value >= 0
            hint = Annotated[hints[name], Field(ge=0)] if at_least_zero else hints[name]
            found[key] = (hint, float(f"{value / DEG:.12g}") if "_rad" in name else value, written.get(name, ""))
    return found


def _is_plain(hint: Any) -> bool:
    plain = (float, int, bool, str, type(None))
    return (
        hint in plain or get_origin(hint) is Literal or (isinstance(hint, type(int | None)) and all(map(_is_plain, get_args(hint))))
    )


def _given(items: Sequence[str], known: list[str]) -> dict[str, object]:
    """Return the values of ``key=value`` items by key."""
    given = parse_items(items)
    for key in given:
        if key not in known:
            siblings = [name for name in known if name.split(".")[0] == key.split(".", maxsplit=1)[0]] or known
            meant = "" if (close := closest(key, known)) is None else f"did you mean {close}? "
            remedy = f"{meant}allowed: {', '.join(siblings)}; all with defaults: treadline replay --keys"
            raise SettingsError(f"--set {key}: unknown key; {remedy}")
    return given
