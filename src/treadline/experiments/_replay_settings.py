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
from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import SettingsError, closest
from treadline.core.models import ControllerDesign, Reconstruct
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
from treadline.scenario.camera_file import CameraFile, Degrees, Pixels, Positive
from treadline.scenario.scenario import Control, DriveSettings
from treadline.scenario.shipped_files import shipped_controller

CONTROL_RATE_PERIOD_S = 0.25
INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
MOUNT = ("mount_pitch_rad", "mount_roll_rad", "mount_yaw_rad", "mount_m")
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


class ControlKeys(Settings):
    """Keys of the controller."""

    speed_m_s: Annotated[float, Field(gt=0.0, le=0.30)]
    allocation: Literal["climb-safe", "paper"]
    reconstruct: Reconstruct | None


class CameraKeys(Settings):
    """Camera calibration in place of the log's; None keeps the logged value, or the chair file's."""

    width: Pixels | None = None
    """Width of the images [px]; images of another size are rejected."""
    height: Pixels | None = None
    """Height of the images [px]; images of another size are rejected."""
    fx_px: Positive | None = None
    fy_px: Positive | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    depth_unit_m: Annotated[float, Field(gt=0.0, le=1.0)] = 0.001
    """Depth per count of a 16-bit depth image [m]."""
    mount_pitch_deg: Degrees | None = None
    mount_roll_deg: Degrees | None = None
    mount_yaw_deg: Degrees | None = None
    mount_m: tuple[float, float, float] | None = None
    """Position of the camera on the chair [m], from mid-track."""


class ImuKeys(Settings):
    """Orientation of the IMU."""

    axes: Literal["chair", "camera"] = "chair"
    """Axes of the IMU: the chair's (x forward, y left, z up), or the camera's (x right, y down, z forward)."""


class MissionKeys(Settings):
    """Keys that are not settings of a block."""

    vision: Literal["robust", "paper"]
    estimator: Literal["kalman", "offset"] | None = None
    loop: Literal["closed", "open"]
    controller: str | None = None
    control: ControlKeys
    camera: CameraKeys = CameraKeys()
    imu: ImuKeys = ImuKeys()


@dataclass(frozen=True, slots=True)
class ReplayKey:
    """One key of ``--set``."""

    hint: Any
    """Type of the value, with its range."""
    default: Any
    meaning: str
    """Meaning of the key; empty if the name is sufficient."""


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
        return replace(self.changed(_detector(self.mission), "detector"), method=self.mission.vision)

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
        return self._mounted(replace(logged, **given, **sizes))

    def _mounted(self, camera: PinholeCamera) -> PinholeCamera:
        nominal = self.mission.chair.camera_at()
        return replace(camera, **self.changed_fields({name: getattr(nominal, name) for name in MOUNT}, "camera"))

    def changed(self, config: Any, table: str) -> Any:
        """Return a block's settings with the keys of a table that are set.

        The other values are not converted to degrees and back, which would change their last bits.
        """
        return replace(config, **self.changed_fields({item.name: getattr(config, item.name) for item in fields(config)}, table))

    def changed_fields(self, values: dict[str, Any], table: str) -> dict[str, Any]:
        """Return fields by name, with the keys of a table that are set; angles in radians."""
        changed = {}
        for name, value in values.items():
            key = f"{table}.{name.replace('_rad', '_deg')}"
            if is_dataclass(value):
                changed[name] = self.changed(value, f"{table}.{name}")
            elif self.given.get(key) is None:
                changed[name] = value
            else:
                changed[name] = self.given[key] * DEG if "_rad" in name else self.given[key]
        return changed

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
    keys = keys_of(base)
    typed: dict[str, Any] = {name: (key.hint, key.default) for name, key in keys.items()}
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
    given = [name for name in CameraKeys.model_fields if name in camera.model_fields_set]
    # Numbers and lists of JSON are also valid TOML.
    return tuple(f"camera.{name}={json.dumps(getattr(camera, name))}" for name in given)


def _detector(base: MissionConfig) -> DetectorConfig:
    return DetectorConfig(swept_half_m=base.chair.swept_half_m)


def keys_of(base: MissionConfig) -> dict[str, ReplayKey]:
    """Return every key of ``--set``, with the settings of the recorded run as defaults."""
    control = ControlKeys(speed_m_s=base.climb_speed_m_s, allocation=base.allocation, reconstruct=base.reconstruct)
    keys = _keys(MissionKeys(vision=base.vision, loop=base.loop, control=control))
    guard = guard_config(base, CONTROL_RATE_PERIOD_S)
    for table, config in (
        ("detector", _detector(base)),
        ("filter", FilterConfig()),
        ("offset", AberrationRule()),
        ("guard", guard),
    ):
        keys |= _keys(config, f"{table}.")
    return keys


def key_table(base: MissionConfig) -> dict[str, tuple[str, str]]:
    """Return every key with its default (a description where there is none) and its meaning, empty if the name is sufficient."""
    return {
        name: (str(UNSET.get(name, AS_LOGGED) if key.default is None else key.default), key.meaning)
        for name, key in keys_of(base).items()
    }


def _keys(settings: Any, before: str = "") -> dict[str, ReplayKey]:
    """Return the keys of a settings object: its fields that hold one value, angles in degrees, nested settings as tables."""
    hints = get_type_hints(type(settings), include_extras=True)
    is_block = is_dataclass(settings)
    written = meanings(type(settings)) if is_block else meanings(Control) | meanings(DriveSettings) | meanings(type(settings))
    found: dict[str, ReplayKey] = {}
    for name in (item.name for item in fields(settings)) if is_block else type(settings).model_fields:
        value, key = getattr(settings, name), before + name.replace("_rad", "_deg")
        if isinstance(value, Settings) or is_dataclass(value):
            found |= _keys(value, f"{before}{name}.")
        elif not is_block:
            found[key] = ReplayKey(hints[name], value, written.get(name, ""))
        elif _is_plain(hints[name]) and key not in NO_KEYS:
            # A limit, sigma, gate or time is not negative.
            hint = Annotated[hints[name], Field(ge=0)] if hints[name] in (float, int) and value >= 0 else hints[name]
            found[key] = ReplayKey(hint, float(f"{value / DEG:.12g}") if "_rad" in name else value, written.get(name, ""))
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
            raise SettingsError(f"--set {key}: unknown key; {_allowed(key, known)}; all with defaults: treadline replay --keys")
    return given


def _allowed(key: str, known: list[str]) -> str:
    siblings = [name for name in known if name.split(".")[0] == key.split(".", maxsplit=1)[0]] or known
    close = closest(key, known)
    return ("" if close is None else f"did you mean {close}? ") + f"allowed: {', '.join(siblings)}"
