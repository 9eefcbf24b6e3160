"""The node: one subscription, three publishers; what it says is made in `everplace_ros.answers`."""

from __future__ import annotations

import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String

from everplace.errors import EverplaceError
from everplace_ros.answers import ImageAnswerer, MessageTypes

TYPES = MessageTypes(Header, String, PoseStamped, Pose, Point, Quaternion, DiagnosticArray, DiagnosticStatus, KeyValue)


class LocalizeNode(Node):
    """Answers each image; while it computes, only the newest image waits."""

    def __init__(self) -> None:
        """Opens the map that the parameter `map` names."""
        super().__init__("everplace")
        map_ = self.declare_parameter("map", "").value
        sequence = self.declare_parameter("sequence", 10).value
        precision = self.declare_parameter("precision", 0.99).value
        frame_id = self.declare_parameter("frame_id", "map").value
        self._answer = ImageAnswerer(map_, TYPES, sequence=sequence, precision=precision or None, frame_id=frame_id)
        self._place = self.create_publisher(String, "~/place", 10)
        self._pose = self.create_publisher(PoseStamped, "~/pose", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        newest = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(Image, "image", self.answer, newest)

    def answer(self, message: Image) -> None:
        """Publishes what an image tells."""
        answered = self._answer(message)
        if answered.place is not None:
            self._place.publish(answered.place)
        if answered.pose is not None:
            self._pose.publish(answered.pose)
        self._diagnostics.publish(answered.diagnostics)


def main() -> None:
    """Runs the node until ROS ends."""
    rclpy.init()
    try:
        rclpy.spin(LocalizeNode())
    except EverplaceError as error:
        sys.exit(f"everplace: {error}")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
