"""Settings of a replay: dotted keys of the mission and of every setting of its blocks.

The tables ``filter``, ``guard``, ``detector`` and ``offset`` are generated from the blocks' settings. Angles are in degrees.
"""

import difflib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from jaxtyping import Float
from numpy import ndarray
from pydantic import Field, create_model

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.images import PinholeCamera
from treadline.core.models import ControllerDesign, Reconstruct
from treadline.core.setting_docs import meanings
from treadline.core.settings import Settings, settings_of
from treadline.estimation import FilterConfig, HeadingFilter, OffsetEstimator
from treadline.estimation.aberration import AberrationRule
from treadline.guard import Guard
from treadline.mission.loop import Blocks
from treadline.mission.mission_blocks import build_blocks, guard_config, heading_driver
from treadline.mission.mission_config import MissionConfig
from treadline.mission.planner import Cruise
from treadline.perception import DetectorConfig
from treadline.scenario.camera_file import CameraFile, Pixels
from treadline.scenario.controller_files import shipped_controller
from treadline.scenario.scenario import Control, DriveSettings

Positive = Annotated[float, Field(gt=0.0)]
Turn = Annotated[float, Field(ge=-180.0, le=180.0)]
CONTROL_RATE_PERIOD_S = 0.25
SIZE = {"width": "width_px", "height": "height_px"}
INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
UNSET = {
    "": "as logged, or as the chair's file says",
    "estimator": "kalman with robust vision, offset with the paper's",
    "controller": "the one that drove the log's run, else the one shipped for the chair",
    "control.reconstruct": "as the controller's file says",
}
"""Description of the value of a key that is not set and has no default."""
OPERATORS = ("", "control.", "camera.", "imu.")
"""Tables that are not settings of a block."""
MOUNT = ("mount_pitch", "mount_roll", "mount_yaw")
RENAMED = {
    "filter.shake_deg": "filter.vibration_sigma_deg",
    "filter.lasting_deg": "filter.systematic_sigma_deg",
    "filter.unseen_rate_deg_s": "filter.unobserved_rate_sigma_deg_s",
    "filter.told_s": "filter.report_s",
}
"""Former names of keys, accepted for one release."""


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
    mount_pitch_deg: Turn | None = None
    mount_roll_deg: Turn | None = None
    mount_yaw_deg: Turn | None = None
    mount_m: tuple[float, float, float] | None = None
    """Position of the camera on the chair [m], from mid-track."""


