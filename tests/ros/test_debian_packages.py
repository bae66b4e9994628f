"""Debian's packages for ROS 1 stand in three places: what a node needs, what the page has installed, what the tests install."""

import re
from pathlib import Path

from treadline.ros import channels as on
from treadline.ros.ros1 import INSTALL

ROOT = Path(__file__).parents[2]
WITH_ROSPY = {"std_msgs", "rosgraph_msgs"}
"""Messages that rospy itself depends on."""


def packages(text: str) -> set[str]:
    return set(re.findall(r"ros-core|python3-[a-z0-9-]+", text))


def test_each_list_of_debian_packages_holds_the_shorter_one() -> None:
    """Test: the list of an error's remedy, of docs/ros.md and of the Makefile. Expected result: who installs the second can run a
    node, who installs the third can run all that the page shows."""
    page = next(line for line in (ROOT / "docs" / "ros.md").read_text().splitlines() if line.startswith("apt-get install"))
    tests = re.search(r"^ROS1 := ((?:.*\\\n)*.*)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert packages(INSTALL) <= packages(page) <= packages(tests[1])


def test_the_messages_of_every_channel_are_installed() -> None:
    kinds = {
        topic.kind_of(ros1=True).split("/")[0] for channel in on.CHANNELS.values() for topic in channel.topics_of(ros1=True)
    } - WITH_ROSPY
    assert {f"python3-{kind.replace('_', '-')}" for kind in kinds} <= packages(INSTALL)
