"""Peak memory, measured in a real process."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from PIL import Image

from everplace.describe.peak_memory import peak_memory
from everplace.errors import MethodError
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