class ImuKeys(Settings):
    """Orientation of the IMU."""

    axes: Literal["chair", "camera"] = "chair"
    """Axes of the IMU: the chair's (x forward, y left, z up), or the camera's (x right, y down, z forward)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplaySettings:
    """Resolved settings of a replay."""

    values: Settings
    """Values of all keys."""
    mission: MissionConfig
    controller_name: str

    def blocks(self, detector: Any, *, shows_stair: bool = True) -> Blocks:
        """Return the mission's blocks.

        Args:
            detector: Stair detector, which the caller builds.
            shows_stair: Whether the recording holds nosing positions; headings alone are replayed as on an endless flight.
        """
        values: Any = self.values
        driver = heading_driver(self.mission)
        estimator = values.estimator or ("kalman" if values.vision == "robust" else "offset")
        kalman: Any = HeadingFilter(applied(FilterConfig(), values.filter))
        guard = applied(guard_config(self.mission, driver.period_s), values.guard)
        blocks = build_blocks(self.mission, driver)
        return replace(
            blocks,
            detector=detector,
            planner=blocks.planner if shows_stair else Cruise(self.mission.climb_speed_m_s),
            estimator=blocks.estimator
            if self.mission.plugins.estimator is not None
            else kalman
            if estimator == "kalman"
            else OffsetEstimator(applied(AberrationRule(), values.offset)),
            # Recorded belts and attitude do not respond to the new commands, so the checks of that response are off.
            guard=Guard(replace(guard, watches_motion=False, watches_slip=False)),
        )

    @property
    def detector(self) -> DetectorConfig:
        """Settings of the stair detector."""
        values: Any = self.values
        return replace(applied(_detector(self.mission), values.detector), method=values.vision)

    @property
    def depth_unit_m(self) -> float:
        """Depth per count of a 16-bit depth image [m]."""
        values: Any = self.values
        return float(values.camera.depth_unit_m)

    @property
    def R_BI(self) -> Float[ndarray, "3 3"] | None:
        """Rotation from the IMU's axes to the chair's; None for an IMU with the chair's axes."""
        values: Any = self.values
        if values.imu.axes == "chair":
            return None
        return self._mounted(PinholeCamera(width_px=1, height_px=1, fx_px=1.0, fy_px=1.0, cx_px=0.0, cy_px=0.0)).R_BC

    def calibrate(self, logged: PinholeCamera | None, size: tuple[int, int]) -> PinholeCamera | None:
        """Return the log's calibration with the values that are set, on the chair's mount; None without intrinsics."""
        values: Any = self.values
        every: dict[str, Any] = {name: getattr(values.camera, name) for name in INTRINSICS}
        given = {name: value for name, value in every.items() if value is not None}
        if logged is None:
            if len(given) < len(INTRINSICS):
                return None
            logged = PinholeCamera(width_px=size[0], height_px=size[1], **given)
        sizes = {field: value for key, field in SIZE.items() if (value := getattr(values.camera, key)) is not None}
        return self._mounted(replace(logged, **given, **sizes))

    def _mounted(self, camera: PinholeCamera) -> PinholeCamera:
        values: Any = self.values
        mount = self.mission.chair.camera_at()
        angles: dict[str, Any] = {}
        for name in MOUNT:
            degrees = getattr(values.camera, name + "_deg")
            angles[name + "_rad"] = getattr(mount, name + "_rad") if degrees is None else degrees * DEG
        return replace(camera, mount_m=mount.mount_m if values.camera.mount_m is None else values.camera.mount_m, **angles)


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
    model = keys_of(base)
    values: Any = settings_of(_tables(items, _flat(model())), model, where="--set")
    if base.plugins.controller is not None:
        design, name = None, base.plugins.sources()["controller"]
    else:
        path = values.controller or controller
        design = shipped_controller(base.chair.name) if path is None else ControllerDesign.load(Path(path))
        name = values.controller or (f"shipped for {base.chair.name}" if path is None else Path(path).name)
    mission = replace(
        base,
        controller=design,
        climb_speed_m_s=values.control.speed_m_s,
        loop=values.loop,
        vision=values.vision,
        allocation=values.control.allocation,
        reconstruct=values.control.reconstruct,
    )
    return ReplaySettings(values=values, mission=mission, controller_name=name)


def camera_items(camera: CameraFile) -> tuple[str, ...]:
    """Return the values of a calibration file as ``key=value``; missing ones stay as logged, or as in the chair file."""
    given = [name for name in CameraKeys.model_fields if name in camera.model_fields_set]
    # Numbers and lists of JSON are also valid TOML.
    return tuple(f"camera.{name}={json.dumps(getattr(camera, name))}" for name in given)


def _detector(base: MissionConfig) -> DetectorConfig:
    return DetectorConfig(swept_half_m=base.chair.swept_half_m)


def keys_of(base: MissionConfig) -> type[Settings]:
    """Return the model of all keys, with the settings of the recorded run as defaults."""
    control: dict[str, Any] = {
        "speed_m_s": (Annotated[float, Field(gt=0.0, le=0.30)], base.climb_speed_m_s),
        "allocation": (Literal["climb-safe", "paper"], base.allocation),
        "reconstruct": (Reconstruct | None, base.reconstruct),
    }
    guard = guard_config(base, CONTROL_RATE_PERIOD_S)
    parts: dict[str, type[Settings]] = {
        "control": create_model("control", __base__=Settings, **control),
        "camera": CameraKeys,
        "imu": ImuKeys,
        "detector": table_of("detector", _detector(base), leave=("method",)),
        "filter": table_of("filter", FilterConfig()),
        "offset": table_of("offset", AberrationRule()),
        "guard": table_of("guard", guard, leave=("needs_heading",)),
    }
    top: dict[str, Any] = {
        "vision": (Literal["robust", "paper"], base.vision),
        "estimator": (Literal["kalman", "offset"] | None, None),
        "loop": (Literal["closed", "open"], base.loop),
        "controller": (str | None, None),
        **{name: (part, part()) for name, part in parts.items()},
    }
    model: type[Settings] = create_model("replay", __base__=Settings, **top)
    return model


