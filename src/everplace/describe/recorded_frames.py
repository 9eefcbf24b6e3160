"""The frames of a video or a bag, to be described as they are read: none is written, and few are in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec, convert_image
from everplace.images.sixteen_bits import SixteenBits
from everplace.importing.containers.ros_bag import BAG_ENDINGS, METADATA
from everplace.importing.containers.video_frames import VIDEO_ENDINGS
from everplace.importing.foreign_route import ForeignFrame, ForeignTraverse
from everplace.importing.frame_pixels import decode_content
from everplace.importing.kinds import open_kind, read_options
from everplace.importing.route_writer import unreadable

__all__ = ["RecordedFrames", "is_recording", "is_video", "open_recording"]


@dataclass(frozen=True)
class RecordedFrames:
    """One drive as a recording has it, which can be read once.

    Attributes:
        path: The video or bag.
        drive: Its frames.
        source_notes: What the source says; more may be added while the frames are read.
        scale_notes: What the 16-bit values of the frames showed, once they were read.
    """

    path: Path
    drive: ForeignTraverse
    source_notes: Sequence[str]
    scale_notes: list[str] = field(default_factory=list)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that the user should read; whole once the frames were read."""
        return (*self.source_notes, *self.scale_notes)

    def pixels(self, spec: ImageSpec, names: list[str]) -> Iterator[NDArray[np.uint8]]:
        """Yields the images as a method wants them; the name of each is added to `names`.

        Raises:
            RouteError: The recording is damaged.
            ImageError: An image of it cannot be decoded.
        """
        for frame in self.frames():
            names.append(frame.stem)
            # An array as the same image in a file would be, so that importing first changes no number.
            content = frame.content
            yield convert_image(content, spec) if isinstance(content, np.ndarray) else decode_content(frame, spec)

    def frames(self) -> Iterator[ForeignFrame]:
        """Yields the frames; once the last is read, `notes` is whole.

        Raises:
            RouteError: The recording is damaged.
        """
        scale: SixteenBits | None = None
        try:
            for frame in self.drive.frames:
                scale = frame.scale
                yield frame
        except OSError as error:
            raise unreadable(error, self.path) from error
        if scale is not None:
            self.scale_notes.extend(scale.notes(readable(self.drive.name)))


def is_recording(path: Path) -> bool:
    """Whether this is a video or a bag, going by its name, or by what makes a directory a ROS 2 bag."""
    if path.is_dir():
        return (path / METADATA).is_file()
    return path.suffix.lower() in VIDEO_ENDINGS | BAG_ENDINGS


def is_video(path: Path) -> bool:
    """Whether this is a video, not a bag, of what `is_recording` knows."""
    return path.suffix.lower() in VIDEO_ENDINGS and path.is_file()


def open_recording(path: Path, options: Mapping[str, str] | None = None) -> RecordedFrames:
    """Opens a video or a bag; its frames are called by their numbers in it.

    Args:
        path: What `is_recording` knows.
        options: Those of the kind "video" or "bag" as `everplace data import` takes them, such as `every_seconds`.

    Raises:
        RouteError: It is missing, damaged or empty.
        ConfigError: There is no such option, or a choice between topics is left open.
        MissingExtraError: What reads it is not installed.
    """
    if not path.exists():
        raise RouteError(f"the recording {readable(path)} does not exist; check the path")
    kind = "video" if is_video(path) else "bag"
    source = open_kind(kind)
    given = {"stems": "file", **(options or {})}
    if kind == "bag" and "every_metres" not in given:  # nothing else needs poses
        given = {"poses": "none", **given}
    settings = read_options(kind, source.Options, given)
    try:
        route = source.read(path, settings)
        drive = next(route.traverses)
    except OSError as error:
        raise unreadable(error, path) from error
    return RecordedFrames(path, drive, route.notes)
