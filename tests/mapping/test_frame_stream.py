"""Frames to localise come one by one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tests.mapping.drives import images_of, write_drive, write_video

from everplace.errors import RouteError
from everplace.mapping.frame_stream import open_stream


def test_images_come_as_colour_whatever_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    grey, colour = (rng.integers(0, 256, shape, dtype=np.uint8) for shape in ((4, 6), (5, 7, 3)))
    stream = open_stream(str(write_drive(tmp_path / "drive", [grey, colour])))
    assert (stream.name, stream.count) == ("drive", 2)
    first, second = stream.frames
    np.testing.assert_array_equal(first.image, np.repeat(grey[:, :, None], 3, axis=2))
    np.testing.assert_array_equal(second.image, colour)
    assert (first.stem, second.stem, first.seconds) == ("00000", "00001", None)


def test_a_video_is_decoded_as_it_is_asked_for(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    images = images_of(unchanged_rendered_route / "winter")[:5]
    frames = open_stream(str(write_video(tmp_path / "drive.mp4", images))).frames
    first = next(frames)
    assert int(first.stem) == 0
    assert first.seconds == 0
    assert np.abs(first.image.astype(int) - images[0]).mean() < 8
    assert [int(frame.stem) for frame in frames] == [1, 2, 3, 4]


class Camera:
    """What `cv2.VideoCapture` is where no camera can be plugged in: a video file behind a device's name."""

    file = ""

    def __init__(self, source: str) -> None:
        assert source == "/dev/video0"
        self._capture = _REAL(self.file)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._capture, name)


_REAL = cv2.VideoCapture


def test_a_camera_counts_its_frames_and_tells_the_time(
    unchanged_rendered_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    images = images_of(unchanged_rendered_route / "summer")[:4]
    monkeypatch.setattr(Camera, "file", str(write_video(tmp_path / "drive.mp4", images)))
    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    frames = list(open_stream("/dev/video0").frames)
    assert [frame.stem for frame in frames] == ["000000", "000001", "000002", "000003"]
    assert np.abs(frames[2].image.astype(int) - images[2]).mean() < 8  # red is red
    seconds = [frame.seconds or 0.0 for frame in frames]
    assert seconds == sorted(seconds)
    assert seconds[0] > 1.5e9


@pytest.mark.parametrize("source", ["/dev/video97", "rtsp://127.0.0.1:9/none", "http://127.0.0.1:9/none.mjpg"])
def test_a_camera_that_is_not_there_is_told(source: str) -> None:
    with pytest.raises(RouteError, match="cannot be opened; is it connected"):
        list(open_stream(source).frames)