def key_table(base: MissionConfig) -> dict[str, tuple[str, str]]:
    """Return every key with its default (a description where there is none) and its meaning, empty if the name is sufficient."""
    model = keys_of(base)
    written = _meanings(model)
    return {
        key: (str(UNSET.get(key, UNSET[""]) if value is None else value), written.get(key, ""))
        for key, value in _flat(model()).items()
    }


def _meanings(model: type[Settings], before: str = "") -> dict[str, str]:
    """Return the meaning of each key, from the docstrings of the block's or the scenario's settings."""
    written = meanings(Control) | meanings(DriveSettings) | meanings(model)
    found: dict[str, str] = {}
    for name, field in model.model_fields.items():
        if isinstance(field.default, Settings):
            found |= _meanings(type(field.default), f"{before}{name}.")
        else:
            found[before + name] = field.description or (written.get(name, "") if before in OPERATORS else "")
    return found


def table_of(name: str, config: Any, leave: tuple[str, ...] = ()) -> type[Settings]:
    """Return the keys of a block's settings: plain fields with angles in degrees, nested settings as tables."""
    hints = get_type_hints(type(config), include_extras=True)
    written = meanings(type(config))
    entries: dict[str, Any] = {}
    for item in fields(config):
        value = getattr(config, item.name)
        if item.name in leave:
            continue
        if is_dataclass(value):
            part = table_of(item.name, value)
            entries[item.name] = (part, part())
        elif _is_plain(hints[item.name]):
            shown = float(f"{value / DEG:.12g}") if "_rad" in item.name else value
            hint = _bounded(hints[item.name], value)
            entries[item.name.replace("_rad", "_deg")] = (Annotated[hint, Field(description=written.get(item.name))], shown)
    return create_model(name, __base__=Settings, **entries)


def applied(config: Any, values: Settings) -> Any:
    """Return a block's settings with the given keys changed; the others are not converted, which would change their last bits."""
    changes: dict[str, Any] = {}
    for name in values.model_fields_set:
        value = getattr(values, name)
        source = name.replace("_deg", "_rad")
        if isinstance(value, Settings):
            changes[name] = applied(getattr(config, name), value)
        else:
            changes[source] = value * DEG if source != name else value
    return replace(config, **changes)


def _is_plain(hint: Any) -> bool:
    if get_origin(hint) is Union or isinstance(hint, type(int | None)):
        return all(_is_plain(part) for part in get_args(hint))
    return hint in (float, int, bool, str, type(None)) or get_origin(hint) is Literal


def _bounded(hint: Any, value: Any) -> Any:
    """Return a number type bounded to >= 0 where the default is >= 0: limits, sigmas, gates and times."""
    return Annotated[hint, Field(ge=0)] if hint in (float, int) and value >= 0 else hint


def _flat(values: Settings, before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name in type(values).model_fields:
        value = getattr(values, name)
        flat |= _flat(value, f"{before}{name}.") if isinstance(value, Settings) else {before + name: value}
    return flat


def _tables(items: Sequence[str], known: dict[str, Any]) -> dict[str, object]:
    tables: dict[str, Any] = {}
    for item in items:
        key, sign, text = item.partition("=")
        key = RENAMED.get(key.strip(), key.strip())
        if not sign:
            raise SettingsError(f"--set {item}: must be key=value, as --set filter.gate=16")
        if key not in known:
            raise SettingsError(
                f"--set {key}: unknown key; {_allowed(key, list(known))}; all with defaults: treadline replay --keys"
            )
        *path, last = key.split(".")
        here = tables
        for part in path:
            here = here.setdefault(part, {})
        here[last] = _value(text.strip())
    return tables


def _allowed(key: str, known: list[str]) -> str:
    siblings = [name for name in known if name.split(".")[0] == key.split(".", maxsplit=1)[0]] or known
    close = difflib.get_close_matches(key, known, 1)
    return (f"did you mean {close[0]}? " if close else "") + f"allowed: {', '.join(siblings)}"


def _value(text: str) -> object:
    """Return a value parsed as TOML; anything else is text without quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
