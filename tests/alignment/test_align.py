"""A rendered route whose second drive has other frame numbers is aligned in each way, and the places come back."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.alignment.align import (
    align_by_images,
    align_by_pairs,
    align_by_poses,
    judge,
)
from everplace.alignment.aligned_route import ALIGNMENT_CSV, write_aligned
from everplace.cli import main
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, RouteError
from everplace.render.render_config import RenderConfig
from everplace.render.rendered_route import render_route
from everplace.route.csv_table import read_times
from everplace.route.route import open_route

PLACES = 48


def resampled() -> NDArray[np.int64]:
    """The places that the second drive sees: it begins late, stops for a while, and misses some."""
    rng = np.random.default_rng(4)
    missed = rng.choice(np.arange(5, PLACES), 6, replace=False)
    seen = np.setdiff1d(np.arange(4, PLACES), [*missed, 20])
    return np.sort(np.concatenate([seen, np.full(7, 20)]))


SEEN = resampled()


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`summer` with 48 places, and `autumn` with the frames of `SEEN`, numbered from 0 on, with their poses."""
    base = tmp_path_factory.mktemp("drives")
    render_route(base / "rendered", RenderConfig(places=PLACES, size=(48, 96), conditions=("summer", "autumn")))
    shutil.copytree(base / "rendered/summer", base / "route/summer")
    rows = (base / "rendered/autumn/poses.csv").read_text().splitlines()
    (base / "route/autumn").mkdir()
    lines = ["stem,x,y,heading"]
    for number, place in enumerate(SEEN.tolist()):
        shutil.copy(base / f"rendered/autumn/{place:05d}.png", base / f"route/autumn/f{number}.png")
        lines.append(f"f{number},{rows[place + 1].partition(',')[2]}")
    (base / "route/autumn/poses.csv").write_text("\n".join(lines) + "\n")
    (base / "route/route.toml").write_text('radius = 6.0\n[traverses.autumn]\ncondition = "fall"\n')
    return base / "route"


def accuracy(summer: NDArray[np.int64], autumn: NDArray[np.int64]) -> tuple[float, float]:
    """How many of the places that both drives saw were found, and how many of those found are right."""
    right = SEEN[autumn] == summer
    return float(right.sum() / len(np.unique(SEEN))), float(right.mean())


def test_poses_recover_every_place(drives: Path) -> None:
    found = align_by_poses(open_route(drives), reference="summer")
    assert accuracy(found.frames["summer"], found.frames["autumn"]) == (1.0, 1.0)
    assert found.left_out == {"autumn": len(SEEN) - found.places, "summer": PLACES - found.places}
    assert found.how == "poses within 6 m"


def test_pairs_recover_places_between_them(drives: Path, tmp_path: Path) -> None:
    # A person sets a pair every few places, around what is missing, and around the stop.
    breaks = np.flatnonzero(np.diff(SEEN) != 1)
    marked = {0, len(SEEN) - 1, *range(0, len(SEEN), 6), *breaks.tolist(), *(breaks + 1).tolist()}
    marked |= {int(np.searchsorted(SEEN, 21))}
    chosen = [number for number in sorted(marked) if SEEN[number] != 20 or SEEN[number - 1] != 20]
    lines = ["summer,autumn", *(f"{SEEN[number]:05d},f{number}" for number in chosen)]
    (tmp_path / "pairs.csv").write_text("\n".join(lines) + "\n")
    found = align_by_pairs(open_route(drives), tmp_path / "pairs.csv", reference="summer")
    recall, precision = accuracy(found.frames["summer"], found.frames["autumn"])
    assert recall >= 0.95
    assert precision >= 0.8


@pytest.mark.parametrize(("method", "least"), [("hog", 0.9), ("sad", 0.8)])
def test_images_recover_the_places(drives: Path, method: str, least: float) -> None:
    found = align_by_images(open_route(drives), open_describer(method), reference="summer")
    recall, precision = accuracy(found.frames["summer"], found.frames["autumn"])
    assert recall >= least
    assert precision >= least
    assert set(found.paths) == {"autumn"}
    assert len(found.paths["autumn"].unsure) == found.places


def test_the_aligned_route_has_the_places_the_poses_and_where_they_came_from(drives: Path, tmp_path: Path) -> None:
    found = align_by_poses(open_route(drives))
    write_aligned(found, tmp_path / "aligned")
    aligned = open_route(tmp_path / "aligned")
    assert found.reference == "autumn"
    summer, autumn = aligned["summer"], aligned["fall"]
    assert summer.stems == autumn.stems
    assert aligned.radius == 6.0
    assert [path.resolve() for path in summer.paths] == [
        open_route(drives)["summer"].paths[number].resolve() for number in found.frames["summer"]
    ]
    assert summer.poses is not None
    assert autumn.poses is not None
    assert np.linalg.norm(summer.poses[:, :2] - autumn.poses[:, :2], axis=1).max() < 6
    rows = (tmp_path / "aligned" / ALIGNMENT_CSV).read_text().splitlines()
    assert rows[0] == "stem,autumn,summer"
    assert rows[1].split(",")[1:] == [
        open_route(drives)[name].stems[found.frames[name][0]] for name in ("autumn", "summer")
    ]
    assert "Aligned with" in (tmp_path / "aligned/route.toml").read_text()
    with pytest.raises(ConfigError, match="already exists and is not empty"):
        write_aligned(found, tmp_path / "aligned")


