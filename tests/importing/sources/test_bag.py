from __future__ import annotations

import builtins
import io
import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tests.fuzzing import DAMAGE, Damage, fuzzed

from everplace.errors import ConfigError, EverplaceError, MissingExtraError, RouteError
from everplace.importing.containers.ros_bag import open_bag
from everplace.importing.import_route import import_route
from everplace.importing.sources.bag import Options, read
from everplace.route.route import open_route

pytest.importorskip("rosbags", reason="needs the extra ros")

RGB = np.random.default_rng(8).integers(0, 256, (4, 6, 3), dtype=np.uint8)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
FIX, POSE = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/PoseStamped"

Row = tuple[str, str, float, Any]
"""Topic, type, stamp in seconds, and what the message holds."""


def write_bag(path: Path, rows: Iterable[Row]) -> Path:
    """Writes a ROS 1 bag if the path ends so, else a ROS 2 bag: mcap if its name says so, or SQLite."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if "mcap" in path.name else StoragePlugin.SQLITE3
    connections: dict[str, Any] = {}
    writer: Any = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        for number, (topic, message_type, seconds, value) in enumerate(rows):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message_type, typestore=store)
            message = make_message(dict(store.types), ros1, message_type, seconds, value)
            serialise = store.serialize_ros1 if ros1 else store.serialize_cdr
            writer.write(connections[topic], 10**9 * (number + 1), serialise(message, message_type))
    return path


def make_message(t: dict[str, Any], ros1: bool, message_type: str, seconds: float, value: Any) -> Any:
    stamp = t["builtin_interfaces/msg/Time"](int(seconds), round(seconds % 1 * 1e9))
    header = t["std_msgs/msg/Header"](*([0] if ros1 else []), stamp=stamp, frame_id="")
    if message_type == IMAGE:
        encoding, pixels = value
        data = np.frombuffer(pixels.tobytes(), dtype=np.uint8)
        return t[IMAGE](header, *pixels.shape[:2], encoding, 0, len(data) // len(pixels), data)
    if message_type == COMPRESSED:
        name, data = value
        return t[COMPRESSED](header, name, np.frombuffer(data, dtype=np.uint8))
    if message_type == FIX:
        status, latitude, longitude = value
        known = t["sensor_msgs/msg/NavSatStatus"](status, 1)
        return t[FIX](header, known, latitude, longitude, 0.0, np.zeros(9), 0)
    x, y, quaternion = value
    point = t["geometry_msgs/msg/Point"](x, y, 0.0)
    pose = t["geometry_msgs/msg/Pose"](point, t["geometry_msgs/msg/Quaternion"](*quaternion))
    return t[POSE](header, pose)


def encoded(form: str) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(RGB).save(buffer, form)
    return buffer.getvalue()


def image(seconds: float, topic: str = "/camera") -> Row:
    return (topic, IMAGE, seconds, ("rgb8", RGB))


@pytest.mark.parametrize("name", ["drive.bag", "drive", "drive-mcap"])
def test_compressed_images_stay_as_they_are(tmp_path: Path, name: str) -> None:
    contents = [("jpeg", encoded("JPEG")), ("rgb8; png compressed bgr8", encoded("PNG"))]
    rows = [("/cam/compressed", COMPRESSED, 5.0 + number, content) for number, content in enumerate(contents)]
    summary = import_route("bag", write_bag(tmp_path / name, rows), tmp_path / "out")
    assert [note for note in summary.notes if "holds no topic of positions or poses" in note]
    (traverse,) = open_route(tmp_path / "out").traverses
    assert traverse.name == Path(name).stem
    assert [path.name for path in traverse.paths] == ["000000.jpg", "000001.png"]
    assert [path.read_bytes() for path in traverse.paths] == [data for _, data in contents]
    assert (traverse.root / "times.csv").read_text().split() == ["stem,seconds", "000000,5.0", "000001,6.0"]


def test_one_image_topic_must_be_chosen(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", [image(1.0, "/left"), image(1.0, "/right"), image(2.0, "/right")])
    with pytest.raises(
        ConfigError,
        match=r"several image topics; choose one with `topic`: /left \(sensor_msgs/msg/Image\), /right \(",
    ):
        import_route("bag", path, tmp_path / "out")
    with pytest.raises(ConfigError, match=r"no image topic '/front'; choose one with `topic`: /left"):
        import_route("bag", path, tmp_path / "out", {"topic": "/front"})
    assert import_route("bag", path, tmp_path / "out", {"topic": "/right"}).frames == 2


def test_bags_that_are_passed_over_are_counted(tmp_path: Path) -> None:
    bags = tmp_path / "bags"
    bags.mkdir()
    write_bag(bags / "a.bag", [image(1.0), image(2.0)])
    for name in ("b.bag.active", "c.BAG.active", "d.mcap.zstd", "e.db3.zstd", "f.bag.orig.active", "notes.txt"):
        (bags / name).touch()
    notes = import_route("bag", bags, tmp_path / "out", {"poses": "none"}).notes
    told = "1 × .bag.orig.active, 1 × .db3.zstd, 1 × .mcap.zstd"
    assert notes == (
        f"{bags} holds bags that were not read: 2 × .bag.active, {told}; convert them, or give one by itself.",
    )


def test_positions_become_metres_from_a_common_origin(tmp_path: Path) -> None:
    """111.3 m a thousandth of a degree on the equator, to the east; 110.6 m to the north."""
    (tmp_path / "bags").mkdir()
    for name, shift in (("a.bag", 0.0), ("b.bag", 0.0001)):
        fixes = [("/fix", FIX, 10.0 + 2 * i, (0, 0.001 * i, 20 + 0.001 * i + shift)) for i in range(3)]
        lost = ("/fix", FIX, 11.0, (-1, float("nan"), 0.0))
        write_bag(tmp_path / "bags" / name, [fixes[0], lost, *fixes[1:], *(image(10.0 + i) for i in range(5))])
    summary = import_route("bag", tmp_path / "bags", tmp_path / "out", {"pose_limit": "1"})
    assert "latitude 0.0000000, longitude 20.0000000" in summary.notes[0]
    a, b = open_route(tmp_path / "out").traverses
    assert a.poses is not None
    assert b.poses is not None
    np.testing.assert_allclose(a.poses[:, 0], 55.66 * np.arange(5), atol=0.05)
    np.testing.assert_allclose(a.poses[:, 1], 55.29 * np.arange(5), atol=0.05)
    np.testing.assert_allclose(a.poses[:, 2], np.arctan2(110.57, 111.32), atol=1e-3)
    np.testing.assert_allclose(b.poses[:, :2] - a.poses[:, :2], [[11.132, 0]] * 5, atol=1e-3)
    options = {"pose_limit": "1", "origin": "0,20.0001"}
    import_route("bag", tmp_path / "bags" / "b.bag", tmp_path / "shifted", options)
    (shifted,) = open_route(tmp_path / "shifted").traverses
    assert shifted.poses is not None
    np.testing.assert_allclose(shifted.poses, a.poses, atol=1e-6)


def test_poses_of_the_camera_itself(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    # The camera's z looks along the world's x, its x to the right (-y), its y down.
    ahead = (0.5, -0.5, 0.5, -0.5)
    rows = [(("/pose"), POSE, 1.0, (3.0, 4.0, ahead)), image(1.0), ("/gps", FIX, 1.0, (0, 1.0, 1.0))]
    path = write_bag(tmp_path / "drive", rows)
    with pytest.raises(ConfigError, match=r"several pose topics; choose one with `poses`: /gps .*, /pose "):
        import_route("bag", path, tmp_path / "out")
    import_route("bag", path, tmp_path / "z", {"poses": "/pose", "ahead": "z"})
    (traverse,) = open_route(tmp_path / "z").traverses
    assert traverse.poses is not None
    np.testing.assert_allclose(traverse.poses, [[3, 4, 0]], atol=1e-12)
    import_route("bag", path, tmp_path / "none", {"poses": "none"})
    assert open_route(tmp_path / "none").traverses[0].poses is None
    flat = write_bag(tmp_path / "flat", [("/pose", POSE, 1.0, (0.0, 0.0, (half, 0.0, 0.0, 0.0))), image(1.0)])
    with pytest.raises(RouteError, match=r"message 0 of /pose in .*flat has .* a quaternion whose length is not 1"):
        import_route("bag", flat, tmp_path / "flat-out")


def test_times_of_recording_where_stamps_are_empty(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", [image(0.0), image(0.0), image(0.0)])
    with pytest.raises(RouteError, match=r"message 0 of /camera .* has no time stamp; .* `clock=recorded`"):
        import_route("bag", path, tmp_path / "out")
    import_route("bag", path, tmp_path / "out", {"clock": "recorded", "every_seconds": "2"})
    (traverse,) = open_route(tmp_path / "out").traverses
    assert (traverse.root / "times.csv").read_text().split()[1:] == ["000000,1.0", "000001,3.0"]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (("/camera", IMAGE, 1.0, ("32FC1", RGB)), "message 0 of /camera in .* the encoding '32FC1' is none of mono8"),
        (
            ("/depth", COMPRESSED, 1.0, ("16UC1; compressedDepth", b"\0" * 12 + encoded("PNG"))),
            "is no JPEG, PNG, WebP, TIFF or BMP image .its format is '16UC1; compressedDepth'",
        ),
        (("/pose", POSE, 1.0, (0.0, 0.0, (0.0, 0.0, 0.0, 1.0))), "holds no image topic with messages"),
    ],
)
def test_messages_that_are_no_images(tmp_path: Path, row: Row, message: str) -> None:
    path = write_bag(tmp_path / "drive.bag", [row])
    with pytest.raises(RouteError, match=message):
        import_route("bag", path, tmp_path / "out")


def test_what_is_no_bag(tmp_path: Path) -> None:
    for name in ("empty.bag", "empty.mcap", "empty.db3", "text.txt"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(
            RouteError, match=rf"{name} is damaged or is no bag that can be read \(.+\); reindex"
        ) as caught:
            import_route("bag", tmp_path / name, tmp_path / "out")
        assert "\n" not in str(caught.value)
    with pytest.raises(RouteError, match=r"cannot read .*none.bag: No such file"), open_bag(tmp_path / "none.bag"):
        pass
    (tmp_path / "none").mkdir()
    with pytest.raises(RouteError, match=r"holds no bag \(.bag, .db3, .mcap, or a directory with metadata.yaml\)"):
        import_route("bag", tmp_path / "none", tmp_path / "out")
    whole = write_bag(tmp_path / "whole.bag", [image(float(number)) for number in range(1, 9)])
    (tmp_path / "cut.bag").write_bytes(whole.read_bytes()[:-300])
    with pytest.raises(RouteError, match=r"cut.bag is damaged"):
        import_route("bag", tmp_path / "cut.bag", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_fewer_images_than_announced(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive", [image(1.0), image(2.0)])
    metadata = (path / "metadata.yaml").read_text()
    assert metadata.count("message_count: 2") == 3  # of the bag, of its only file, of its only topic
    (path / "metadata.yaml").write_text(metadata.replace("message_count: 2", "message_count: 3"))
    with pytest.raises(RouteError, match=r"drive announces 3 messages of /camera, but holds only 2; reindex"):
        import_route("bag", path, tmp_path / "out")


def record(op: int, content: bytes) -> bytes:
    return bytes([op]) + len(content).to_bytes(8, "little") + content


def text(value: str) -> bytes:
    return len(value).to_bytes(4, "little") + value.encode()


def write_plain_mcap(path: Path, schema: tuple[str, str], encoding: str, profile: str) -> None:
    """Writes an MCAP without index by its specification: magic, header, schema, channel, message, ends, magic."""
    magic = b"\x89MCAP0\r\n"
    two = (1).to_bytes(2, "little")
    path.write_bytes(
        magic
        + record(1, text(profile) + text("test"))
        + record(3, two + text(schema[0]) + text(schema[1]) + (0).to_bytes(4, "little"))
        + record(4, two + two + text("/camera") + text(encoding) + (0).to_bytes(4, "little"))
        + record(5, two + bytes(4) + (7).to_bytes(8, "little") * 2 + b"message")
        + record(15, bytes(4))
        + record(2, bytes(20))
        + magic
    )


@pytest.mark.parametrize(
    ("schema", "encoding", "message"),
    [
        (
            ("foxglove.CompressedImage", "protobuf"),
            "protobuf",
            "messages defined as 'protobuf', and only those of ROS 2",
        ),
        (("foxglove.CompressedImage", "protobuf"), "protobuf", "messages of another profile than ros2, and only"),
        ((IMAGE, "ros1msg"), "ros1", "messages defined as 'ros1msg', and only those of ROS 2"),
        ((IMAGE, "ros2msg"), "json", "holds sensor_msgs/msg/Image serialised as 'json', and only"),
        (("my_msgs/msg/Sonar", "ros2msg"), "cdr", "holds no image topic with messages"),
        ((IMAGE, "ros2msg"), "cdr", "is damaged or is no bag"),
    ],
)
def test_mcap_with_other_messages(tmp_path: Path, schema: tuple[str, str], encoding: str, message: str) -> None:
    profile = "" if "another profile" in message else "ros2"
    write_plain_mcap(tmp_path / "a.mcap", schema, encoding, profile)
    with pytest.raises(RouteError, match=message) as caught:
        import_route("bag", tmp_path / "a.mcap", tmp_path / "out")
    assert "a.mcap" in str(caught.value)


def test_a_definition_of_its_own_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", [image(1.0)])
    data = path.read_bytes()
    assert data.count(b"md5sum=060021388200f6f0f447d0fcd9c64743") == 2
    path.write_bytes(data.replace(b"md5sum=060021388200f6f0f447d0fcd9c64743", b"md5sum=" + b"0" * 32))
    with pytest.raises(RouteError, match=r"topic /camera of .* has a definition of sensor_msgs/msg/Image of its own"):
        import_route("bag", path, tmp_path / "out")


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original: Callable[..., Any] = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("rosbags"):
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(MissingExtraError, match=r"pip install 'everplace\[ros\]'"), open_bag(tmp_path / "a.bag"):
        pass


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    directory = tmp_path_factory.mktemp("originals")
    rows = [row for i in range(1, 4) for row in (image(i), ("/fix", FIX, float(i), (0, 48.0 + i / 1e4, 16.0)))]
    bag, mcap, sqlite = (write_bag(directory / name, rows) for name in ("a.bag", "mcap", "sqlite"))
    return {
        "fuzz.bag": bag.read_bytes(),
        "fuzz.mcap": (mcap / "mcap.mcap").read_bytes(),
        "fuzz.db3": (sqlite / "sqlite.db3").read_bytes(),
        "fuzz/metadata.yaml": (sqlite / "metadata.yaml").read_bytes(),
    }


@fuzzed(40)
@given(
    which=st.sampled_from(["fuzz.bag", "fuzz.mcap", "fuzz.db3", "fuzz/metadata.yaml"]),
    damage=DAMAGE,
)
def test_damaged_bytes_give_frames_or_one_error(
    tmp_path: Path, originals: dict[str, bytes], which: str, damage: Damage
) -> None:
    path = tmp_path / which
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(damage.of(originals[which]))
    if path.name == "metadata.yaml":
        (path.parent / "sqlite.db3").write_bytes(originals["fuzz.db3"])
        path = path.parent
    count = 0
    try:
        for traverse in read(path, Options()).traverses:
            for frame in traverse.frames:
                assert isinstance(frame.content, np.ndarray)
                count += 1
    except EverplaceError as error:
        assert "fuzz" in str(error)
        assert "\n" not in str(error)
    else:
        assert count <= 3
    shutil.rmtree(tmp_path / "fuzz", ignore_errors=True)


LOST = {"at 0, 0": (0, 0.0, 0.0), "status -1": (-1, 48.0, 11.0), "NaN": (0, float("nan"), float("nan"))}
"""What a receiver says that has no fix."""


def fixed_bag(path: Path, fixes: list[Any], *, rate: float = 1.0) -> Path:
    """A bag with an image and a fix at the same moments."""
    rows = [row for n, fix in enumerate(fixes) for row in (("/fix", FIX, 5 + n / rate, fix), image(5 + n / rate))]
    return write_bag(path, rows)


def east(*steps: int) -> list[Any]:
    """Fixes so many steps of 7.46 m to the east."""
    return [(0, 48.0, 11.0 + step / 10_000) for step in steps]


@pytest.mark.parametrize("name", ["drive.bag", "drive", "drive-mcap"])
@pytest.mark.parametrize("lost", LOST)
def test_frames_without_a_fix_are_left_out_and_the_others_keep_their_numbers(
    tmp_path: Path, name: str, lost: str
) -> None:
    fixes = [LOST[lost], LOST[lost], *east(0, 1), LOST[lost], *east(3)]
    notes = import_route("bag", fixed_bag(tmp_path / name, fixes), tmp_path / "out").notes
    (traverse,) = open_route(tmp_path / "out").traverses
    assert traverse.stems == ("000002", "000003", "000005")
    assert traverse.poses is not None
    np.testing.assert_allclose(traverse.poses[:, 0], [0, 7.46, 22.39], atol=0.01)
    told = f"Frames of {Path(name).stem} that were left out, since the receiver had no fix near them: 3."
    assert told in notes
    assert told in (tmp_path / "out/route.toml").read_text()


def test_frames_near_a_fix_have_its_position_whatever_is_said_between(tmp_path: Path) -> None:
    fixes = [LOST["at 0, 0"], *east(0, 1, 2)]
    import_route("bag", fixed_bag(tmp_path / "drive.bag", fixes, rate=10), tmp_path / "out")
    poses = open_route(tmp_path / "out").traverses[0].poses
    assert poses is not None
    np.testing.assert_allclose(poses[:, 0], [0, 0, 7.46, 14.92], atol=0.01)


@pytest.mark.parametrize(
    ("options", "stems"),
    [
        ({"every_frames": "2"}, ["000001", "000002"]),  # of 0, 2, 4 the first has no fix
        ({"every_seconds": "2"}, ["000001", "000002"]),
        ({"every_metres": "14"}, ["000000", "000001"]),
        ({"change": "0.9"}, ["000000"]),
        ({"without_pose": "drop"}, ["000000", "000001", "000002", "000003"]),
        ({"stems": "own"}, ["drive-000002", "drive-000003", "drive-000004", "drive-000005"]),
    ],
)
def test_frames_without_a_fix_in_what_is_sampled(tmp_path: Path, options: dict[str, str], stems: list[str]) -> None:
    fixes = [LOST["NaN"], LOST["at 0, 0"], *east(0, 1, 2, 3)]
    import_route("bag", fixed_bag(tmp_path / "drive.bag", fixes), tmp_path / "out", options)
    assert list(open_route(tmp_path / "out").traverses[0].stems) == stems


def test_a_receiver_that_says_nothing_is_still_refused(tmp_path: Path) -> None:
    rows = [image(1.0), image(5.0), ("/fix", FIX, 5.0, (0, 48.0, 11.0))]
    with pytest.raises(RouteError, match=r"has no pose within 0\.5 s of the frame '000000'"):
        import_route("bag", write_bag(tmp_path / "a.bag", rows), tmp_path / "out")


@pytest.mark.parametrize("lost", LOST)
def test_a_drive_that_never_had_a_fix_gets_no_poses(tmp_path: Path, lost: str) -> None:
    (tmp_path / "bags").mkdir()
    fixed_bag(tmp_path / "bags/a.bag", [LOST[lost], LOST[lost]])
    fixed_bag(tmp_path / "bags/b.bag", east(0, 1))
    notes = import_route("bag", tmp_path / "bags", tmp_path / "out").notes
    a, b = open_route(tmp_path / "out").traverses
    assert (len(a), a.poses) == (2, None)
    assert b.poses is not None
    assert f"The topic /fix of {tmp_path / 'bags/a.bag'} holds no position, so the drive gets no poses." in notes
    with pytest.raises(RouteError, match=r"a\.bag holds no position; choose another or none with `poses`"):
        import_route("bag", tmp_path / "bags", tmp_path / "chosen", {"poses": "/fix"})


def test_a_drive_whose_fixes_are_all_elsewhere(tmp_path: Path) -> None:
    rows = [image(1.0), ("/fix", FIX, 1.0, LOST["at 0, 0"]), ("/fix", FIX, 9.0, (0, 48.0, 11.0))]
    with pytest.raises(RouteError, match="no frame of a has a position, .* `poses=none`"):
        import_route("bag", write_bag(tmp_path / "a.bag", rows), tmp_path / "out")


def test_a_receiver_without_a_fix_need_not_know_the_time(tmp_path: Path) -> None:
    rows = [("/fix", FIX, 0.0, LOST["status -1"]), image(1.0), ("/fix", FIX, 1.0, (0, 48.0, 11.0))]
    assert import_route("bag", write_bag(tmp_path / "a.bag", rows), tmp_path / "out").frames == 1


def write_parts(directory: Path, ending: str, fixes: bool = True) -> None:
    """Three parts of 3 images a second; the receiver spoke in the first and the last alone, a degree of 111,320 m."""
    directory.mkdir()
    for part in range(3):
        rows = [image(10.0 + 3 * part + number) for number in range(3)]
        if fixes and part != 1:
            seconds = 10.0 if part == 0 else 18.0
            rows.append(("/fix", FIX, seconds, (0, 0.0, 20 + (seconds - 10) * 1e-4)))
        name = f"drive_{part}{ending}"
        if ending == ".mcap":
            bag = write_bag(directory.parent / f"{part}-mcap", rows)
            (bag / f"{part}-mcap.mcap").rename(directory / name)
        else:
            write_bag(directory / name, rows)


@pytest.mark.parametrize("ending", [".bag", "", ".mcap"])
def test_a_split_drive_is_joined_and_shares_one_track(tmp_path: Path, ending: str) -> None:
    write_parts(tmp_path / "winter", ending)
    options = {"pose_limit": "9", "stems": "file"}
    import_route("bag", tmp_path / "winter", tmp_path / "out", {"join": "true", **options})
    (traverse,) = open_route(tmp_path / "out").traverses
    assert (traverse.name, traverse.stems) == ("winter", tuple(f"{number:06d}" for number in range(9)))
    times = (traverse.root / "times.csv").read_text().split()[1:]
    assert [float(row.partition(",")[2]) for row in times] == [10.0 + number for number in range(9)]
    assert traverse.poses is not None
    np.testing.assert_allclose(traverse.poses[:, 0], 11.132 * np.arange(9), atol=1e-3)
    import_route("bag", tmp_path / "winter", tmp_path / "fewer", {"join": "true", "every_metres": "22", **options})
    assert open_route(tmp_path / "fewer").traverses[0].stems == ("000000", "000002", "000004", "000006", "000008")
    some = {"join": f"drive_0{ending},drive_2{ending}", **options}
    notes = import_route("bag", tmp_path / "winter", tmp_path / "some", some).notes
    assert notes[0] == f"Recordings that join does not name were not read: drive_1{ending}."
    assert len(open_route(tmp_path / "some").traverses[0]) == 6
    with pytest.raises(RouteError, match=rf"drive_0{ending} begins before the part that it follows; name the parts in"):
        import_route(
            "bag", tmp_path / "winter", tmp_path / "back", {**options, "join": f"drive_2{ending},drive_0{ending}"}
        )


@pytest.mark.parametrize("ending", [".bag", "", ".mcap"])
def test_a_split_drive_that_is_not_joined_is_told(tmp_path: Path, ending: str) -> None:
    write_parts(tmp_path / "bags", ending, fixes=False)
    notes = import_route("bag", tmp_path / "bags", tmp_path / "out", {"poses": "none"}).notes
    assert len(open_route(tmp_path / "out").traverses) == 3
    assert notes[0] == (
        f"drive_0{ending} and drive_1{ending} in {tmp_path / 'bags'} look like parts of one drive, but each became a "
        "drive of its own; if they are, import with `join=true`."
    )


def test_a_part_may_lack_the_images(tmp_path: Path) -> None:
    (tmp_path / "bags").mkdir()
    write_bag(tmp_path / "bags/a_0.bag", [image(1.0), image(2.0)])
    write_bag(tmp_path / "bags/a_1.bag", [("/fix", FIX, 3.0, (0, 1.0, 1.0))])
    write_bag(tmp_path / "bags/a_2.bag", [image(4.0)])
    assert import_route("bag", tmp_path / "bags", tmp_path / "out", {"join": "true", "poses": "none"}).frames == 3


def test_a_ros_2_bag_of_several_files_is_one_drive(tmp_path: Path) -> None:
    """As `ros2 bag record -b` splits it: metadata.yaml names the files."""
    first = write_bag(tmp_path / "drive", [image(1.0), image(2.0)])
    second = write_bag(tmp_path / "more", [image(3.0)])
    (first / "drive.db3").rename(first / "drive_0.db3")
    (second / "more.db3").rename(first / "drive_1.db3")
    metadata = (first / "metadata.yaml").read_text()
    metadata = metadata.replace("- drive.db3", "- drive_0.db3\n  - drive_1.db3")
    (first / "metadata.yaml").write_text(metadata.replace("message_count: 2", "message_count: 3"))
    assert import_route("bag", first, tmp_path / "out").frames == 3
    notes = import_route("bag", first / "drive_0.db3", tmp_path / "part").notes
    assert [note for note in notes if "looks like one of 2 parts of a drive" in note]


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 0)() == 0, reason="the superuser may look into every directory")
def test_a_bag_beside_a_directory_that_nobody_may_look_into(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", [image(1.0)])
    (tmp_path / "closed").mkdir(mode=0)
    assert import_route("bag", tmp_path / "a.bag", tmp_path / "out", {"poses": "none"}).frames == 1
