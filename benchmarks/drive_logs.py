"""Generated drive logs with a known yaw gain: ``python benchmarks/drive_logs.py [--first SEED] [--seeds 20]``.

Eleven kinds of log, twenty seeds each: some are sound, some cannot show how the belts turn the vehicle. A log is *silently wrong*
if the model's yaw gain has another sign or is off by more than ``WRONG``, and no warning names the cause. Least squares is the
regression of the yaw rate on the difference of the belt speeds, of the same row or of the row before, whichever explains more.
"""

import argparse
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from treadline.core.errors import RecordError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import IdentificationOptions, identify

BELTS = ("left_m_s", "right_m_s")
MOTION = ("heading_rad", "yaw_rate_rad_s")
WRONG = 0.3
"""Relative error of the yaw gain above which a log without a warning counts as silently wrong."""
SETTLED_S = 10.0
"""Time after a step of the belts' difference at which the yaw gain is read: at least twelve of the longest lag of 0.8 s."""
SUBSTEPS = 10
"""Steps of the simulation in each period."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningVehicle:
    """Skid-steer vehicle: each belt speed lags its command, the yaw rate is their difference over the effective gauge."""

    gauge_m: float
    lag_s: tuple[float, float]
    dt_s: float
    slip_rad_s: float
    """Standard deviation of the yaw rate by slip, correlated over half a second."""
    noise: tuple[float, float]
    """Standard deviations of the measured heading [rad] and yaw rate [rad/s]."""

    @property
    def yaw_gain(self) -> float:
        """Yaw rate per difference of the belt speeds [rad/m]."""
        return 1.0 / self.gauge_m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeneratedLog:
    """Record with its true yaw gain and the words of which a warning must use one if the model is wrong."""

    kind: str
    record: InputOutputRecord
    yaw_gain: float
    turning: Float[np.ndarray, " m"]
    """Inputs that differ by one in belt speed difference."""
    causes: str


Command = Callable[[int, float], tuple[float, float]]
"""Commanded left and right belt speed of a period, from its number and the measured heading."""


def some_vehicle(rng: np.random.Generator) -> TurningVehicle:
    """Return a vehicle: gauge 0.5 to 1.2 m, lags 0.02 to 0.8 s that differ by a tenth at most, 4 to 20 Hz."""
    lag_s = float(np.exp(rng.uniform(np.log(0.02), np.log(0.8))))
    return TurningVehicle(
        gauge_m=float(rng.uniform(0.5, 1.2)),
        lag_s=(lag_s, lag_s * float(rng.uniform(0.9, 1.1))),
        dt_s=float(rng.choice([0.05, 0.1, 0.25])),
        slip_rad_s=float(rng.uniform(0.005, 0.03)),
        noise=(float(rng.uniform(0.001, 0.01)), float(rng.uniform(0.002, 0.02))),
    )


def driven(
    vehicle: TurningVehicle, rng: np.random.Generator, command: Command, samples: int, *, delay: int = 0, heading_rad: float = 0.0
) -> tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T 2"]]:
    """Return commanded belt speeds and measured heading and yaw rate of a drive; feedback acts on the measured heading."""
    step_s = vehicle.dt_s / SUBSTEPS
    decay = np.exp(-step_s / np.array(vehicle.lag_s))
    slip_decay = np.exp(-vehicle.dt_s / 0.5)
    commands, y = np.zeros((samples, 2)), np.zeros((samples, 2))
    belts, heading, slip = np.full(2, 0.3), heading_rad, 0.0
    for k in range(samples):
        rate = (belts[1] - belts[0]) * vehicle.yaw_gain + slip
        y[k] = np.array([heading, rate]) + rng.normal(0.0, vehicle.noise)
        commands[k] = command(k, y[k, 0])
        target = commands[k - delay] if k >= delay else np.full(2, 0.3)
        for _ in range(SUBSTEPS):
            belts = target + (belts - target) * decay
            heading += step_s * ((belts[1] - belts[0]) * vehicle.yaw_gain + slip)
        slip = slip_decay * slip + np.sqrt(1.0 - slip_decay**2) * vehicle.slip_rad_s * rng.standard_normal()
    return commands, y


def white(rng: np.random.Generator, samples: int, std_m_s: float = 0.1) -> Float[np.ndarray, "T 2"]:
    """Return independent white belt speeds."""
    return np.asarray(0.3 + std_m_s * rng.standard_normal((samples, 2)))


def as_command(u: Float[np.ndarray, "T 2"]) -> Command:
    """Return the command that follows a table, in open loop."""
    return lambda k, _: (float(u[k, 0]), float(u[k, 1]))


def heading_hold(gain: float, dither: Float[np.ndarray, "T 2"], speed: Float[np.ndarray, " T"]) -> Command:
    """Return the command that turns the heading to zero, with dither on each belt."""

    def command(k: int, heading_rad: float) -> tuple[float, float]:
        turn = float(np.clip(-gain * heading_rad, -0.4, 0.4))
        return speed[k] - 0.5 * turn + dither[k, 0], speed[k] + 0.5 * turn + dither[k, 1]

    return command


def drive_log(kind: str, seed: int) -> GeneratedLog:
    """Return the log of a kind and a seed."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    vehicle = some_vehicle(rng)
    return KINDS[kind](kind, vehicle, rng, int(rng.integers(300, 1500)))


