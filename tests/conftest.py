"""Fixtures that several rooms use."""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from filelock import FileLock
from PIL import Image
from tests.file_server import FileServer, serving
from tests.forked import ForkedProcess

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PLACES = 12
CHROMIUM = Path("/usr/bin/chromium")


def pytest_collection_finish() -> None:
    """Keeps what was imported out of each later search for garbage, which takes a tenth of the time otherwise."""
    gc.collect()
    gc.freeze()


def pytest_configure() -> None:
    """Has each process compute with one thread, as `make test` runs a process for each core."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(scope="session", autouse=True)
def _private_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keeps packed images of tests out of the user's cache, in child processes as well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EVERPLACE_CACHE", str(tmp_path_factory.mktemp("everplace-cache")))
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The directory of real data sets (nordland64, gardens_point), or a skip with the reason."""
    chosen = os.environ.get("EVERPLACE_DATA")
    path = Path(chosen) if chosen else Path(__file__).parents[2] / "shared" / "data"
    if not (path / "nordland64").is_dir():
        pytest.skip(f"real data is not at {path}: set EVERPLACE_DATA to the directory that holds nordland64")
    return path


MadeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> MadeOnce:
    """Makes a directory under a name, once for all processes of a run; nobody may change it."""
    base = tmp_path_factory.getbasetemp()
    base = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made-once"
    base.mkdir(exist_ok=True)

    def once(name: str, make: Callable[[Path], object]) -> Path:
        path, whole = base / name, base / f"{name}.whole"
        with FileLock(base / f"{name}.lock"):
            if not whole.exists():
                shutil.rmtree(path, ignore_errors=True)  # of a process that failed
                make(path)
                whole.touch()
        return path

    return once


@pytest.fixture
def tiny_route(unchanged_tiny_route: Path, tmp_path: Path) -> Path:
    """`unchanged_tiny_route` for a test that may change it."""
    return Path(shutil.copytree(unchanged_tiny_route, tmp_path / "tiny"))


MakeLandscapes = Callable[[Path, int], Path]


@pytest.fixture(scope="session")
def make_landscapes() -> MakeLandscapes:
    """Makes a route of two conditions, `summer` and `winter`, with 32×64 colour PNGs named 0, 1, 2, ...

    Each place is a smooth random landscape of its own; winter is paler, bluer and shifted by one pixel.
    """

    def make(root: Path, places: int) -> Path:
        rng = np.random.default_rng(7)
        for condition in ("summer", "winter"):
            (root / condition).mkdir(parents=True)
        for place in range(places):
            coarse = rng.integers(30, 226, (4, 8, 3), dtype=np.uint8)
            summer = np.asarray(Image.fromarray(coarse).resize((64, 32), Image.Resampling.BICUBIC))
            pale = np.roll(summer, 1, axis=1) * np.array([0.5, 0.55, 0.6]) + np.array([70.0, 75.0, 90.0])
            Image.fromarray(summer).save(root / "summer" / f"{place}.png")
            Image.fromarray(pale.astype(np.uint8)).save(root / "winter" / f"{place}.png")
        return root

    return make


@pytest.fixture(scope="session")
def unchanged_tiny_route(tmp_path_factory: pytest.TempPathFactory, make_landscapes: MakeLandscapes) -> Path:
    """A route of 12 places as `make_landscapes` makes it; nobody may change it."""
    return make_landscapes(tmp_path_factory.mktemp("route") / "tiny", PLACES)


@pytest.fixture(scope="session")
def unchanged_rendered_route(made_once: MadeOnce) -> Path:
    """A rendered road of 60 places in summer, autumn and winter, 64×128, with poses; nobody may change it."""
    from everplace.render.render_config import RenderConfig
    from everplace.render.rendered_route import render_route

    config = RenderConfig(places=60, seed=3, size=(64, 128), conditions=("summer", "autumn", "winter"))
    return made_once("road", lambda path: render_route(path, config))


@pytest.fixture(scope="session")
def unchanged_summer_map(unchanged_rendered_route: Path, made_once: MadeOnce) -> Path:
    """A map by hog16 of that road's summer; nobody may change it."""
    from everplace.mapping.route_map import Map

    drive = unchanged_rendered_route / "summer"
    return made_once("summer-map", lambda path: Map.create(path, drive, method="hog16"))


@pytest.fixture(scope="session")
def unchanged_three_map(unchanged_summer_map: Path, unchanged_rendered_route: Path, made_once: MadeOnce) -> Path:
    """The same with autumn and winter; nobody may change it."""
    from everplace.mapping.route_map import Map

    def make(path: Path) -> None:
        shutil.copytree(unchanged_summer_map, path)
        for name in ("autumn", "winter"):
            Map.open(path).add(unchanged_rendered_route / name)

    return made_once("three-map", make)


@pytest.fixture
def summer_map(unchanged_summer_map: Path, tmp_path: Path) -> Path:
    """`unchanged_summer_map` for a test that may change it."""
    return Path(shutil.copytree(unchanged_summer_map, tmp_path / "summer-map"))


@pytest.fixture
def three_map(unchanged_three_map: Path, tmp_path: Path) -> Path:
    """`unchanged_three_map` for a test that may change it."""
    return Path(shutil.copytree(unchanged_three_map, tmp_path / "three-map"))


@pytest.fixture
def run_study() -> Callable[..., None]:
    """Runs `python -m studies NAME --data DATA --out OUT` with further options, from the project's root."""

    def run(name: str, data: Path, out: Path, *options: str) -> None:
        root = Path(__file__).parents[1]
        with ForkedProcess("-m", "studies", name, "--data", data, "--out", out, *options, cwd=root) as process:
            assert process.wait() == 0

    return run


@pytest.fixture(scope="module")  # while it is there, an event loop runs, so that no other can
def browser() -> Iterator[Browser]:
    """A browser that nobody sees."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install 'everplace[dev]'")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is not there: install the chromium package")
    with api.sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=str(CHROMIUM),
            args=["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
        )
        yield started
        started.close()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[FileServer]:
    """An HTTP server on this machine that misbehaves as told."""
    monkeypatch.setenv("no_proxy", "*")
    with serving() as served:
        yield served