@pytest.fixture
def recorded(tiny_route: Path) -> Path:
    """Summer with 12 frames at even seconds; winter lacks two, and its frames have names of their own."""
    stems = [place for place in range(12) if place not in (3, 8)]
    for place in range(12):
        path = tiny_route / "winter" / f"{place}.png"
        path.rename(path.with_name(f"w{place}.png")) if place in stems else path.unlink()
    for drive, prefix, places in (("summer", "", list(range(12))), ("winter", "w", stems)):
        rows = [f"{prefix}{place},{2.0 * place + (drive == 'winter') / 4}" for place in reversed(places)]
        (tiny_route / drive / "times.csv").write_text("\n".join(["stem,seconds", *rows]) + "\n")
        rows = [f"{prefix}{place},{10.0 * place},0,0" for place in places]
        (tiny_route / drive / "poses.csv").write_text("\n".join(["stem,x,y,heading", *rows]) + "\n")
    lines = [f"winter,w{place},summer,{near}" for place in stems for near in (place, place + 1) if near < 12]
    (tiny_route / "truth.csv").write_text("\n".join(["query_traverse,query,database_traverse,database", *lines]) + "\n")
    (tiny_route / "route.toml").write_text('truth = "truth.csv"\naligned = false\n')
    return tiny_route


def test_times_and_pairs_come_along(recorded: Path, tmp_path: Path) -> None:
    status, _, err = command("data", "align", recorded, "--out", tmp_path / "aligned", "--by", "poses", "--radius", "1")
    assert status == 0, err
    # Of the 19 pairs, those with summer's frames 3 and 8 cannot come along.
    assert err == "everplace: 2 of 19 pairs of truth.csv were left out: a frame of theirs has no partner.\n"
    aligned = open_route(tmp_path / "aligned")
    stems = tuple(f"w{place}" for place in (0, 1, 2, 4, 5, 6, 7, 9, 10, 11))
    assert aligned["summer"].stems == aligned["winter"].stems == stems
    assert aligned.stems_are_places
    for drive, late in (("summer", 0.0), ("winter", 0.25)):
        times = read_times(tmp_path / "aligned" / drive / "times.csv", stems)
        assert times.tolist() == [2.0 * int(stem[1:]) + late for stem in stems]
    assert aligned.truth is not None
    truth = aligned.truth.matches(aligned["winter"], aligned["summer"])
    numbers = np.array([int(stem[1:]) for stem in stems])
    np.testing.assert_array_equal(truth, np.isin(numbers - numbers[:, None], (0, 1)))


def test_pairs_that_fit_no_more_are_refused(recorded: Path, tmp_path: Path) -> None:
    lines = ["query_traverse,query,database_traverse,database", "winter,w2,summer,3", "summer,8,winter,w7"]
    (recorded / "truth.csv").write_text("\n".join(lines) + "\n")
    status, _, err = command("data", "align", recorded, "--out", tmp_path / "aligned", "--by", "poses", "--radius", "1")
    assert status == 2
    assert "truth.csv is left between the aligned frames; take `truth` out of route.toml" in err
    assert not (tmp_path / "aligned").exists()
    (recorded / "route.toml").write_text("aligned = false\n")
    (recorded / "winter" / "times.csv").write_text("stem,seconds\nw0,1\n")
    status, _, err = command("data", "align", recorded, "--out", tmp_path / "aligned", "--by", "poses", "--radius", "1")
    assert status == 2
    assert "times.csv has no time for 9 of 10 frames, the first is 'w1'" in err
    assert not (tmp_path / "aligned").exists()


def test_what_cannot_be_aligned(drives: Path, tmp_path: Path) -> None:
    route = open_route(drives)
    bare = replace(route, traverses=tuple(replace(traverse, poses=None) for traverse in route.traverses))
    with pytest.raises(RouteError, match="'autumn' has no poses; put a poses.csv"):
        align_by_poses(bare)
    with pytest.raises(RouteError, match="share no place by poses within 1e-09 m; give a larger `radius`"):
        align_by_poses(route, radius=1e-9)
    with pytest.raises(RouteError, match="has one traverse only"):
        align_by_poses(route.only(["summer"]))
    with pytest.raises(RouteError, match="has no traverse or condition 'winter'"):
        align_by_poses(route, reference="winter")
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        for number in range(3):
            Image.new("L", (64, 32), 9).save(tmp_path / name / f"{number}.png")
    with pytest.raises(RouteError, match="share no place by the images' hog descriptors; align `by=poses`"):
        align_by_images(open_route(tmp_path), open_describer("hog"))


