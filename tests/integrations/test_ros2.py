"""The ROS 2 package without ROS: messages are those of rosbags, which knows the fields of ROS 2 Humble and Jazzy."""

from __future__ import annotations

import ast
import json
import math
import py_compile
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from tests.mapping.drives import images_of

from everplace.errors import MapError

typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra ros")

PACKAGE = Path(__file__).parents[2] / "integrations" / "ros2" / "everplace_ros"
TYPES = {
    "Header": "std_msgs", "String": "std_msgs", "PoseStamped": "geometry_msgs", "Pose": "geometry_msgs",
    "Point": "geometry_msgs", "Quaternion": "geometry_msgs", "DiagnosticArray": "diagnostic_msgs",
    "DiagnosticStatus": "diagnostic_msgs", "KeyValue": "diagnostic_msgs",
}  # fmt: skip


@pytest.fixture(autouse=True)
def _package_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(PACKAGE))


@pytest.fixture(params=["ROS2_HUMBLE", "ROS2_JAZZY"])
def store(request: pytest.FixtureRequest) -> Any:
    return typesys.get_typestore(getattr(typesys.Stores, request.param))


def message_types(store: Any) -> Any:
    from everplace_ros.answers import MessageTypes

    return MessageTypes(**{name: store.types[f"{package}/msg/{name}"] for name, package in TYPES.items()})


def image(store: Any, pixels: np.ndarray, encoding: str, *, padding: int = 0, big: bool = False, sec: int = 5) -> Any:
    """A sensor_msgs/Image of an array of the encoding's own channels and byte order."""
    rows = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8).reshape(len(pixels), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    header = store.types["std_msgs/msg/Header"](
        stamp=store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=250_000_000), frame_id="camera"
    )
    made = store.types["sensor_msgs/msg/Image"](
        header=header, height=len(pixels), width=pixels.shape[1], encoding=encoding, is_bigendian=int(big),
        step=rows.shape[1], data=rows.reshape(-1),
    )  # fmt: skip
    return sent(store, made)


def sent(store: Any, message: Any) -> Any:
    """The message as it arrives, which fails where a field is missing, too many, or of another type."""
    return store.deserialize_cdr(store.serialize_cdr(message, message.__msgtype__), message.__msgtype__)


RGB = np.random.default_rng(1).integers(0, 256, (6, 8, 3), np.uint8)
GREY = RGB[:, :, :1]


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "stored", "big", "expected"),
    [
        ("rgb8", RGB, False, RGB),
        ("bgr8", RGB[:, :, ::-1], False, RGB),
        ("bgra8", np.dstack([RGB[:, :, ::-1], GREY]), False, RGB),
        ("rgba8", np.dstack([RGB, GREY]), False, RGB),
        ("mono8", GREY, False, GREY),
        ("mono16", (GREY.astype(np.uint16) * 256 + 9).astype("<u2"), False, GREY),
        ("mono16", (GREY.astype(np.uint16) * 256 + 9).astype(">u2"), True, GREY),
        ("bayer_rggb8", np.full((6, 8, 1), 90, np.uint8), False, np.full((6, 8, 3), 90)),
    ],
)
def test_images_are_decoded(
    store: Any, encoding: str, stored: np.ndarray, big: bool, expected: np.ndarray, padding: int
) -> None:
    from everplace_ros.answers import pixels_of

    np.testing.assert_array_equal(pixels_of(image(store, stored, encoding, padding=padding, big=big)), expected)


def test_data_comes_as_an_array_of_bytes_too(store: Any) -> None:
    """As rclpy hands it over."""
    import array

    from everplace_ros.answers import pixels_of

    message = image(store, RGB, "rgb8")
    for data in (array.array("B", message.data.tobytes()), message.data.tobytes()):
        object.__setattr__(message, "data", data)
        np.testing.assert_array_equal(pixels_of(message), RGB)


def test_answers_are_messages_with_the_place_and_the_pose(
    store: Any, unchanged_three_map: Path, unchanged_rendered_route: Path
) -> None:
    from everplace_ros.answers import ImageAnswerer

    types = message_types(store)
    answerer = ImageAnswerer(unchanged_three_map, types, precision=0.9, frame_id="world")
    posed = 0
    for number, pixels in enumerate(images_of(unchanged_rendered_route / "winter")[:20]):
        answered = answerer(image(store, pixels[:, :, ::-1], "bgr8", sec=number))
        place, diagnostics = sent(store, answered.place), sent(store, answered.diagnostics)
        line = json.loads(place.data)
        assert line["frame"] == f"{number}.250000000"
        assert line["time"] == number + 0.25
        (status,) = diagnostics.status
        values = {one.key: one.value for one in status.values}
        assert values["place"] == str(line["place"])
        assert float(values["probability"]) == pytest.approx(line["probability"], abs=1e-4)
        assert set(values) >= {"off_map", "condition summer", "condition winter", "least_probability"}
        assert diagnostics.header.stamp.sec == number
        assert (answered.pose is not None) == line["accepted"] == (status.level == types.DiagnosticStatus.OK)
        if answered.pose is not None:
            posed += 1
            pose = sent(store, answered.pose)
            assert (pose.header.frame_id, pose.header.stamp.sec) == ("world", number)
            where, turned = pose.pose.position, pose.pose.orientation
            assert [where.x, where.y, 2 * math.atan2(turned.z, turned.w)] == pytest.approx(line["pose"])
            assert status.message.startswith(f"at place {line['place']}")
    assert posed >= 10


