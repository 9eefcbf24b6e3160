"""Frames to localise, decoded one by one: of images, a video, a bag, or a camera."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.images.decoding import ImageSpec
from everplace.importing.frame_pixels import decode_content
from everplace.mapping.drive_source import open_drive

__all__ = ["FrameStream", "SeenFrame", "open_stream"]

_CAMERA = re.compile(r"/dev/video[0-9]+|(rtsp|rtmp|http|https)://.+")


class SeenFrame(NamedTuple):
    """A frame.

    Attributes:
        stem: Its name: a file's stem, or its number.
        image: H×W×3 RGB uint8.
        seconds: When it was taken; of a camera, seconds since 1970.
    """

    stem: str
    image: NDArray[np.uint8]
    seconds: float | None


@dataclass(frozen=True, eq=False)
class FrameStream:
    """Frames in order.

    Attributes:
        name: Of the drive.
        frames: Read once.
        count: How many will come, if known.
    """

    name: str
    frames: Iterator[SeenFrame]
    count: int | None = None


def open_stream(source: str) -> FrameStream:
    """Opens a directory of images, a video, a bag, a camera (`/dev/video0`) or a stream (`rtsp://...`).

    Raises:
        RouteError: There is nothing, or it gives no frame.
    """
    if _CAMERA.fullmatch(source):
        return FrameStream(source, _camera(source))
    drive = open_drive(Path(source))
    spec = ImageSpec()
    frames = (SeenFrame(frame.stem, decode_content(frame, spec), frame.seconds) for frame in drive.frames)
    return FrameStream(drive.name, frames, drive.count)


def _camera(source: str) -> Iterator[SeenFrame]:
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise RouteError(f"the camera {source} cannot be opened; is it connected, and may you read it?")
        number = 0
        while True:
            given, image = capture.read()
            if not given:
                if not number:
                    raise RouteError(f"the camera {source} gives no frame; is it connected?")
                return
            yield SeenFrame(f"{number:06d}", np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8), time.time())
            number += 1
    finally:
        capture.release()
