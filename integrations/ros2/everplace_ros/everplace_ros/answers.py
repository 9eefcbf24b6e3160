"""From an image message to answers as messages; knows the messages' fields, but not ROS itself."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import EverplaceError
from everplace.importing.containers.ros_image import image_pixels
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import MapAnswer

__all__ = ["Answered", "ImageAnswerer", "MessageTypes", "pixels_of"]


@dataclass(frozen=True)
class MessageTypes:
    """The classes of the messages, as ROS 2 generates them for Python.

    Attributes:
        Header: std_msgs/Header.
        String: std_msgs/String.
        PoseStamped: geometry_msgs/PoseStamped.
        Pose: geometry_msgs/Pose.
        Point: geometry_msgs/Point.
        Quaternion: geometry_msgs/Quaternion.
        DiagnosticArray: diagnostic_msgs/DiagnosticArray.
        DiagnosticStatus: diagnostic_msgs/DiagnosticStatus.
        KeyValue: diagnostic_msgs/KeyValue.
    """

    Header: Any
    String: Any
    PoseStamped: Any
    Pose: Any
    Point: Any
    Quaternion: Any
    DiagnosticArray: Any
    DiagnosticStatus: Any
    KeyValue: Any


@dataclass(frozen=True)
class Answered:
    """What is to be published for one image.

    Attributes:
        place: std_msgs/String, a line of `everplace localize --json-lines`; None: the image cannot be read.
        pose: geometry_msgs/PoseStamped of the map's frame; None: not sure enough, or the map has no pose there.
        diagnostics: diagnostic_msgs/DiagnosticArray, with one status.
    """

    place: Any | None
    pose: Any | None
    diagnostics: Any


def pixels_of(message: Any) -> NDArray[np.uint8]:
    """The pixels of a sensor_msgs/Image.

    Args:
        message: With `encoding`, `height`, `width`, `step`, `is_bigendian` and `data`.

    Returns:
        H×W×C uint8, C = 1 (grey) or 3 (RGB).

    Raises:
        ValueError: The encoding is not known, or the fields contradict each other.
    """
    data = np.frombuffer(message.data, np.uint8)
    return image_pixels(
        message.encoding, message.height, message.width, message.step, data, big_endian=bool(message.is_bigendian)
    )


class ImageAnswerer:
    """Answers the images of one camera, in order."""

    def __init__(
        self,
        map_: str | os.PathLike[str],
        types: MessageTypes,
        *,
        sequence: int = 10,
        precision: float | None = 0.99,
        frame_id: str = "map",
    ) -> None:
        """Opens a map.

        Args:
            map_: Its directory.
            types: Classes of the messages to make.
            sequence: Frames that an answer rests on; 1: each image alone.
            precision: Share of the poses that shall be right; None: every pose is published.
            frame_id: Coordinate frame of the map's poses.

        Raises:
            everplace.errors.MapError: There is no map, or its answers never were so precise.
        """
        self._map, self._types, self._frame_id = os.fspath(map_), types, frame_id
        self._localizer = Localizer(map_, sequence=sequence)
        self._least = self._localizer.threshold(precision)

    def __call__(self, message: Any) -> Answered:
        """Answers a sensor_msgs/Image; never raises for what is wrong with the image."""
        stamp = message.header.stamp
        try:
            answer = self._localizer.locate(pixels_of(message), stamp.sec + stamp.nanosec * 1e-9)
        except (ValueError, EverplaceError) as error:
            return Answered(None, None, self._diagnostics(stamp, self._types.DiagnosticStatus.ERROR, str(error), {}))
        sure = answer.probability >= self._least
        line = {"frame": f"{stamp.sec}.{stamp.nanosec:09d}", **answer.to_dict(), "accepted": sure}
        return Answered(
            self._types.String(data=json.dumps(line)),
            self._pose(stamp, answer) if sure else None,
            self._told(stamp, answer, sure),
        )

    def _pose(self, stamp: Any, answer: MapAnswer) -> Any | None:
        types, pose = self._types, answer.pose
        if pose is None:
            return None
        half = pose.heading / 2
        return types.PoseStamped(
            header=types.Header(stamp=stamp, frame_id=self._frame_id),
            pose=types.Pose(
                position=types.Point(x=pose.x, y=pose.y, z=0.0),
                orientation=types.Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)),
            ),
        )

    def _told(self, stamp: Any, answer: MapAnswer, sure: bool) -> Any:
        status = self._types.DiagnosticStatus
        if sure:
            said = f"at place {answer.place}"
        elif answer.off_map > 0.5:
            said = "not on the map"
        else:
            said = "not sure of the place"
        said += "; a condition that the map has not seen" if answer.unseen_condition else ""
        said += "; provisional: the map knows one drive only" if answer.provisional else ""
        values = {
            "place": str(answer.place),
            "drive": answer.drive,
            "database_frame": answer.database_frame,
            "score": f"{answer.score:.4f}",
            "probability": f"{answer.probability:.4f}",
            "least_probability": f"{self._least:.4f}",
            "off_map": f"{answer.off_map:.4f}",
            **{f"condition {name}": f"{share:.4f}" for name, share in answer.condition.items()},
        }
        return self._diagnostics(stamp, status.OK if sure else status.WARN, said, values)

    def _diagnostics(self, stamp: Any, level: Any, said: str, values: dict[str, str]) -> Any:
        types = self._types
        status = types.DiagnosticStatus(
            level=level,
            name="everplace: localization",
            message=said,
            hardware_id=self._map,
            values=[types.KeyValue(key=key, value=value) for key, value in values.items()],
        )
        return types.DiagnosticArray(header=types.Header(stamp=stamp, frame_id=""), status=[status])
