"""A writer of `.seq` containers, byte by byte as the layout says."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

RAW, JPEG, PNG = {100, 200}, {102, 201}, {1, 2}


class WriteSeq(Protocol):
    def __call__(
        self,
        path: Path,
        frames: Sequence[NDArray[np.uint8]],
        seconds: Sequence[float] | None = None,
        *,
        code: int = 201,
        padding: int = 8,
        announced: int | None = None,
        version: int = 3,
    ) -> list[bytes]: ...


def write_seq_file(
    path: Path,
    frames: Sequence[NDArray[np.uint8]],
    seconds: Sequence[float] | None = None,
    *,
    code: int = 201,
    padding: int = 8,
    announced: int | None = None,
    version: int = 3,
) -> list[bytes]:
    """Writes H×W×1 or H×W×3 frames and returns what it stored for each: the image file or the raw bytes."""
    height, width, channels = frames[0].shape if frames else (4, 6, 3)
    seconds = [number / 20 for number in range(len(frames))] if seconds is None else seconds
    picture = height * width * channels
    distance = picture + 6 + 512 - (picture + 6) % 512
    header = bytearray(8192 if version >= 5 else 1024)
    struct.pack_into("<I", header, 0, 0xFEED)
    header[4:28] = "Norpix seq\0\0".encode("utf-16-le")
    struct.pack_into("<iI", header, 28, version, 1024)
    header[36:66] = "No Description"[:15].encode("utf-16-le").ljust(30, b"\0")
    count = len(frames) if announced is None else announced
    values = (width, height, 8 * channels, 8, picture, code, count, 0, distance)
    struct.pack_into("<9I", header, 548, *values)
    struct.pack_into("<d", header, 584, 20.0)
    stored, parts = [], [bytes(header)]
    for frame, time in zip(frames, seconds, strict=True):
        microseconds = round(time * 1_000_000)
        stamp = struct.pack("<IHH", microseconds // 1_000_000, microseconds // 1000 % 1000, microseconds % 1000)
        if code in RAW:
            data = frame[:, :, ::-1].tobytes()
            parts.append((data + stamp).ljust(distance, b"\0"))
        else:
            buffer = io.BytesIO()
            Image.fromarray(frame.squeeze()).save(buffer, "JPEG" if code in JPEG else "PNG")
            data = buffer.getvalue()
            parts += [struct.pack("<I", len(data) + 4), data, stamp, bytes(padding)]
        stored.append(data)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(parts))
    return stored


@pytest.fixture(scope="session")
def write_seq() -> WriteSeq:
    return write_seq_file
