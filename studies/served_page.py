"""The picture of "A page and an HTTP service".

    python -m studies served_page --out docs/images

A rendered route of 120 places; the map knows it in summer, autumn and winter. A drive at night follows it to place 90
and then leaves it for 15 frames. OUT/serve.png: the page in Chromium when this drive was played.
"""

from __future__ import annotations

import argparse
import io
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from everplace.files import write_bytes
from everplace.mapping.route_map import Map
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route

_PLACES, _KNOWN, _AWAY = 120, 90, 15
_CONDITIONS = ("summer", "autumn", "winter")
_SHOWN, _CELL = 32, (59, 60)  # the frame at the top of the page, and the place and frame that are compared below
_CHROMIUM = "/usr/bin/chromium"
_WIDTH = 1240
_LAST = "#map"  # what stands below this is not shown


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies served_page", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as directory:
        map_, frames = driven(Path(directory))
        service = subprocess.Popen(
            [sys.executable, "-m", "everplace", "serve", str(map_), "--port", "0"], stdout=subprocess.PIPE, text=True
        )
        try:
            assert service.stdout is not None
            found = re.search(r"http://\S+/", service.stdout.readline())
            assert found is not None
            picture = photographed(found[0], frames)
        finally:
            service.terminate()
            service.wait()
    reduced = io.BytesIO()
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(256).save(reduced, "PNG", optimize=True)
    write_bytes(given.out / "serve.png", reduced.getvalue())


def driven(directory: Path) -> tuple[Path, list[Path]]:
    """A map, and the frames of the drive at night, whose names beyond the route are of no frame of the map."""
    worlds = []
    for seed, places, names in ((31, _PLACES, (*_CONDITIONS, "night")), (32, _AWAY, ("night",))):
        path = directory / f"world{seed}"
        render_route(path, render_config({"places": places, "size": (240, 320), "seed": seed, "conditions": names}))
        worlds.append(open_route(path))
    route, elsewhere = worlds
    map_ = Map.create(directory / "map", route[_CONDITIONS[0]], method="hog16+efficientnet")
    for condition in _CONDITIONS[1:]:
        map_.add(route[condition])
    away = [path.rename(path.with_name(f"away{path.name}")) for path in elsewhere["night"].paths]
    return directory / "map", [*route["night"].paths[:_KNOWN], *away]


def photographed(url: str, frames: Sequence[Path]) -> bytes:
    """The page with the drive played, as a PNG file."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": _WIDTH, "height": 1000})
        page.goto(url)
        page.locator("#coverage-table tbody tr").first.wait_for()
        page.set_input_files("#frames-input", list(frames))
        page.select_option("#speed", "0")
        page.locator("#play", has_text="Play again").wait_for(timeout=300_000)
        canvas = page.locator("#matrix-chart canvas")
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        assert box is not None
        place, frame = _CELL
        canvas.click(
            position={
                "x": box["width"] * (place + 0.5) / _PLACES, "y": box["height"] * (frame + 0.5) / len(frames)
            }
        )  # fmt: skip
        page.locator("#truth").check()
        page.locator("#threshold-slider").fill("0.9")
        page.locator("#position").fill(str(_SHOWN))
        page.locator("#matches li").first.wait_for()
        page.wait_for_load_state("networkidle")
        page.evaluate("window.scrollTo(0, 0)")
        below = page.locator(_LAST).bounding_box()
        assert below is not None
        whole = page.screenshot(full_page=True, clip={"x": 0, "y": 0, "width": _WIDTH, "height": below["y"]})
        browser.close()
        return whole
