"""ROS 1 and ROS 2 bags and MCAP files, without ROS, through rosbags.

Messages are read by the standard definition of their type. The definitions that a bag carries are only compared with
it: rosbags turns definitions into Python code, and no code is to be made of a stranger's file.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from everplace.errors import EverplaceError, MissingExtraError, RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys.store import Typestore

__all__ = ["BAG_ENDINGS", "METADATA", "Bag", "Topic", "open_bag", "read_messages", "read_topics"]

BAG_ENDINGS = frozenset({".bag", ".db3", ".mcap"})
"""Endings (lower case) by which a file counts as a bag."""

METADATA = "metadata.yaml"
"""What makes a directory a ROS 2 bag."""

_OTHER_DEFINITIONS = frozenset({"flatbuffer", "jsonschema", "protobuf", "ros1msg"})
_OTHER_PROFILE = "Profile is not ros2"


@dataclass(frozen=True)
class Topic:
    """What a bag says about a topic.

    Attributes:
        name: Such as `/camera/image_raw`.
        types: The types of its messages, such as `sensor_msgs/msg/Image`; usually one.
        count: Number of messages.
    """

    name: str
    types: frozenset[str]
    count: int


class Bag:
    """An open bag."""

    def __init__(self, path: Path, reader: Reader1 | Reader2, store: Typestore, *, is_ros1: bool) -> None:
        self._path = path
        self._reader = reader
        self._store = store
        self._is_ros1 = is_ros1

    def topics(self, types: Collection[str]) -> list[Topic]:
        """Returns the topics with messages of some of these types, sorted by name."""
        found: dict[str, list[Connection]] = {}
        for connection in self._reader.connections:
            found.setdefault(connection.topic, []).append(connection)
        topics = [
            Topic(name, frozenset(each.msgtype for each in group), sum(each.msgcount for each in group))
            for name, group in sorted(found.items())
        ]
        return [topic for topic in topics if topic.types.intersection(types)]

    def messages(self, topic: str, message_type: str) -> Iterator[tuple[int, Any]]:
        """Reads the messages of a topic in the order in which they were recorded.

        Yields:
            The time of recording in nanoseconds, and the message.

        Raises:
            RouteError: The bag is damaged, or its messages are not serialised as ROS does it.
        """
        with _naming_errors(self._path):
            connections = [each for each in self._reader.connections if each.topic == topic]
            for connection in connections:
                self._check(connection, message_type)
            messages = self._reader.messages(connections=connections)
        while True:
            with _naming_errors(self._path):
                found = next(messages, None)
                if found is None:
                    return
                _, nanoseconds, raw = found
                deserialise = self._store.deserialize_ros1 if self._is_ros1 else self._store.deserialize_cdr
                message = deserialise(raw, message_type)
            yield nanoseconds, message

    def _check(self, connection: Connection, message_type: str) -> None:
        """Raises `RouteError` for messages that the standard definition does not describe."""
        form = getattr(connection.ext, "serialization_format", "cdr")
        if connection.msgtype != message_type or form != "cdr":
            raise RouteError(
                f"the topic {connection.topic} of {readable(self._path)} holds {connection.msgtype} serialised as "
                f"{form!r}, and only {message_type} as ROS serialises it can be read; convert it or choose another "
                "topic"
            )
        standard = (
            self._store.generate_msgdef(message_type)[1] if self._is_ros1 else self._store.hash_rihs01(message_type)
        )
        if connection.digest not in ("", "*", standard):
            raise RouteError(
                f"the topic {connection.topic} of {readable(self._path)} has a definition of {message_type} of its own "
                f"(hash {connection.digest[:80]}); record or convert it with the standard definition"
            )


@contextlib.contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Opens a ROS 1 `.bag`, the directory of a ROS 2 bag, an `.mcap` or a `.db3` file.

    Raises:
        RouteError: It is missing, damaged, or none of these.
        MissingExtraError: rosbags is not installed.
    """
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("reading bags", "ros") from error
    for file in (path, *(path.glob("*") if path.is_dir() else ())):
        refuse_pointer(file, RouteError)
    with contextlib.ExitStack() as stack:
        with _naming_errors(path):
            is_ros1 = path.suffix.lower() == ".bag" and not path.is_dir()
            # A file object shows at once what the readers would tell less clearly.
            with (path / METADATA if path.is_dir() else path).open("rb"):
                pass
            reader: Reader1 | Reader2 = Reader1(path) if is_ros1 else Reader2(path)
            stack.enter_context(reader)
            store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
        yield Bag(path, reader, store, is_ros1=is_ros1)


def read_topics(paths: Sequence[Path], types: Collection[str]) -> list[Topic]:
    """Returns the topics with messages of some of these types in the bags of one drive, all taken together, by name.

    Raises:
        RouteError, MissingExtraError: As `open_bag`.
    """
    found: dict[str, Topic] = {}
    for path in paths:
        with open_bag(path) as bag:
            for topic in bag.topics(types):
                before = found.get(topic.name, Topic(topic.name, topic.types, 0))
                found[topic.name] = Topic(topic.name, before.types | topic.types, before.count + topic.count)
    return [found[name] for name in sorted(found) if found[name].count]


def read_messages(path: Path, topic: str, message_type: str, *, complete: bool = False) -> Iterator[tuple[int, Any]]:
    """Reads the messages of a topic from one bag of a drive, which need not have the topic; as `Bag.messages`.

    Args:
        path: The bag.
        topic: The topic's name.
        message_type: The type of its messages.
        complete: Whether fewer messages than the bag announces are an error.

    Raises:
        RouteError: The bag is damaged, or lacks messages.
        MissingExtraError: rosbags is not installed.
    """
    with open_bag(path) as bag:
        announced = sum(found.count for found in bag.topics([message_type]) if found.name == topic)
        if not announced:
            return  # rosbags would give the messages of all topics
        count = 0
        for count, message in enumerate(bag.messages(topic, message_type), start=1):  # noqa: B007
            yield message
        if complete and count < announced:
            raise RouteError(
                f"{readable(path)} announces {announced} messages of {topic}, but holds only {count}; reindex or "
                "recover it"
            )


@contextlib.contextmanager
def _naming_errors(path: Path) -> Iterator[None]:
    """Turns whatever rosbags and the libraries below it raise into one sentence; on damaged files that is anything."""
    try:
        yield
    except EverplaceError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            reason = f"cannot read {readable(path)}: {error.strerror}; check the path and its permissions"
        elif (isinstance(error, KeyError) and error.args[0] in _OTHER_DEFINITIONS) or _OTHER_PROFILE in str(error):
            what = "of another profile than ros2" if _OTHER_PROFILE in str(error) else f"defined as {error.args[0]!r}"
            reason = (
                f"{readable(path)} holds messages {what}, and only those of ROS 2 can be read; "
                "convert it to a ROS 2 bag"
            )
        else:
            what = " ".join(str(error).split()).rstrip(".")[:200]
            reason = (
                f"{readable(path)} is damaged or is no bag that can be read "
                f"({f'{type(error).__name__}: ' if len(what) < 20 else ''}{what}); reindex, recover or convert it"
            )
        raise RouteError(reason) from error