def test_what_is_not_sure_has_no_pose(store: Any, unchanged_summer_map: Path) -> None:
    from everplace_ros.answers import ImageAnswerer

    noise = np.random.default_rng(1).integers(0, 256, (64, 128, 3), np.uint8)
    answered = ImageAnswerer(unchanged_summer_map, message_types(store), sequence=1)(image(store, noise, "rgb8"))
    (status,) = sent(store, answered.diagnostics).status
    assert answered.pose is None
    assert answered.place is not None
    assert json.loads(answered.place.data)["accepted"] is False
    assert status.level == message_types(store).DiagnosticStatus.WARN
    assert status.message.startswith("not on the map; a condition that the map has not seen; provisional")


@pytest.mark.parametrize("encoding", ["32FC1", "rgb8"])
def test_an_image_that_cannot_be_read_is_said_and_nothing_breaks(
    store: Any, unchanged_summer_map: Path, encoding: str
) -> None:
    from everplace_ros.answers import ImageAnswerer

    answered = ImageAnswerer(unchanged_summer_map, message_types(store))(image(store, GREY, encoding))
    assert answered.place is None
    assert answered.pose is None
    (status,) = sent(store, answered.diagnostics).status
    assert status.level == message_types(store).DiagnosticStatus.ERROR
    assert f"encoding '{encoding}'" in status.message


def test_no_map_is_told(store: Any, tmp_path: Path) -> None:
    from everplace_ros.answers import ImageAnswerer

    with pytest.raises(MapError, match="there is no map at"):
        ImageAnswerer(tmp_path / "none", message_types(store))


def test_the_node_publishes_what_is_answered(
    store: Any, unchanged_summer_map: Path, unchanged_rendered_route: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real messages, and the few calls of rclpy that the node makes, as rclpy documents them."""
    published: list[tuple[str, Any]] = []
    subscribed: dict[str, Any] = {}

    class Node:
        def __init__(self, name: str) -> None:
            assert name == "everplace"

        def declare_parameter(self, name: str, default: Any) -> Any:
            given = {"map": str(unchanged_summer_map), "precision": 0.0}
            return type("Parameter", (), {"value": given.get(name, default)})

        def create_publisher(self, _kind: Any, topic: str, _depth: int) -> Any:
            return type("Publisher", (), {"publish": staticmethod(lambda message: published.append((topic, message)))})

        def create_subscription(self, _kind: Any, topic: str, callback: Any, _profile: Any) -> None:
            subscribed[topic] = callback

    def module(name: str, **members: Any) -> None:
        made = ModuleType(name)
        made.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, made)

    anything = type("Anything", (), {"__init__": lambda self, **_: None, "KEEP_LAST": 1, "BEST_EFFORT": 2})
    module("rclpy")
    module("rclpy.executors", ExternalShutdownException=type("ExternalShutdownException", (Exception,), {}))
    module("rclpy.node", Node=Node)
    module("rclpy.qos", HistoryPolicy=anything, QoSProfile=anything, ReliabilityPolicy=anything)
    for package in ("std_msgs", "geometry_msgs", "diagnostic_msgs", "sensor_msgs"):
        names = [name for name, of in {**TYPES, "Image": "sensor_msgs"}.items() if of == package]
        module(package)
        module(f"{package}.msg", **{name: store.types[f"{package}/msg/{name}"] for name in names})
    monkeypatch.delitem(sys.modules, "everplace_ros.localize_node", raising=False)
    from everplace_ros.localize_node import LocalizeNode

    LocalizeNode()
    subscribed["image"](image(store, images_of(unchanged_rendered_route / "summer")[9], "rgb8"))
    assert [topic for topic, _ in published] == ["~/place", "~/pose", "/diagnostics"]
    for _, message in published:
        sent(store, message)


def test_the_package_is_one(tmp_path: Path) -> None:
    """Names agree, what setup.py installs is there, and every import of a ROS package is declared."""
    manifest = ET.parse(PACKAGE / "package.xml").getroot()
    assert manifest.findtext("name") == PACKAGE.name
    declared = {one.text or "" for one in manifest.findall("exec_depend")}
    sources = [*PACKAGE.glob("everplace_ros/*.py"), *PACKAGE.glob("launch/*.py")]
    imported = set()
    for source in sources:
        py_compile.compile(str(source), cfile=str(tmp_path / "compiled"), doraise=True)
        for node in ast.walk(ast.parse(source.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
    ours = {"everplace", "everplace_ros", "numpy", "__future__"} | set(sys.stdlib_module_names)
    assert imported - ours <= declared <= imported | {"rclpy"}
    setup = (PACKAGE / "setup.py").read_text("utf-8")
    assert f'version="{manifest.findtext("version")}"' in setup
    for name in ("package.xml", "launch/localize.launch.py"):
        assert name in setup
        assert (PACKAGE / name).is_file()
    assert (PACKAGE / "resource" / PACKAGE.name).is_file()
