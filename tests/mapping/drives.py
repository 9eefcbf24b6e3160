"""Makes drives of other forms out of a traverse's images."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["another_camera", "image_files", "images_of", "write_drive", "write_video"]


def image_files(traverse: Path) -> list[Path]:
    """In the order of their names."""
    return sorted(path for path in traverse.iterdir() if path.suffix in {".png", ".jpg"})


def images_of(traverse: Path) -> list[NDArray[np.uint8]]:
    """H×W×3 RGB."""
    return [np.asarray(Image.open(path).convert("RGB")) for path in image_files(traverse)]


def write_drive(path: Path, images: Sequence[NDArray[np.uint8]], first: int = 0) -> Path:
    """A directory of PNGs of RGB or grey images, named by numbers."""
    path.mkdir(parents=True)
    for number, image in enumerate(images, start=first):
        shown = image if image.ndim == 2 else image[:, :, ::-1]
        assert cv2.imwrite(str(path / f"{number:05d}.png"), shown)
    return path


def write_video(path: Path, images: Sequence[NDArray[np.uint8]], rate: int = 10) -> Path:
    """Of RGB images of one size."""
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": "10"})
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        container.mux(stream.encode())
    return path


def another_camera(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What a camera of another size, somewhat narrower and brighter, shows."""
    height, width = image.shape[:2]
    cut = image[height // 20 : -(height // 20), width // 25 : -(width // 25)]
    larger = cv2.resize(cut, (320, 200), interpolation=cv2.INTER_LINEAR)
    brighter: NDArray[np.uint8] = np.clip(larger * 1.1 + 5, 0, 255).astype(np.uint8)
    return brighter


def copied(drive: Path, to: Path, keep: slice) -> Path:
    """Some of a drive's images under their names."""
    to.mkdir(parents=True)
    for path in image_files(drive)[keep]:
        shutil.copy(path, to)
    return to
