"""Contents of a sweep file, and draws within its ranges."""

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats.qmc import Sobol

from treadline.campaign._sobol_sampling import points, run_seed
from treadline.campaign.spec import Drawn, Spec, read_spec, scenario_toml
from treadline.core.errors import SettingsError
from treadline.scenario.faults import Fault
from treadline.scenario.scenario import Scenario, read_scenario

Write = Callable[[str], Path]
ENVELOPE = read_spec("envelope")
OUTSIDE = read_spec("outside")
shares = st.lists(st.floats(0.0, 1.0), min_size=ENVELOPE.dimension, max_size=ENVELOPE.dimension)


def drawn(spec: Spec, count: int, sampling: Any = "sobol", seed: int = 0) -> list[Drawn]:
    return [spec.at(point.tolist(), "a run") for point in points(sampling, spec.dimension, seed, count)]


@pytest.fixture(scope="module")
def fixed() -> Spec:
    """Return the envelope with two set values; its corners are checked once."""
    return read_spec("envelope", {"stair.width_m": 1.3, "start.heading_deg": 3.0})


@given(point=shares)
@settings(max_examples=20)
def test_a_set_value_holds_in_every_run_and_leaves_the_other_draws_as_they_are(fixed: Spec, point: list[float]) -> None:
    without, having = ENVELOPE.at(point, "a run"), fixed.at(point, "a run")
    assert (having.scenario.stair.width_m, having.scenario.start.heading_deg) == (1.3, 3.0)
    assert having.values == without.values | {
        key: having.values[key] for key in ("stair.width_m", "start.heading_deg") if key in having.values
    }
    assert fixed.digest != ENVELOPE.digest


@given(shares)
@settings(max_examples=60)
def test_every_draw_is_within_the_claimed_envelope(point: list[float]) -> None:
    scenario = ENVELOPE.at(point, "a run").scenario
    stair, chair, start = scenario.stair, scenario.chair, scenario.start
    slope_deg = math.degrees(stair.slope_rad)
    assert 20.0 - 1e-9 <= slope_deg <= 30.0 + 1e-9
    assert 0.12 <= stair.rise_m <= 0.18
    assert 1.1 * math.tan(stair.slope_rad) - 1e-9 <= stair.friction[0] <= 1.0
    assert 0.0 <= chair.payload_kg <= (110.0 if slope_deg <= 26.0 + 1e-9 else 80.0)
    assert all(abs(offset) <= limit for offset, limit in zip(chair.payload_offset_m, (0.05, 0.04, 0.10), strict=True))
    assert 0.0 <= stair.rise_jitter_m <= 0.002
    assert abs(start.heading_deg) <= 30.0
    assert abs(start.lateral_m) <= 0.15
    assert 0.5 <= stair.light <= 1.6
    assert abs(chair.belt_mismatch) <= 0.03
    assert 8 <= stair.steps <= 14
    assert start.place == {"up": "floor", "down": "landing"}[scenario.drive.direction]


def test_a_thousand_draws_fill_the_envelope() -> None:
    runs = [run.scenario for run in drawn(ENVELOPE, 1000)]
    assert sum(run.sensors.camera == "kinect1" for run in runs) >= 200
    assert {run.sensors.camera for run in runs} == {"kinect1", "statistical"}
    assert {run.stair.texture for run in runs} == {"wood", "concrete", "carpet", "terrazzo", "dark"}
    assert Counter(run.drive.direction for run in runs) == {"up": 500, "down": 500}
    assert {run.stair.open_risers for run in runs} == {True, False}
    assert {run.stair.steps for run in runs} == set(range(8, 15))
    # Ends of ranges are reached to a hundredth of their width.
    slopes = [math.degrees(run.stair.slope_rad) for run in runs]
    assert (min(slopes), max(slopes)) == (pytest.approx(20.0, abs=0.1), pytest.approx(30.0, abs=0.1))
    assert max(run.chair.payload_kg for run in runs) > 108.0


def test_outside_scenarios_violate_one_limit_each() -> None:
    runs = drawn(OUTSIDE, 200)
    assert Counter(run.values["label"] for run in runs).keys() == {"low friction", "steep", "overloaded", "missing steps"}
    for run in runs:
        stair, label = run.scenario.stair, run.values["label"]
        assert (stair.friction[0] < 1.03 * math.tan(stair.slope_rad)) == (label == "low friction")
        assert (stair.slope_rad > math.radians(30.1)) == (label == "steep")
        assert (run.scenario.chair.payload_kg > 110.0) == (label == "overloaded")
        assert bool(stair.missing_steps) == (label == "missing steps")


def cube(*sampled: Any) -> np.ndarray:
    return np.array(list(points(*sampled)))


def test_sobol_points_are_those_of_one_long_draw() -> None:
    whole = Sobol(3, scramble=True, rng=7).random_base2(13)
    np.testing.assert_array_equal(cube("sobol", 3, 7, 5000), whole[:5000])


@pytest.mark.parametrize("sampling", ["random", "sobol"])
@given(fewer=st.integers(1, 40), more=st.integers(0, 100), seed=st.integers(0, 2**40))
@settings(max_examples=25)
def test_run_k_does_not_depend_on_the_number_of_runs(sampling: Any, fewer: int, more: int, seed: int) -> None:
    short, long = (cube(sampling, 7, seed, count) for count in (fewer, fewer + more))
    np.testing.assert_array_equal(short, long[:fewer])
    assert ((long >= 0.0) & (long < 1.0)).all()


