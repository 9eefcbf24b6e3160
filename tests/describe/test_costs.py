"""The time of one image without decoding, and peak memory, measured in a real process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.describe import costs
from everplace.describe.costs import peak_memory, time_describer
from everplace.describe.methods.sad import SAD
from everplace.errors import MethodError, RouteError
from everplace.images.decoding import ImageSpec
from everplace.route.route import open_route

_MEGABYTES = 300

_HUBCONF = f"""
import numpy, torch

class Large(torch.nn.Module):
    def forward(self, images):
        numpy.ones({_MEGABYTES} * 10**6, numpy.uint8)
        return images.flatten(1)[:, :8]

def plain():
    return torch.nn.Sequential(torch.nn.AdaptiveAvgPool2d(2), torch.nn.Flatten())

def large():
    return Large()
"""


not_on_windows = pytest.mark.skipif(sys.platform == "win32", reason="Windows does not tell the peak memory")


@not_on_windows
@pytest.mark.slow
def test_what_the_images_need_is_seen_and_what_this_process_has_is_not(tiny_route: Path, tmp_path: Path) -> None:
    held = bytearray(b"\1" * 200 * 10**6)
    few = peak_memory("sad", open_route(tiny_route)["summer"].paths, frames=1)
    Image.new("L", (6000, 6000)).save(tmp_path / "large.png", compress_level=1)
    large = peak_memory("sad", [tmp_path / "large.png"])
    assert few is not None
    assert large is not None
    assert 10 < few < len(held) / 10**6
    assert 33 < large - few < 160  # 36 MB of pixels, and copies of them while they are decoded


@pytest.mark.slow
@not_on_windows
def test_what_a_network_needs_is_seen_and_what_this_process_has_is_not(tiny_route: Path, tmp_path: Path) -> None:
    (tmp_path / "nets").mkdir()
    (tmp_path / "nets" / "hubconf.py").write_text(_HUBCONF)
    paths = open_route(tiny_route)["summer"].paths
    held = bytearray(b"\1" * 500 * 10**6)
    plain, large = (peak_memory(f"hub:{tmp_path / 'nets'}:{entry}#size=32x64", paths) for entry in ("plain", "large"))
    sad = peak_memory("sad", paths)
    assert sad is not None
    assert plain is not None
    assert large is not None
    assert 10 < sad < len(held) / 10**6
    assert sad < plain  # no torch
    assert 0.8 * _MEGABYTES < large - plain < 1.5 * _MEGABYTES


def test_a_method_that_fails_there_is_named(tiny_route: Path, tmp_path: Path) -> None:
    paths = open_route(tiny_route)["summer"].paths
    with pytest.raises(MethodError, match="peak memory of nonesuch could not be measured: .*nonesuch"):
        peak_memory("nonesuch", paths)


class Slow(SAD):
    """Takes 4 ms an image."""

    def __init__(self) -> None:
        self.batches: list[int] = []

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        self.batches.append(len(images))
        time.sleep(0.004 * len(images))
        return super().describe_batch(images)


def test_time_is_that_of_one_image_without_decoding(monkeypatch: pytest.MonkeyPatch) -> None:
    def decode_slowly(paths: Sequence[Path], spec: ImageSpec) -> Iterator[NDArray[np.uint8]]:
        for _ in paths:
            time.sleep(0.2)
            yield np.zeros((32, 64, 1), np.uint8)

    monkeypatch.setattr(costs, "decode_images", decode_slowly)
    describer = Slow()
    assert 4 <= time_describer(describer, [Path(str(i)) for i in range(20)], frames=5).ms < 200
    assert describer.batches == [1] * 6  # one to warm up


def test_without_images_there_is_nothing_to_time() -> None:
    with pytest.raises(RouteError, match="no images to time"):
        time_describer(SAD(), [])


@pytest.mark.parametrize(
    ("before", "after", "busy"),
    [
        ("cpu  100 0 100 800 0 0 0 0 0 0", "cpu  110 0 110 880 0 0 0 0 0 0", False),  # 20 of 100
        ("cpu  100 0 100 800 0 0 0 0 0 0", "cpu  150 0 110 840 0 0 0 0 0 0", True),  # 60 of 100
        ("cpu  100 0 100 800 0 0 0 0 0 0", "cpu  100 40 100 860 0 0 0 0 0 0", True),  # of low priority
        ("cpu  100 0 100 800 0 0 0 0 0 0", "cpu  100 0 100 800 90 0 0 10 0 0", False),  # waiting for a disk
        ("cpu  100 0 100 800 0 0 0 0 0 0", "cpu  100 0 100 870 0 0 0 30 0 0", True),  # other virtual machines
    ],
)
def test_other_work_on_the_machine_is_told(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, after: str, busy: bool
) -> None:
    """What the kernel says before the watch and after it, both times."""
    told = tmp_path / "stat"
    told.write_text(before)
    watches = iter([after, after])

    def wait(seconds: float) -> None:
        told.write_text(next(watches))

    def read_again(describer: SAD, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        told.write_text(before)
        return describe(describer, images)

    describe = SAD.describe_batch
    monkeypatch.setattr(costs, "_PROCESSOR_TIMES", told)
    monkeypatch.setattr(time, "sleep", wait)
    monkeypatch.setattr(SAD, "describe_batch", read_again)
    assert time_describer(SAD(), open_route(tiny_route)["summer"].paths, frames=3).beside_other_work is busy


def test_where_no_system_tells_nothing_is_said(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(costs, "_PROCESSOR_TIMES", tmp_path / "absent")
    assert not time_describer(SAD(), open_route(tiny_route)["summer"].paths, frames=3).beside_other_work


@pytest.mark.skipif(not Path("/proc/stat").exists(), reason="only Linux tells how busy the machine is")
def test_a_process_that_computes_beside_is_noticed(tiny_route: Path) -> None:
    others = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(max(1, (os.cpu_count() or 1) // 2))
    ]
    try:
        time.sleep(0.3)
        assert time_describer(SAD(), open_route(tiny_route)["summer"].paths, frames=3).beside_other_work
    finally:
        for other in others:
            other.kill()
            other.wait()
