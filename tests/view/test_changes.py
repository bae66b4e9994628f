"""Changes that the page offers: each is a fault within its range, and every other value is refused with its reason."""

import pytest

pytest.importorskip("viser")

from treadline.scenario.faults import EXTENTS
from treadline.view.whatif import CHANGES, FORKS, NAMES, NOTHING, fault_of, last_line, meaning, said_of


@pytest.mark.parametrize("choice", CHANGES)
def test_each_change_is_a_fault_with_the_value_that_the_form_fills_in(choice: str) -> None:
    change = CHANGES[choice]
    fault = fault_of(choice, change.default, 2.0)
    assert fault is not None
    assert (fault.kind, fault.size) == (change.kind, change.sign * change.default)
    assert (fault.for_s == 2.0) == (not change.stays)
    assert meaning(choice)


def test_every_fault_has_a_name_and_wet_steps_are_offered_first() -> None:
    """Test: names of the faults, and the form of a fork. Expected: each kind is named without its code; wet steps halve it."""
    assert NAMES.keys() == EXTENTS.keys()
    assert not any("_" in name for name in CHANGES)
    wet = fault_of(FORKS[0], CHANGES[FORKS[0]].default, 1.0)
    assert wet is not None
    assert (wet.kind, wet.size) == ("low_friction", 0.5)
    assert said_of(FORKS[0], 0.5, 1.0) == "wet steps, friction × 0.5"
    assert fault_of(NOTHING, 0.0, 1.0) is None


@pytest.mark.parametrize(
    ("choice", "value", "said"),
    [
        ("wet steps (friction × 0.5)", 2.1, "value is 2.1; a factor on the friction must be from 0.1 to 2"),
        ("friction of the right belt", -0.5, "value is -0.5; a factor on the friction must be from 0.1 to 2"),
        ("passenger's weight up", 0.4, "value is 0.4; for payload_up it must be from -0.3 to 0.3"),
        ("passenger leans to the left for a time", -0.5, "value is -0.5; for payload_left it must be from -0.3 to 0.3"),
    ],
)
def test_a_value_out_of_range_is_refused_with_its_range(choice: str, value: float, said: str) -> None:
    with pytest.raises(ValueError, match="value is") as caught:
        fault_of(choice, value, 1.0)
    assert said in last_line(caught.value)


def test_friction_may_double_on_one_side() -> None:
    fault = fault_of("friction of the right belt", 2.0, 1.0)
    assert fault is not None
    assert (fault.kind, fault.size) == ("track_slip", -2.0)
