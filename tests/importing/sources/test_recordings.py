"""The rendered route, written as video and as bags and imported again, is the same route."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.images.decoding import ImageSpec, decode_image
from everplace.importing.import_route import import_route
from everplace.render.render_config import RenderConfig
from everplace.render.rendered_route import render_route
from everplace.route.route import Route, open_route
from everplace.route.traverse import Traverse

SEASONS = ("spring", "summer", "autumn", "winter")
RATE = 10
START = 1_700_000_000_123_456_789  # nanoseconds; a bag's times are those of its day

av = pytest.importorskip("av", reason="needs the extra video")
pytest.importorskip("rosbags", reason="needs the extra ros")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Route:
    out = tmp_path_factory.mktemp("rendered") / "route"
    render_route(out, RenderConfig(places=5, size=(32, 48), conditions=SEASONS, seed=4))
    return open_route(out)


def pixels_of(traverse: Traverse) -> Iterator[NDArray[np.uint8]]:
    return (decode_image(path, ImageSpec()) for path in traverse.paths)


def write_video(traverse: Traverse, path: Path, codec: str, form: str, options: dict[str, str]) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=RATE, options=options)
        stream.height, stream.width, stream.pix_fmt = 32, 48, form
        for pixels in pixels_of(traverse):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        container.mux(stream.encode())


def write_bag(traverse: Traverse, path: Path, form: str) -> None:
    """Writes raw images and odometry, both with the same stamps."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    ros1 = form == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if form == "mcap" else StoragePlugin.SQLITE3
    t: dict[str, Any] = dict(store.types)
    assert traverse.poses is not None
    with Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin) as writer:
        image = writer.add_connection("/camera/image_raw", "sensor_msgs/msg/Image", typestore=store)
        odometry = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        for number, (pixels, (x, y, heading)) in enumerate(zip(pixels_of(traverse), traverse.poses, strict=True)):
            nanoseconds = START + number * 1_000_000_000 // RATE
            stamp = t["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 1_000_000_000))
            header = t["std_msgs/msg/Header"](*([number] if ros1 else []), stamp=stamp, frame_id="camera")
            bgr = np.ascontiguousarray(pixels[:, :, ::-1])
            shape = (*bgr.shape[:2], "bgr8", 0, 3 * bgr.shape[1])
            point = t["geometry_msgs/msg/Point"](x, y, 0.5)
            q = t["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
            pose = t["geometry_msgs/msg/PoseWithCovariance"](t["geometry_msgs/msg/Pose"](point, q), np.zeros(36))
            zero = t["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            twist = t["geometry_msgs/msg/TwistWithCovariance"](t["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36))
            for connection, message in (
                (odometry, t["nav_msgs/msg/Odometry"](header, "base", pose, twist)),
                (image, t["sensor_msgs/msg/Image"](header, *shape, bgr.reshape(-1))),
            ):
                serialise = store.serialize_ros1 if ros1 else store.serialize_cdr
                writer.write(connection, nanoseconds + 5_000_000, serialise(message, message.__msgtype__))


def assert_same(imported: Route, rendered: Route, *, digits: int) -> None:
    assert [traverse.name for traverse in imported.traverses] == [traverse.name for traverse in rendered.traverses]
    for got, wanted in zip(imported.traverses, rendered.traverses, strict=True):
        assert [int(stem) for stem in got.stems] == [int(stem) for stem in wanted.stems]
        assert {len(stem) for stem in got.stems} == {digits}
        assert got.condition == wanted.condition
        for a, b in zip(pixels_of(got), pixels_of(wanted), strict=True):
            np.testing.assert_array_equal(a, b)
        assert got.poses is not None
        assert wanted.poses is not None
        np.testing.assert_allclose(got.poses, wanted.poses, rtol=0, atol=1e-9)
    assert len(imported.shared_stems()) == len(rendered.traverses[0])


@pytest.mark.parametrize(
    ("ending", "codec", "form", "options"),
    [
        (".mkv", "ffv1", "bgr0", {"level": "3", "slicecrc": "1"}),
        (".mp4", "libx264rgb", "rgb24", {"qp": "0"}),
        (".avi", "ffv1", "bgr0", {}),
    ],
)
def test_lossless_videos_with_the_poses_of_the_route_beside_them(
    tmp_path: Path, rendered: Route, ending: str, codec: str, form: str, options: dict[str, str]
) -> None:
    videos = tmp_path / "videos"
    videos.mkdir()
    for traverse in rendered.traverses:
        write_video(traverse, videos / (traverse.name + ending), codec, form, options)
        shutil.copy(traverse.root / "poses.csv", videos / f"{traverse.name}.poses.csv")
    summary = import_route("video", videos, tmp_path / "out")
    assert summary.frames == 20
    assert summary.notes == ()
    imported = open_route(tmp_path / "out")
    assert_same(imported, rendered, digits=5)  # the stems of the pose file
    assert (imported.traverses[0].root / "times.csv").read_text().splitlines()[1:3] == ["00000,0.0", "00001,0.1"]


def test_video_with_poses_by_time(tmp_path: Path, rendered: Route) -> None:
    winter = rendered["winter"]
    assert winter.poses is not None
    write_video(winter, tmp_path / "winter.mkv", "ffv1", "bgr0", {})
    rows = [f"{number / RATE},{x!r},{y!r},{heading!r}" for number, (x, y, heading) in enumerate(winter.poses.tolist())]
    (tmp_path / "winter.poses.csv").write_text("\n".join(["seconds,x,y,heading", *rows, ""]))
    import_route("video", tmp_path / "winter.mkv", tmp_path / "out")
    assert_same(open_route(tmp_path / "out"), rendered.choose(["winter"]), digits=6)


@pytest.mark.parametrize("form", ["bag", "db3", "mcap", "mcap-file"])
def test_bags_with_odometry(tmp_path: Path, rendered: Route, form: str) -> None:
    bags = tmp_path / "bags"
    bags.mkdir()
    for traverse in rendered.traverses:
        path = bags / (traverse.name + (".bag" if form == "bag" else ""))
        write_bag(traverse, path, form.partition("-")[0])
        if form == "mcap-file":
            (bags / traverse.name / f"{traverse.name}.mcap").rename(bags / f"{traverse.name}.mcap")
            shutil.rmtree(bags / traverse.name)
    summary = import_route("bag", bags, tmp_path / "out")
    assert summary.frames == 20
    assert len(summary.notes) == 1
    assert "numbered from 000000" in summary.notes[0]
    imported = open_route(tmp_path / "out")
    assert_same(imported, rendered, digits=6)
    lines = (imported.traverses[0].root / "times.csv").read_text().splitlines()
    seconds = [float(line.partition(",")[2]) for line in lines[1:]]
    np.testing.assert_allclose(seconds, [(START + i * 10**9 // RATE) / 1e9 for i in range(5)], rtol=0, atol=1e-6)
