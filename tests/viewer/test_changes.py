"""Changes that the page offers: each is a fault within its range, and every other value is refused with its reason."""

import pytest

pytest.importorskip("viser")

from treadline.viewer.app import CHANGES, _fault, _last_line


@pytest.mark.parametrize("choice", CHANGES)
def test_each_change_has_a_default_and_its_sign(choice: str) -> None:
    kind, sign, default, _ = CHANGES[choice]
    fault = _fault(choice, 0.0, 1.0)
    assert fault is not None
    assert (fault.kind, fault.size) == (kind, sign * default)


@pytest.mark.parametrize(
    ("choice", "value", "said"),
    [
        ("friction of the steps (× value)", 2.1, "value is 2.1; a factor on the friction must be from 0.1 to 2"),
        ("friction, right belt (× value)", -0.5, "value is -0.5; a factor on the friction must be from 0.1 to 2"),
        ("passenger's weight up (value in metres)", 0.4, "value is 0.4; for payload_up it must be from -0.3 to 0.3"),
        ("payload_left", -0.5, "value is -0.5; for payload_left it must be from -0.3 to 0.3"),
    ],
)
def test_a_value_out_of_range_is_refused_with_its_range(choice: str, value: float, said: str) -> None:
    with pytest.raises(ValueError, match="value is") as caught:
        _fault(choice, value, 1.0)
    assert said in _last_line(caught.value)


def test_friction_may_double_on_one_side() -> None:
    fault = _fault("friction, right belt (× value)", 2.0, 1.0)
    assert fault is not None
    assert (fault.kind, fault.size) == ("track_slip", -2.0)
