#!/usr/bin/python3
"""The graph on a real roscore, as any ROS node sees it: rospy and standard messages, nothing of treadline."""

import os
import signal
import sys
import time
import unittest
from itertools import pairwise
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, Imu, JointState
from tf2_msgs.msg import TFMessage

PACKAGE = "treadline_ros1"
WALL_S = 100.0
HOLD_S = 0.8
CONTROL_S = 0.3


class Graph:
    """What came, by topic, with the graph's clock at its coming."""

    def __init__(self, **topics):
        self.t_s = 0.0
        self.came = {name: [] for name in topics}
        rospy.Subscriber("/clock", Clock, self._tick, queue_size=10)
        for name, (topic, kind) in topics.items():
            rospy.Subscriber(topic, kind, self._take, callback_args=name, queue_size=1000, buff_size=1 << 22)

    def until(self, done, what):
        end = time.monotonic() + WALL_S
        while not done():
            if time.monotonic() > end:
                raise AssertionError(f"{what}: not within {WALL_S} s; the clock shows {self.t_s} s")
            time.sleep(0.01)

    def _tick(self, message):
        self.t_s = message.clock.to_sec()

    def _take(self, message, name):
        self.came[name].append((self.t_s, message))


def braked(message):
    return message.position[message.name.index("brake")] == 1.0


class ClimbTest(unittest.TestCase):
    def test_climb(self):
        graph = Graph(
            truth=("/truth", JointState),
            commands=("/tracks/cmd", JointState),
            imu=("/imu", Imu),
            color=("/camera/color/image_raw", Image),
            depth=("/camera/depth/image_rect", Image),
            info=("/camera/color/camera_info", CameraInfo),
            heading=("/stair/heading", PoseWithCovarianceStamped),
            told=("/diagnostics", DiagnosticArray),
            odometry=("/odom", Odometry),
            moving=("/tf", TFMessage),
            fixed=("/tf_static", TFMessage),
        )
        graph.until(lambda: graph.t_s >= 8.0, "eight seconds of climbing")
        truth = [dict(zip(message.name, message.position, strict=False)) for _, message in graph.came["truth"]]
        assert abs(truth[0]["heading_rad"]) > 0.15
        assert abs(truth[-1]["heading_rad"]) < 0.06
        assert truth[-1]["x_m"] > truth[0]["x_m"] + 0.3
        held = [s.message for _, message in graph.came["told"] for s in message.status if s.name == "hold"]
        assert held == []
        assert not any(braked(message) for t_s, message in graph.came["commands"] if t_s > 1.0)
        self._check_messages(graph)

    def _check_messages(self, graph):
        _, place = graph.came["odometry"][-1]
        assert (place.header.frame_id, place.child_frame_id) == ("odom", "base_link")
        assert place.pose.pose.position.z > 0.15
        frames = {t.child_frame_id: t.header.frame_id for name in ("moving", "fixed") for t in graph.came[name][-1][1].transforms}
        assert frames == {"base_link": "odom", "chair": "base_link", "imu": "base_link", "camera": "base_link"}
        _, image = graph.came["color"][-1]
        assert (image.encoding, image.header.frame_id, len(image.data)) == ("rgb8", "camera", image.height * image.step)
        _, depth = graph.came["depth"][-1]
        assert (depth.encoding, len(depth.data)) == ("32FC1", 4 * depth.width * depth.height)
        _, info = graph.came["info"][-1]
        assert (info.width, info.height) == (image.width, image.height)
        stamps = [message.header.stamp.to_nsec() for _, message in graph.came["imu"]]
        gaps = {later - sooner for sooner, later in pairwise(stamps)}
        assert gaps == {10000000}  # 100 Hz of the sensor's own stamps, and none was lost
        frames = [message.header.stamp.to_nsec() for _, message in graph.came["color"]]
        gaps = {later - sooner for sooner, later in pairwise(frames)}
        assert min(gaps) == 100000000  # 10 Hz
        assert all(gap % 100000000 == 0 for gap in gaps)  # the camera drops one frame of a hundred
        names = {s.name for _, message in graph.came["told"] for s in message.status if s.hardware_id == "node"}
        assert names == {"plant", "camera", "heading", "seat", "driver", "guard"}


class PaperNamesTest(unittest.TestCase):
    def test_paper_names(self):
        graph = Graph(image=("/camera", Image), heading=("/heading", PoseWithCovarianceStamped), imu=("/imu", Imu))
        graph.until(lambda: all(len(came) > 5 for came in graph.came.values()), "images, headings and IMU")
        state = rosgraph.Master("/test").getSystemState()
        takers = dict(state[1])
        assert "/depth" in takers["/camera"]


class KillTest(unittest.TestCase):
    def test_kill(self):
        victim = sys.argv[2] if len(sys.argv) > 2 else "controller"
        graph = Graph(truth=("/truth", JointState), commands=("/tracks/cmd", JointState), guard=("/guard/state", DiagnosticArray))
        graph.until(lambda: graph.t_s >= 2.0, "two seconds of climbing")
        causes = [s.message for _, m in graph.came["guard"] for s in m.status if s.level == 2]
        assert not braked(graph.came["commands"][-1][1]), causes
        master = rosgraph.Master("/test")
        _, _, pid = ServerProxy(master.lookupNode(f"/{victim}")).getPid("/test")
        os.kill(pid, signal.SIGKILL)
        killed_s, wall_s = graph.t_s, time.monotonic()
        if victim == "guard":
            # The last watchdog lives at the actuator: belts stand without any command.
            graph.until(lambda: graph.t_s > killed_s + HOLD_S + 0.1, "time after the guard")
            _, last = graph.came["truth"][-1]
            speeds = dict(zip(last.name, last.position, strict=False))
            assert (speeds["left_m_s"], speeds["right_m_s"]) == (0.0, 0.0)
            return
        graph.until(lambda: braked(graph.came["commands"][-1][1]), "a HOLD")
        came_s, command = graph.came["commands"][-1]
        if victim == "plant":  # and with it the clock
            assert time.monotonic() - wall_s < HOLD_S + CONTROL_S
        else:
            assert came_s - killed_s < HOLD_S
        assert tuple(command.velocity) == (0.0, 0.0, 0.0)
        graph.until(lambda: any(s.level == 2 for _, m in graph.came["guard"] for s in m.status), "the cause")


if __name__ == "__main__":
    rospy.init_node("graph_test", disable_rostime=True)
    kind = {"climb": ClimbTest, "paper_names": PaperNamesTest, "kill": KillTest}[sys.argv[1]]
    rostest.rosrun(PACKAGE, "_".join(part for part in sys.argv[1:] if ":=" not in part and not part.startswith("--")), kind)