def command(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main.run([str(argument) for argument in arguments])
    return status, out.getvalue(), err.getvalue()


def test_the_command_aligns_and_draws(drives: Path, tmp_path: Path) -> None:
    picture = tmp_path / "path.png"
    status, out, err = command(
        "data", "align", drives, "--out", tmp_path / "aligned", "--by", "images", "--picture", picture, "--json"
    )
    assert status == 0, err
    result = json.loads(out)
    aligned = open_route(tmp_path / "aligned")
    assert result["places"] == len(aligned.shared_stems()) == len(aligned.traverses[0])
    assert result["left_out"] == {"autumn": len(SEEN) - result["places"], "summer": PLACES - result["places"]}
    assert result["reference"] == "autumn"
    assert ("is unsure at" in err) == (result["unsure"]["summer"] > 0)
    with Image.open(picture) as image:
        assert image.width > 500


def test_an_alignment_by_poses_can_be_looked_at_and_a_wrong_one_is_unsure(drives: Path) -> None:
    found = align_by_poses(open_route(drives), reference="summer")
    seen = judge(found, open_describer("hog"))
    assert not seen.paths["autumn"].unsure.any()
    assert seen.warnings == ()
    wrong = replace(found, frames={"summer": np.arange(15, 30), "autumn": np.arange(15)})
    judged = judge(wrong, open_describer("hog"))
    assert judged.paths["autumn"].unsure.mean() > 0.8
    (warning,) = judged.warnings
    assert warning.startswith("the path of autumn along summer is hardly better than chance")


def test_words_cannot_be_aligned_by(drives: Path) -> None:
    class Words:
        method, metric, dimension = "fabmap", "place-posterior", 3

    route, message = open_route(drives), "`method` fabmap gives words, which cannot be centred; choose hog"
    with pytest.raises(ConfigError, match=message):
        align_by_images(route, Words())  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=message):
        judge(align_by_poses(route), Words())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--by", "luck"], "Invalid value for '--by': 'luck' is not one of 'poses', 'pairs', 'images'"),
        (["--by", "pairs"], "--by pairs and --pairs FILE.csv go together"),
        (["--by", "poses", "--pairs", "x.csv"], "--by pairs and --pairs FILE.csv go together"),
        (["--by", "images", "--radius", "3"], "--radius is of no use with --by images"),
        (["--by", "poses", "--picture", "x.txt"], "must end in .png"),
        (["--by", "poses", "--radius", "-2"], "--radius -2.0 is not a positive number of metres"),
        (["--by", "images", "--method", "nothing"], "there is no method or run directory 'nothing'"),
        (["--by", "pairs", "--pairs", "gone.csv"], "cannot read gone.csv"),
    ],
)
def test_mistakes_are_one_sentence(drives: Path, tmp_path: Path, options: Iterable[str], message: str) -> None:
    status, out, err = command("data", "align", drives, "--out", tmp_path / "aligned", *options)
    assert (status, out) == (2, "")
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "aligned").exists()


def test_an_aligned_route_says_by_what_it_was_aligned(recorded: Path, tmp_path: Path) -> None:
    (recorded / "route.toml").write_text("aligned = false\n")
    pairs = tmp_path / "pairs.csv"
    pairs.write_text("summer,winter\n0,w0\n11,w11\n")
    drives = open_route(recorded)
    ways = {
        "images": align_by_images(drives, open_describer("hog")),
        "poses": align_by_poses(drives, radius=1.0),
        "pairs": align_by_pairs(drives, pairs),
    }
    told = {}
    for name, alignment in ways.items():
        write_aligned(alignment, tmp_path / name)
        route = open_route(tmp_path / name)
        told[name] = (route.truth_origin, route.aligned_by)
    assert told == {
        "images": ("an alignment by the images' hog descriptors", "hog"),
        "poses": ("an alignment by poses within 1 m", None),
        "pairs": (f"an alignment by pairs of {pairs}", None),
    }


def test_a_truth_of_its_own_keeps_its_origin_in_an_aligned_route(recorded: Path, tmp_path: Path) -> None:
    (recorded / "route.toml").write_text('truth = "truth.csv"\ntruth_from = "pairs set by hand"\n')
    write_aligned(align_by_images(open_route(recorded), open_describer("hog")), tmp_path / "aligned")
    route = open_route(tmp_path / "aligned")
    assert (route.truth_origin, route.aligned_by) == ("pairs set by hand", "hog")