def _log(kind: str, vehicle: TurningVehicle, u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"], causes: str) -> GeneratedLog:
    is_unwrapped = np.abs(y[:, 0]).max() > np.pi
    names = ("heading_unwrapped_rad", MOTION[1]) if is_unwrapped else MOTION
    record = InputOutputRecord(u=u, y=y, dt_s=vehicle.dt_s, input_names=BELTS, output_names=names)
    return GeneratedLog(kind=kind, record=record, yaw_gain=vehicle.yaw_gain, turning=np.array([-0.5, 0.5]), causes=causes)


def _open(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    return _log(kind, vehicle, *driven(vehicle, rng, as_command(white(rng, samples)), samples), "nothing excuses this kind")


def _filtered(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    """A person's commands: low-passed with one second."""
    decay = np.exp(-vehicle.dt_s / 1.0)
    u = 0.3 + lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], white(rng, samples) - 0.3, axis=0)
    return _log(kind, vehicle, *driven(vehicle, rng, as_command(u), samples), "nothing excuses this kind")


def _delayed(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    delay = int(rng.integers(3, 31))
    return _log(kind, vehicle, *driven(vehicle, rng, as_command(white(rng, samples)), samples, delay=delay), "dead time")


def _held(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int, dither_m_s: float) -> GeneratedLog:
    dither = dither_m_s * rng.standard_normal((samples, 2))
    speed = 0.3 + float(rng.choice([0.0, 0.1])) * rng.standard_normal(samples)
    gain = float(rng.uniform(0.3, 1.0)) * vehicle.gauge_m / max(*vehicle.lag_s, vehicle.dt_s)
    start = float(rng.uniform(-0.8, 0.8))
    quiet = replace(vehicle, noise=(0.0, 0.0)) if dither_m_s == 0.0 and rng.random() < 0.5 else vehicle
    return _log(kind, quiet, *driven(quiet, rng, heading_hold(gain, dither, speed), samples, heading_rad=start), "feedback")


def _closed(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    return _held(kind, vehicle, rng, samples, 0.0)


def _dithered(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    return _held(kind, vehicle, rng, samples, float(rng.uniform(0.03, 0.1)))


def _closed_noisy(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    log = _held(kind, vehicle, rng, samples, float(rng.choice([0.0, 0.05])))
    return replace(log, record=with_belt_noise(log.record, rng), causes="feedback|noise of the (measured )?inputs")


def _noisy(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    log = _filtered(kind, vehicle, rng, samples)
    return replace(log, record=with_belt_noise(log.record, rng), causes="noise of the (measured )?inputs")


def with_belt_noise(record: InputOutputRecord, rng: np.random.Generator) -> InputOutputRecord:
    """Return the record with measured belt speeds: white noise of 10 to 50 % of the difference's deviation."""
    level = float(rng.uniform(0.1, 0.5)) * float(np.std(record.u[:, 1] - record.u[:, 0])) / np.sqrt(2.0)
    return replace(record, u=record.u + level * rng.standard_normal(record.u.shape))


def _sine(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    t_s = vehicle.dt_s * np.arange(samples)
    turn = 0.1 * np.sin(2.0 * np.pi * float(rng.uniform(0.1, 0.5)) * t_s + float(rng.uniform(0.0, 6.0)))
    speed = 0.3 + float(rng.choice([0.0, 0.1])) * rng.standard_normal(samples)
    u = np.column_stack([speed - turn, speed + turn])
    return _log(kind, vehicle, *driven(vehicle, rng, as_command(u), samples), "frequency|frequencies")


def _static(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    """A table of steady states, or a drive whose rows were shuffled."""
    u, shuffled = white(rng, samples), bool(rng.random() < 0.5)
    if shuffled:
        u, y = driven(vehicle, rng, as_command(u), samples)
        order = rng.permutation(samples)
        return _log(kind, vehicle, u[order], y[order], "table|order of the rows|in order")
    rate = (u[:, 1] - u[:, 0]) * vehicle.yaw_gain + vehicle.noise[1] * rng.standard_normal(samples)
    log = _log(kind, vehicle, u, np.column_stack([rate, rate]), "table|order of the rows|in order")
    return replace(log, record=replace(log.record, y=rate[:, None], output_names=MOTION[1:]))


def _constant_throttle(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    steer = 0.2 * rng.standard_normal(samples)
    u = np.column_stack([0.3 - 0.5 * steer, 0.3 + 0.5 * steer])
    _, y = driven(vehicle, rng, as_command(u), samples)
    log = _log(kind, vehicle, np.column_stack([np.full(samples, 0.3), steer]), y, "constant")
    return replace(log, record=replace(log.record, input_names=("throttle_m_s", "steer_m_s")), turning=np.array([0.0, 1.0]))


def _together(kind: str, vehicle: TurningVehicle, rng: np.random.Generator, samples: int) -> GeneratedLog:
    """Belts of equal speed, belts that mirror each other, or one belt at rest."""
    case, moving = int(rng.integers(3)), 0.1 * rng.standard_normal(samples)
    u = 0.3 + np.column_stack([moving, (1.0, -1.0, 0.0)[case] * moving])
    return _log(kind, vehicle, *driven(vehicle, rng, as_command(u), samples), "equal speed|difference|constant")


KINDS: dict[str, Callable[[str, TurningVehicle, np.random.Generator, int], GeneratedLog]] = {
    "open": _open,
    "filtered": _filtered,
    "delayed": _delayed,
    "dithered": _dithered,
    "noisy belts": _noisy,
    "closed": _closed,
    "closed, noisy belts": _closed_noisy,
    "sine": _sine,
    "static": _static,
    "constant throttle": _constant_throttle,
    "belts together": _together,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How an identification of a log ended."""

    error: float
    """Relative error of the model's yaw gain; NaN for a rejected log."""
    least_squares_error: float
    """Relative error of the yaw rate's regression on the difference of the belt speeds."""
    least_squares_std: float
    named: bool
    """Whether a warning, or the rejection, names the cause."""
    messages: tuple[str, ...]
    cpu_s: float

    @property
    def is_worse(self) -> bool:
        """Whether the error exceeds that of least squares by more than the regression's interval of 95 %."""
        return bool(self.error > self.least_squares_error + 1.96 * self.least_squares_std)

    @property
    def silently_wrong(self) -> bool:
        """Whether the yaw gain is wrong and nothing names the cause."""
        return bool(self.error > WRONG and not self.named)


def yaw_gain(model: LinearModel, turning: Float[np.ndarray, " m"]) -> float:
    """Return the model's yaw rate, its last output, a settling time after a step of the belts' difference."""
    step = turning[: model.B.shape[1]] if len(turning) == model.B.shape[1] else turning[turning != 0.0]
    x = np.zeros(model.order)
    for _ in range(round(SETTLED_S / model.dt_s)):
        x = model.A @ x + model.B @ step
    return float((model.C @ x + model.D @ step)[-1])


def least_squares_gain(log: GeneratedLog) -> tuple[float, float]:
    """Return slope and standard deviation of the yaw rate's regression on the belts' difference, of the row or the row before."""
    difference, rate = log.record.u @ (log.turning / (log.turning @ log.turning)), log.record.y[:, -1]
    return min((_regression(difference[: len(rate) - lag], rate[lag:]) for lag in (0, 1)), key=lambda fit: fit[2])[:2]


def _regression(x: Float[np.ndarray, " T"], y: Float[np.ndarray, " T"]) -> tuple[float, float, float]:
    """Return slope, its standard deviation, and the deviation of the residuals."""
    x, y = x - x.mean(), y - y.mean()
    square = float(x @ x)
    if square < 1e-12:
        return 0.0, np.inf, float(np.std(y))
    slope = float(x @ y) / square
    left = float(np.std(y - slope * x))
    return slope, left / float(np.sqrt(square)), left


def outcome(log: GeneratedLog, options: IdentificationOptions | None = None) -> Outcome:
    """Return the outcome of identifying a log."""
    started, error = time.process_time(), np.nan
    try:
        found = identify(log.record, options or IdentificationOptions())
        messages = tuple(found.report.warnings)
        error = abs(yaw_gain(found.model, log.turning) / log.yaw_gain - 1.0)
    except RecordError as rejection:
        messages = (str(rejection),)
    slope, std = least_squares_gain(log)
    return Outcome(
        error=float(error),
        least_squares_error=abs(slope / log.yaw_gain - 1.0),
        least_squares_std=std / log.yaw_gain,
        named=any(re.search(log.causes, message) for message in messages),
        messages=messages,
        cpu_s=time.process_time() - started,
    )


def row_of(kind: str, found: list[Outcome]) -> str:
    """Return the table's row of a kind."""
    known = [item for item in found if np.isfinite(item.error)]
    columns = (
        len(found),
        len(found) - len(known),
        sum(item.silently_wrong for item in found),
        sum(item.error > WRONG and item.named for item in known),
        sum(item.is_worse for item in known),
        f"{100.0 * np.median([item.error for item in known] or [np.nan]):.1f} %",
        f"{100.0 * max([item.error for item in known], default=np.nan):.1f} %",
        f"{100.0 * np.median([item.least_squares_error for item in found]):.1f} %",
        f"{np.mean([item.cpu_s for item in found]):.2f}",
    )
    return f"| {kind} | " + " | ".join(str(column) for column in columns) + " |"


COLUMNS = (
    "kind", "logs", "rejected", "silently wrong", "wrong, cause named", "worse than least squares", "median error", "largest error",
    "least squares, median error", "CPU s per log",
)  # fmt: skip


def main() -> None:
    """Print a table of the kinds, and each log that is silently wrong or worse than least squares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", nargs="*", default=list(KINDS))
    asked = parser.parse_args()
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    notes = []
    for kind in asked.only:
        seeds = range(asked.first, asked.first + asked.seeds)
        found = [outcome(drive_log(kind, seed)) for seed in seeds]
        print(row_of(kind, found), flush=True)
        for seed, item in zip(seeds, found, strict=True):
            if item.silently_wrong or item.is_worse:
                errors = f"{100 * item.error:.1f} %, least squares {100 * item.least_squares_error:.1f} %"
                notes.append(
                    f"{kind} {seed}: {'silently wrong' if item.silently_wrong else 'worse'}, {errors}; {list(item.messages)}"
                )
    print("\n" + "\n".join(notes))


if __name__ == "__main__":
    main()
