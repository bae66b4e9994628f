"""Export of the heading controller: C99 or JSON.

``ControllerDesign, ControllerConfig -> {file name: text}``. Each export contains a log with the responses of this
controller, so that the copy can be verified on the target.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from jinja2 import Environment, FileSystemLoader

from treadline.control._observer import DISTURBANCE_LIMIT
from treadline.control.belt_allocation import INNER_RATIO_CLIMBING, INNER_RATIO_NEAR_STRAIGHT, MAX_MEAN_M_S, inner_speed_ratio
from treadline.control.heading_controller import (
    FASTEST_TURN_RAD_S,
    YAW_RATE_SIGMA_RAD_S,
    ControllerConfig,
    HeadingController,
    inner_ratio_of,
)
from treadline.control.lqr import solvable, static_inverse
from treadline.control.tune import BELT_DIFFERENCE, OUT_OF_RANGE
from treadline.core.errors import SettingsError
from treadline.core.files import DATA, write_whole
from treadline.core.models import ControllerDesign
from treadline.core.signals import CLIMB_MOST_M_S, HeadingEstimate, MotionPlan, TrackCommand
from treadline.scenario.chair import read_chair

SOURCES = DATA / "export"
TOLERANCE_M_S = 1e-6
"""Tolerance on the copy's belt speeds [m/s]: a hundredth of a drive's resolution, a million times the rounding error."""
REHEARSAL_STEPS = 400
INVALID_PLANS: dict[int, dict[str, Any]] = {
    90: {"heading_rad": math.nan},
    91: {"speed_m_s": math.nan},
    92: {"min_inner_speed_ratio": math.nan},
    93: {"heading_rad": 4.0},
    94: {"speed_m_s": 1e3},
    95: {"min_inner_speed_ratio": -2.0},
}
"""Invalid plans by step of the rehearsal, for which a copy must stop."""

Target = Literal["c", "json"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """One control period: input of the controller and its response."""

    estimate: HeadingEstimate | None
    plan: MotionPlan
    answer: TrackCommand


def export(
    controller: ControllerDesign | str | Path,
    out: str | Path,
    to: Literal["c", "json"] = "c",
    *,
    chair: str | Mapping[str, object] | None = None,
    allocation: Literal["climb-safe", "paper"] = "climb-safe",
    reconstruct: Literal["observer", "static"] | None = None,
    speed_m_s: float = 0.2,
) -> list[Path]:
    """Write a controller for other programs, and return the files: C99, or JSON with a log to test a copy with.

    Args:
        controller: Design that ``tl.tune`` returned, or its file.
        out: Folder for the files.
        to: Format: ``c`` or ``json``.
        chair: Chair whose belt speed limit applies; that of the design when left out.
        allocation: Allocation of a turn to the belts: climb-safe, or paper.
        reconstruct: State reconstruction: ``observer``, or ``static`` for Eq. (11b); as in the design when left out.
        speed_m_s: Climb speed: an input of every step in C, a setting in JSON.

    Raises:
        SettingsError: If the file or the chair is missing, or the speed is out of range.

    Examples:
        >>> import treadline as tl
        >>> from treadline.scenario.shipped_files import shipped_controller
        >>> [path.name for path in tl.export(shipped_controller("wheelchair"), "firmware")]
        ['heading_controller.c', 'heading_controller.h', 'heading_log.h', 'heading_numbers.h', 'heading_selftest.c']
    """
    if not 0.0 < speed_m_s <= CLIMB_MOST_M_S:
        raise SettingsError(f"the climb speed is {speed_m_s}; it must be above 0 and at most {CLIMB_MOST_M_S:g} m/s")
    design = controller if isinstance(controller, ControllerDesign) else ControllerDesign.load(Path(controller))
    config = ControllerConfig(
        climb_speed_m_s=speed_m_s,
        max_speed_m_s=read_chair(design.vehicle if chair is None else chair).drives.max_speed_m_s,
        allocation=allocation,
        reconstruct=reconstruct,
        period_s=design.period_s,
    )
    files = {Path(out) / name: text for name, text in exported(to, design, config).items()}
    for path, text in files.items():
        write_whole(path, text)
    return sorted(files)


@solvable(OUT_OF_RANGE)
def exported(
    target: Target, design: ControllerDesign, config: ControllerConfig, log: Sequence[Exchange] | None = None
) -> dict[str, str]:
    """Return the files of one target: name and text.

    Args:
        target: Format of the export.
        design: Controller design.
        config: Limits, allocation and period.
        log: Test data of the copy; a rehearsal on the design's own model when left out.
    """
    writers: dict[Target, Callable[..., dict[str, str]]] = {"c": _c_files, "json": _json_files}
    return writers[target](design, config, rehearsal(design, config) if log is None else log)


def rehearsal(design: ControllerDesign, config: ControllerConfig) -> list[Exchange]:
    """Return a drive on the design's own model that covers every branch of the controller.

    From 30°, one belt 2 % fast, with noise; missing and non-finite estimates and plans, suspended steering, a new target heading,
    standing, backing down.
    """
    driver, model = HeadingController(design, config), design.model
    rng = np.random.default_rng(4)
    x = np.linalg.pinv(model.C) @ np.array([math.radians(30.0), 0.0])
    sent = np.zeros((max(model.input_delay) + 1, 2))
    exchanges = []
    for k in range(REHEARSAL_STEPS):
        t_s = k * config.period_s
        y = model.C @ x + np.array([0.002, 0.01]) * rng.standard_normal(2)
        plan = replace(_rehearsed(k / REHEARSAL_STEPS, t_s, config.climb_speed_m_s), **INVALID_PLANS.get(k, {}))
        estimate = _seen(k, t_s, y)
        answer = driver.step(estimate, t_s, plan)
        exchanges.append(Exchange(estimate=estimate, plan=plan, answer=answer))
        belts = np.array([answer.left_m_s, answer.right_m_s * 1.02])
        sent = np.vstack([belts - (0.0 if answer.brake else plan.speed_m_s), sent[:-1]])
        x = model.A @ x + model.B @ sent[model.input_delay, (0, 1)]
    return exchanges


def _rehearsed(share: float, t_s: float, speed_m_s: float) -> MotionPlan:
    speed = speed_m_s if share < 0.5 else 0.0 if share < 0.55 else 0.5 * speed_m_s if share < 0.7 else -0.75 * speed_m_s
    error_rad = math.radians(30.0 if share < 0.1 else 5.0)
    return MotionPlan(
        t_s=t_s,
        phase="drive",
        speed_m_s=speed,
        turn_m_s=0.0 if 0.25 < share < 0.28 else None,
        heading_rad=0.1 if 0.3 < share < 0.4 else 0.0,
        min_inner_speed_ratio=None if share < 0.05 else inner_speed_ratio(error_rad),
    )


def _seen(k: int, t_s: float, y: Float[np.ndarray, " 2"]) -> HeadingEstimate | None:
    if 60 <= k < 63:
        return None
    heading = {80: math.nan, 81: 4.0}.get(k, float(y[0]))
    return HeadingEstimate(t_s=t_s, heading_rad=heading, heading_rate_rad_s=float(y[1]), sigma_rad=0.002, source="vision")


def _c_files(design: ControllerDesign, config: ControllerConfig, log: Sequence[Exchange]) -> dict[str, str]:
    """Return the controller as C99: source, header, constants, and a test that replays the log."""
    written = {name: _written(name, design, config, log) for name in ("heading_numbers.h", "heading_log.h")}
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(SOURCES.glob("heading_*.[ch]"))} | written


def _written(name: str, design: ControllerDesign, config: ControllerConfig, log: Sequence[Exchange]) -> str:
    """Return a file from its template."""
    engine = Environment(loader=FileSystemLoader(SOURCES), trim_blocks=True, keep_trailing_newline=True, autoescape=False)  # noqa: S701 - C and YAML
    engine.filters["json"] = json.dumps
    return engine.get_template(f"{name}.j2").render(
        settings=_settings_of(design, config),
        states=design.model.order,
        learns=design.disturbance_gain is not None,
        matrices=_matrices(design, config),
        tolerance_m_s=TOLERANCE_M_S,
        log=[_row(exchange) for exchange in log],
    )


def _is_static(design: ControllerDesign, config: ControllerConfig) -> bool:
    """Whether the state is reconstructed from one output (Eq. 11b) instead of an observer."""
    return (config.reconstruct or design.reconstruct) == "static"


def _matrices(design: ControllerDesign, config: ControllerConfig) -> dict[str, Float[np.ndarray, "..."]]:
    """Return the matrices of the controller under the names of the equations."""
    model, late = design.model, np.array(design.model.input_delay)
    if _is_static(design, config):
        return {"K": design.K, "inverse": static_inverse(design), "output_offset": model.output_offset, "input_delay": late}
    found = {
        "A": model.A,
        "B": model.B,
        "C": model.C,
        "D": model.D,
        "K": design.K,
        "output_offset": model.output_offset,
        "input_delay": late,
        "observer_gain": design.observer_gain,
        "correction": np.linalg.pinv(model.A) @ design.observer_gain,
        "start": np.linalg.pinv(model.C),
    }
    return found if design.disturbance_gain is None else found | {"disturbance_gain": design.disturbance_gain}


def _row(exchange: Exchange) -> tuple[bool, bool, str, str, bool]:
    """Return whether a period has an estimate and steers, the other inputs and the belt speeds as C, and the brake."""
    seen, plan, answer = exchange.estimate, exchange.plan, exchange.answer
    heading, rate = (0.0, 0.0) if seen is None else (seen.heading_rad, seen.heading_rate_rad_s)
    steps = ", ".join(_literal(value) for value in (heading, rate, plan.speed_m_s, plan.heading_rad, inner_ratio_of(plan)))
    outputs = ", ".join(_literal(value) for value in (answer.left_m_s, answer.right_m_s))
    return seen is not None, plan.turn_m_s is None, steps, outputs, answer.brake


def _literal(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"


def _json_files(design: ControllerDesign, config: ControllerConfig, log: Sequence[Exchange]) -> dict[str, str]:
    """Return design, settings and log in one file."""
    steps = [
        {
            "steers": exchange.plan.turn_m_s is None,
            "heading_rad": _json_number(getattr(exchange.estimate, "heading_rad", math.nan)),
            "heading_rate_rad_s": _json_number(getattr(exchange.estimate, "heading_rate_rad_s", math.nan)),
            "speed_m_s": _json_number(exchange.plan.speed_m_s),
            "target_heading_rad": _json_number(exchange.plan.heading_rad),
            "min_inner_speed_ratio": _json_number(inner_ratio_of(exchange.plan)),
            "left_m_s": exchange.answer.left_m_s,
            "right_m_s": exchange.answer.right_m_s,
            "brake": exchange.answer.brake,
        }
        for exchange in log
    ]
    values = {
        "settings": _settings_of(design, config),
        "matrices": {name: matrix.tolist() for name, matrix in _matrices(design, config).items()},
        "provenance": design.provenance,
        "self_test": {"tolerance_m_s": TOLERANCE_M_S, "log": steps},
    }
    return {"heading_controller.json": json.dumps(values, indent=1, allow_nan=False) + "\n"}


def _json_number(value: float) -> float | None:
    """Return a JSON value: None for NaN and Inf, which stop the chair like a missing estimate."""
    return value if math.isfinite(value) else None


def _settings_of(design: ControllerDesign, config: ControllerConfig) -> dict[str, Any]:
    """Return the settings of the controller."""
    return {
        "vehicle": design.vehicle,
        **asdict(config),
        "reconstruct": "static" if _is_static(design, config) else "observer",
        "max_mean_m_s": MAX_MEAN_M_S,
        "slowest_climbing": INNER_RATIO_CLIMBING,
        "slowest_backing": INNER_RATIO_NEAR_STRAIGHT,
        "fastest_turn_rad_s": FASTEST_TURN_RAD_S,
        "disturbance_limit_m_s": DISTURBANCE_LIMIT,
        "yaw_rate_sigma_rad_s": YAW_RATE_SIGMA_RAD_S,
        "belt_difference": BELT_DIFFERENCE.tolist(),
    }