def test_every_seed_and_run_has_a_different_point_and_seed() -> None:
    for sampling in ("random", "sobol"):
        one, other = cube(sampling, 3, 1, 64), cube(sampling, 3, 2, 64)
        assert not np.isin(one, other).any()
    assert len({run_seed(seed, index) for seed in range(30) for index in range(30)}) == 900


def test_a_drawn_scenario_reads_back_to_the_last_bit(tmp_path: Path) -> None:
    fault = Fault(kind="camera_lost", at_s=1.0 / 3.0)
    for run in drawn(ENVELOPE, 16):
        scenario = run.scenario.model_copy(update={"fault": (fault,)})
        path = tmp_path / "run.toml"
        path.write_text(scenario_toml(scenario, "a note"), encoding="utf-8")
        assert read_scenario(path) == scenario


def test_the_digest_ignores_layout_but_depends_on_every_number(spec_file: Write) -> None:
    text = '[[draw]]\nkey = "start.heading_deg"\nuniform = [-30, 30]\n'
    first = read_spec(spec_file(text)).digest
    assert read_spec(spec_file("# a remark\n\n" + text)).digest == first
    assert read_spec(spec_file(text.replace("-30", "-29"))).digest != first


def test_weights_and_truncated_normals_have_the_stated_distribution(spec_file: Write) -> None:
    spec = read_spec(
        spec_file(
            '[[draw]]\nkey = "stair.texture"\nchoice = ["wood", "dark"]\nweights = [3, 1]\n'
            '[[draw]]\nkey = "start.heading_deg"\nnormal = { mean = 5, sigma = 10, low = -5, high = 15 }\n'
        )
    )
    runs = [run.scenario for run in drawn(spec, 1024)]
    assert sum(run.stair.texture == "wood" for run in runs) == pytest.approx(768, abs=2)
    headings = np.array([run.start.heading_deg for run in runs])
    assert (headings.min() >= -5.0, headings.max() <= 15.0) == (True, True)
    # Normal distribution truncated at one sigma on both sides: same mean, standard deviation 0.540 sigma.
    assert (headings.mean(), headings.std()) == (pytest.approx(5.0, abs=0.1), pytest.approx(5.40, abs=0.1))


def test_faults_may_be_drawn(spec_file: Write) -> None:
    spec = read_spec(
        spec_file(
            '[[fault]]\nkind = "camera_lost"\n[[draw]]\nkey = "fault.0.at_s"\nuniform = [5, 30]\n'
            '[[draw]]\nkey = "fault.0.kind"\nchoice = ["camera_lost", "imu_lost"]\n'
        )
    )
    faults = [run.scenario.fault[0] for run in drawn(spec, 8)]
    assert {fault.kind for fault in faults} == {"camera_lost", "imu_lost"}
    assert all(5.0 <= fault.at_s <= 30.0 for fault in faults)


def test_a_bound_may_be_another_value_and_a_constant(spec_file: Write) -> None:
    """Test: a last riser 20 mm lower to 50 mm higher than the drawn rise. Expected result: at the quantiles 0, 0.5 and 1."""
    text = """
[[draw]]
key = "stair.rise_m"
uniform = [0.14, 0.18]
[[draw]]
key = "step.0.index"
value = -1
[[draw]]
key = "step.0.rise_m"
uniform = [{ times = 1.0, of = "stair.rise_m", plus = -0.02 }, { times = 1.0, of = "stair.rise_m", plus = 0.05 }]
"""
    spec = read_spec(spec_file(text))
    rises = [spec.at((0.5, share), "a run").scenario.step[0].rise_m for share in (0.0, 0.5, 1.0)]
    assert rises == pytest.approx([0.14, 0.175, 0.21])


def test_the_dimensions_of_buildings_reach_their_ends() -> None:
    """Test: the label "full flight", all else at its upper end. Expected result: literals of the issue that asked for them."""
    spec = read_spec("buildings")
    drawn = spec.at([0.7, *[1.0 - 1e-12] * (spec.dimension - 1)], "a run")
    stair, chair = drawn.scenario.stair, drawn.scenario.chair
    assert drawn.values["label"] == "full flight"
    assert (stair.steps, stair.rise_jitter_m, stair.run_jitter_m) == pytest.approx((40, 0.004, 0.004))
    assert [step.rise_m - stair.rise_m for step in drawn.scenario.step] == pytest.approx([0.05, 0.05, 0.012])
    assert (*chair.lean_m, stair.side_slope_deg, abs(drawn.scenario.start.lateral_m)) == pytest.approx((0.12, 0.12, 2.0, 0.3))


def test_a_sweep_is_not_listed_or_run_as_a_scenario() -> None:
    with pytest.raises(SettingsError, match=r"shipped: default, down-28, .*, straight-25, up-28"):
        read_scenario("paper-29")
    with pytest.raises(SettingsError, match=r"\(shipped: buildings, envelope, outside\)"):
        read_spec("envelop")
    with pytest.raises(SettingsError, match="a sweep, not one scenario; run it with treadline sweep"):
        read_scenario(ENVELOPE.path)
    assert isinstance(Scenario.model_validate(ENVELOPE.base), Scenario)
