"""A base of somebody else on real ROS 2, driven through ``cmd_vel`` and odometry by the link of a robot file."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry

from treadline.core.errors import LinkError
from treadline.hardware._base_link import BaseLink
from treadline.hardware.ports import DriveLimits

LIMITS = DriveLimits(speed_m_s=0.3, acceleration_m_s2=4.0, watchdog_s=0.1)
TIMEOUT_S, GAUGE_M = 0.3, 0.6


class Base:
    """A base that follows cmd_vel at once, stops by a time-out of its own, and reports at 50 Hz."""

    def __init__(self, bystander: Any, kind: Any) -> None:
        self._bystander, self._heard_s, self.asked = bystander, 0.0, Twist()
        bystander.node.create_subscription(kind, "cmd_vel", self._obey, 1)
        self._odometry = bystander.node.create_publisher(Odometry, "odom", 10)
        bystander.node.create_timer(0.02, self._report)

    def _obey(self, message: Any) -> None:
        self.asked, self._heard_s = getattr(message, "twist", message), time.monotonic()

    def _report(self) -> None:
        message = Odometry(child_frame_id="base_link")
        if time.monotonic() - self._heard_s < TIMEOUT_S:
            message.twist.twist = self.asked
        self._odometry.publish(message)


@pytest.fixture(params=["twist_stamped", "twist"])
def driven(request: pytest.FixtureRequest, watching: Callable[..., Any]) -> Iterator[Any]:
    bystander = watching()
    base = Base(bystander, TwistStamped if request.param == "twist_stamped" else Twist)
    link = BaseLink(limits=LIMITS, gauge_m=GAUGE_M, kind=request.param)
    yield base, link, bystander
    link.close()


def run(link: BaseLink, bystander: Any, lasts_s: float, belts: tuple[float, float] = (0.0, 0.0)) -> Any:
    """Drive as the guard process does; return the newest state."""
    end_s, newest = time.monotonic() + lasts_s, None
    while time.monotonic() < end_s:
        bystander._executor.spin_once(timeout_sec=0.005)
        states = link.poll()
        newest = states[-1] if states else newest
        link.send(*belts)
    return newest


def test_a_base_is_measured_and_follows(driven: Any) -> None:
    """Test: the measurement, then belts of 0.1 and 0.2 m/s. Expected result: the time-out, and the velocity of these belts."""
    base, link, bystander = driven
    run(link, bystander, 1.0)
    link.rearm()
    state = run(link, bystander, 4.0)
    assert not state.latched, link.probe
    assert link.probe.silent_s == pytest.approx(TIMEOUT_S, abs=0.15)
    state = run(link, bystander, 1.0, (0.1, 0.2))
    assert (state.left_m_s, state.right_m_s) == pytest.approx((0.1, 0.2), abs=1e-3)
    assert (base.asked.linear.x, base.asked.angular.z) == pytest.approx((0.15, 0.1 / GAUGE_M), abs=1e-3)


def test_two_bases_are_refused(driven: Any, watching: Callable[..., Any]) -> None:
    _, link, bystander = driven
    other = watching("/other")
    other.node.create_publisher(Odometry, "/odom", 10)
    with pytest.raises(LinkError, match=r"^two bases publish odometry \(/bystander and /other/bystander\); stop one"):
        run(link, bystander, 5.0)
