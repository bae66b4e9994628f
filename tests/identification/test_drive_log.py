"""What a drive log does not show about the vehicle is named, and the yaw gain is not worse than by least squares."""

import re
from dataclasses import replace

import numpy as np
import pytest
from drive_logs import KINDS, MOTION, drive_log, outcome
from systems import fit

from treadline.core.models import InputOutputRecord
from treadline.identification._turn_fit import turn_fit

FINDINGS = {
    "closed": r"feedback: .* explain \d+ % of what is new in .*: .*add dither",
    "sine": r"one frequency: .* Hz holds \d+ % .*vary",
    "static": r"table: no output depends on the rows before it",
    "constant throttle": r"constant input: 'throttle_m_s' is constant at 0\.3 and left out",
    "belts together": r"the difference of both is the only input|always differ by the same speed",
}
"""Messages that must name the cause, by the kind of log."""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_no_log_gives_a_wrong_yaw_gain_without_naming_the_cause(kind: str, seed: int) -> None:
    found = outcome(drive_log(kind, seed))
    assert not found.silently_wrong, found
    assert not found.is_worse, found
    if kind in FINDINGS:
        assert any(re.search(FINDINGS[kind], message) for message in found.messages), found.messages


@pytest.mark.parametrize("kind", ["open", "filtered", "delayed"])
def test_a_sound_log_raises_no_finding(kind: str) -> None:
    for seed in range(4):
        assert fit(drive_log(kind, seed).record, method="okid-era", lags=4).findings.lines == ()


def open_log(seed: int) -> InputOutputRecord:
    """Return a sound log with a heading within half a turn."""
    record = drive_log("dithered", seed).record
    return replace(record, output_names=MOTION)


def findings_of(record: InputOutputRecord) -> str:
    return "\n".join(fit(record, method="okid-era", lags=4).findings.lines)


def test_a_heading_against_the_yaw_rate_is_reported() -> None:
    record = open_log(7)
    assert "integrator" not in findings_of(record)
    assert "integrator: 'heading_rad' changes by -" in findings_of(replace(record, y=record.y * [-1.0, 1.0]))
    # A yaw rate in degrees under a name in radians is 57 times too large.
    assert "integrator" in findings_of(replace(record, y=record.y * [1.0, np.degrees(1.0)]))
    assert "integrator" not in findings_of(replace(record, y=record.y * [-1.0, 1.0], output_names=("a", "b")))


def test_a_wrapped_heading_is_reported() -> None:
    record = open_log(7)
    wrapped = np.angle(np.exp(1j * (record.y[:, :1] + np.linspace(0.0, 9.0, len(record))[:, None])))
    assert "wrapped angle: 'heading_rad' jumps" in findings_of(replace(record, y=np.hstack([wrapped, record.y[:, 1:]])))


def test_the_structure_by_names_can_be_switched_off() -> None:
    record = drive_log("delayed", 4).record
    assert fit(record).report.skid_steer is not None
    free = fit(record, name_prior=False).report
    assert (free.skid_steer, free.mirrored, free.step == "structure") == (None, False, False)


@pytest.mark.parametrize("kind", ["open", "filtered", "dithered", "delayed"])
def test_gauge_and_dead_time_are_found_with_an_honest_interval(kind: str) -> None:
    inside = []
    for seed in range(200, 210):
        log = drive_log(kind, seed)
        found = turn_fit([log.record])
        assert found is not None
        words = found.described()
        assert words is not None
        inside.append(words.gauge_m.low <= 1.0 / log.yaw_gain <= words.gauge_m.high)
        assert not words.acts_at_once
        assert (words.dead_time_samples >= 3) == (kind == "delayed")
        assert 0.0 <= words.lag_s["left_m_s"].low <= words.lag_s["left_m_s"].value <= words.lag_s["left_m_s"].high
    # 95 of 100 are inside, so that fewer than 8 of 10 are a chance of one in ninety.
    assert np.mean(inside) >= 0.8


def test_a_heading_alone_shows_the_gauge() -> None:
    log = drive_log("filtered", 5)
    record = replace(log.record, y=log.record.y[:, :1], output_names=log.record.output_names[:1])
    words = fit(record, method="okid-era", lags=4).report.skid_steer
    assert words is not None
    assert words.gauge_m.value == pytest.approx(1.0 / log.yaw_gain, rel=0.1)


def test_swapped_belts_are_reported() -> None:
    record = drive_log("filtered", 6).record
    warnings = fit(replace(record, input_names=record.input_names[::-1])).report.warnings
    assert any("are left and right exchanged" in warning for warning in warnings)


def test_a_log_that_hardly_turns_gives_one_sentence() -> None:
    record = open_log(7)
    middle, noise = record.u.mean(axis=1, keepdims=True), np.random.default_rng(0).standard_normal(record.y.shape)
    straight = replace(record, u=middle + 0.01 * (record.u - middle), y=0.01 * (record.y + noise))
    (warning,) = fit(straight).report.warnings
    assert re.fullmatch(r"the vehicle hardly turns: .* move nearly together; .*; record a drive with curves to both sides", warning)


def test_validation_data_lose_the_same_inputs() -> None:
    record = drive_log("constant throttle", 2).record
    cut = len(record) // 2
    first, second = (replace(record, u=record.u[part], y=record.y[part]) for part in (slice(cut), slice(cut, None)))
    assert fit(first, validation=second).model.input_names == ("steer_m_s",)


def test_collinear_inputs_of_no_belts_are_left_out() -> None:
    record = drive_log("open", 3).record
    for weights, partners in (([1.0, 2.0], "'a' and 'b'"), ([0.0, 2.0], "'b'")):
        u = np.column_stack([record.u, record.u @ weights])
        found = fit(replace(record, u=u, input_names=("a", "b", "c")), method="okid-era", order=2)
        assert found.model.input_names == ("a", "b")
        assert f"collinear input: 'c' always moves with {partners} and is left out" in found.report.warnings[0]
