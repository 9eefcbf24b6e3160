from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.errors import ConfigError
from everplace.render import rendered_route as route_module
from everplace.render.frame import open_drive
from everplace.render.render_config import RenderConfig
from everplace.render.rendered_route import drive_poses, render_route, route_world
from everplace.route.route import open_route

T = TypeVar("T")
SMALL = RenderConfig(places=4, size=(24, 40), conditions=("winter", "rain"), seed=9)


@pytest.fixture(scope="module")
def rendered_by_workers(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    """The small route by two processes, a frame at a time, and what answered Ctrl-C meanwhile."""
    answers = []

    def look(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        for item in items:
            answers.append(signal.getsignal(signal.SIGINT))
            yield item

    out = tmp_path_factory.mktemp("rendered") / "route"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(route_module, "_BATCH", 1)
        render_route(out, SMALL, progress=look, workers=2)
    return out, answers


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small route, not to be written to."""
    out = tmp_path_factory.mktemp("rendered") / "route"
    render_route(out, SMALL)
    return out


def _files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_the_same_configuration_gives_the_same_bytes(
    rendered: Path, rendered_by_workers: tuple[Path, list[Any]]
) -> None:
    files = _files(rendered)
    assert files == _files(rendered_by_workers[0])
    names = [f"{stem:05d}.png" for stem in range(4)] + ["poses.csv"]
    assert sorted(files) == sorted(["route.toml", *(f"{c}/{name}" for c in ("winter", "rain") for name in names)])


def test_seed_and_condition_change_the_frames_but_other_conditions_do_not(rendered: Path, tmp_path: Path) -> None:
    render_route(tmp_path / "one", SMALL.model_copy(update={"conditions": ("rain",)}))
    render_route(tmp_path / "other", SMALL.model_copy(update={"seed": 10, "conditions": ("rain",)}))
    frame = (rendered / "rain/00002.png").read_bytes()
    assert frame == (tmp_path / "one/rain/00002.png").read_bytes()
    assert frame != (tmp_path / "other/rain/00002.png").read_bytes()


def test_the_route_opens_with_its_conditions_and_poses(rendered: Path) -> None:
    route = open_route(rendered)
    assert route.tolerance == 1
    assert set(route.conditions) == {"winter", "rain"}
    assert route["rain"].stems == ("00000", "00001", "00002", "00003")
    poses = route["rain"].poses
    assert poses is not None
    np.testing.assert_allclose(poses, drive_poses(route_world(SMALL), SMALL, "rain"), atol=1e-4)
    image = cv2.imread(str(route["rain"].paths[1]))
    assert image is not None
    pose = (float(poses[1, 0]), float(poses[1, 1]), float(poses[1, 2]))
    frame = open_drive(route_world(SMALL), "rain").frame(pose, SMALL.size)
    assert image.shape == (24, 40, 3)
    # The file holds RGB in the usual order: the frame at the written (rounded) pose is the same but for its noise.
    assert np.abs(image[..., ::-1].mean(axis=(0, 1)) - frame.mean(axis=(0, 1))).max() < 4


def test_jpeg_is_smaller(tmp_path: Path) -> None:
    small = SMALL.model_copy(update={"conditions": ("rain",), "format": "jpg", "quality": 60})
    render_route(tmp_path / "jpg", small)
    assert sorted(path.name for path in (tmp_path / "jpg/rain").iterdir())[0] == "00000.jpg"
    assert (tmp_path / "jpg/rain/00000.jpg").stat().st_size < 24 * 40 * 3 / 2


def test_an_occupied_place_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(ConfigError, match="not empty"):
        render_route(tmp_path, SMALL)
    with pytest.raises(ConfigError, match=r"mine\.txt"):
        render_route(tmp_path / "mine.txt", SMALL)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_run_that_is_stopped_leaves_nothing(tmp_path: Path) -> None:
    def stop(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        for number, item in enumerate(items):
            if what == "rendering rain" and number == 2:
                raise KeyboardInterrupt
            yield item

    with pytest.raises(KeyboardInterrupt):
        render_route(tmp_path / "route", SMALL, progress=stop)
    assert not list(tmp_path.iterdir())


STARTING = """
import os, sys, time
from pathlib import Path

if __name__ == "__main__":
    from everplace.render.render_config import RenderConfig
    from everplace.render.rendered_route import render_route

    config = RenderConfig(places=64, size=(24, 40), conditions=("winter",), seed=9)
    try:
        render_route(Path(sys.argv[1]) / "route", config, workers=2)
    except KeyboardInterrupt:
        sys.exit(130)
else:  # a worker, which has not come to its initializer yet
    os.write(1, b"starting\\n")
    time.sleep(1)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent in another way")
def test_ctrl_c_while_workers_start_is_answered_once(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(STARTING)
    out = tmp_path / "out"
    out.mkdir()
    command = [sys.executable, str(tmp_path / "script.py"), str(out)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "starting\n"
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "")
    assert not list(out.iterdir())


def test_ctrl_c_works_again_once_workers_are_there(rendered_by_workers: tuple[Path, list[Any]]) -> None:
    assert set(rendered_by_workers[1]) == {signal.getsignal(signal.SIGINT)}


def test_an_empty_directory_is_filled_and_progress_counts_every_frame(tmp_path: Path) -> None:
    seen: dict[str, int] = {}

    def count(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        for item in items:
            seen[what] = seen.get(what, 0) + 1
            yield item
        assert total == seen[what]

    (tmp_path / "route").mkdir()
    render_route(tmp_path / "route", SMALL, progress=count)
    assert (tmp_path / "route/route.toml").is_file()
    assert seen == {"rendering winter": 4, "rendering rain": 4}


def test_the_truth_is_clear() -> None:
    config = RenderConfig()
    world = route_world(config)
    summer, winter = (drive_poses(world, config, condition) for condition in ("summer", "winter"))
    distances = np.linalg.norm(summer[:, None, :2] - winter[None, :, :2], axis=-1)
    same = np.diagonal(distances)
    assert (distances.argmin(axis=1) == np.arange(config.places)).all()
    assert 0.2 < same.mean() < 1.2
    assert same.max() < 3
    neighbours = np.linalg.norm(np.diff(summer[:, :2], axis=0), axis=1)
    assert neighbours.min() > 10
    turn = np.degrees(summer[:, 2] - winter[:, 2])
    assert 1 < np.abs(turn).max() < 12


def _patch_normalised(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """64 × 32 grey, each 8 × 8 patch with mean 0 and deviation 1 (Milford and Wyeth 2012)."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    small = np.asarray(cv2.resize(grey, (64, 32), interpolation=cv2.INTER_AREA), np.float64)
    out = np.zeros_like(small)
    for row in range(0, 32, 8):
        for column in range(0, 64, 8):
            patch = small[row : row + 8, column : column + 8]
            out[row : row + 8, column : column + 8] = (patch - patch.mean()) / max(float(patch.std()), 1e-6)
    return out.ravel()


@pytest.mark.slow
def test_sad_fails_from_summer_to_winter() -> None:
    config = RenderConfig()
    world = route_world(config)
    features = {}
    for condition in ("summer", "winter"):
        drive, poses = open_drive(world, condition), drive_poses(world, config, condition)
        frames = [drive.frame((float(x), float(y), float(heading)), config.size) for x, y, heading in poses]
        features[condition] = np.array([_patch_normalised(frame) for frame in frames])
    for query, database in (("winter", "summer"), ("summer", "winter")):
        differences = [np.abs(features[database] - feature).mean(axis=1) for feature in features[query]]
        best = np.argmin(differences, axis=1)
        recall = (np.abs(best - np.arange(config.places)) <= 1).mean()
        chance = 3 / config.places
        assert 3 * chance < recall < 0.5, (query, recall)
