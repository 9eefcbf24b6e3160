"""Adapting to a route: from one drive, aligned drives, and drives that are matched; and what is refused."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import everplace as ep
from everplace.adaptation.drive_statistics import half_differences
from everplace.adaptation.moments import Moments
from everplace.adaptation.place_weights import place_weights
from everplace.adaptation.prior import Prior, load_prior, write_prior
from everplace.describe.files.descriptors import Descriptors
from everplace.errors import CheckpointError, ConfigError, EverplaceError, MethodError, RouteError
from everplace.mapping.route_learning import Learning, adapt, drive_statistics, light_moments
from everplace.mapping.self_teaching import SurePairs
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, parse_frames


@pytest.fixture(scope="session")
def route(rendered_route: Path) -> Route:
    return open_route(rendered_route)


def recall(route: Route, method: Any, frames: str = "70:") -> float:
    selection = Selection(parse_frames(frames))
    scores = ep.retrieve(route, "winter", "summer", method, selection=selection).scores
    assert scores is not None
    return scores.recall_at[1]


@pytest.mark.slow
def test_one_drive_then_a_later_one_make_it_better(route: Route, tmp_path: Path) -> None:
    one = adapt("hog16", route.choose(["summer"]), tmp_path / "one", prior="none", dimensions=48)
    taught = adapt(
        "hog16", route, tmp_path / "taught", prior="none", dimensions=48, self_taught=True, teach_frames=slice(0, 60)
    )
    aligned = adapt("hog16", route, prior="none", dimensions=48, teach_frames=slice(0, 60))
    plain, alone = recall(route, "hog16"), recall(route, str(tmp_path / "one"))
    by_itself, by_names = recall(route, str(tmp_path / "taught")), recall(route, aligned.describer)
    assert plain - 0.02 <= alone <= by_itself
    assert by_names - 0.05 <= by_itself
    (drive,) = taught.drives
    assert (drive.name, drive.pairs.of) == ("winter", 60)
    assert drive.pairs.share > 0.5
    assert drive.right is not None
    assert drive.right > 0.95
    assert taught.describer.seen_stems == {route["winter"].stems[frame] for frame in drive.pairs.frames}
    assert (one.describer.seen_stems, one.drives) == (frozenset(), ())
    assert [found.right for found in aligned.drives] == [None]
    assert (aligned.drives[0].pairs.places == np.arange(60)).all()
    assert taught.summary()["drives"] == [
        {"name": "winter", "frames": 60, "pairs": len(drive.pairs.frames), "share": round(drive.pairs.share, 4),
         "right": drive.right}
    ]  # fmt: skip
    told = json.loads((tmp_path / "taught" / "pairs.json").read_text())
    assert (told["map"], len(told["drives"][0]["matches"])) == ("summer", 60)
    assert sum(row["sure"] for row in told["drives"][0]["matches"]) == len(drive.pairs.frames)
    assert (
        f"{len(drive.pairs.frames)} ({drive.pairs.share:.0%}) found"
        in (tmp_path / "taught" / "report.html").read_text()
    )
    assert not (tmp_path / "one" / "report.html").exists()
    run = ep.load(tmp_path / "taught")
    assert run.settings() == taught.describer.settings()
    frames = route["winter"][:3]
    np.testing.assert_array_equal(run.describe(frames).values, taught.describer.describe(frames).values)


@pytest.mark.slow
def test_names_are_ignored_where_it_teaches_itself(route: Route) -> None:
    both = replace(route, traverses=(route["summer"], route["winter"][20:80]))
    taught = adapt("hog16", both, prior="none", dimensions=16, self_taught=True)
    assert taught.settings["frames"] == 120, "the map is whole"
    assert taught.drives[0].pairs.of == 60
    assert np.abs(taught.drives[0].pairs.places - taught.drives[0].pairs.frames - 20).max() <= 1


@pytest.mark.slow
def test_without_an_alignment_nothing_is_matched_by_name(route: Route) -> None:
    unaligned = replace(route, stems_are_places=False)
    with pytest.raises(RouteError, match=r"are not aligned.*everplace data align.*`self_taught`"):
        adapt("hog16", unaligned)
    taught = adapt("hog16", unaligned, prior="none", dimensions=8, self_taught=True, teach_frames=slice(0, 40))
    assert taught.drives[0].right is None


def test_drives_that_share_no_name_are_one_sentence(route: Route, tmp_path: Path) -> None:
    shutil.copytree(route.root / "summer", tmp_path / "r" / "summer")
    (tmp_path / "r" / "winter").mkdir()
    for frame in route["winter"][:20]:
        shutil.copy(frame.path, tmp_path / "r" / "winter" / f"w{frame.stem}.png")
    with pytest.raises(RouteError, match=r"share no stem; find the same places.*`self_taught`"):
        adapt("hog16", open_route(tmp_path / "r"))


@pytest.mark.slow
def test_a_prior_is_saved_used_and_told(route: Route, tmp_path: Path) -> None:
    summer = route.choose(["summer"])
    adapt("hog16", route, prior="none", dimensions=4, save_prior=tmp_path / "w0")
    saved = load_prior(tmp_path / "w0")
    assert (saved.method, saved.directions.shape) == ("hog16", (256, 2048))
    found = adapt("hog16", summer, prior=tmp_path / "w0", dimensions=4)
    assert (found.prior, found.settings["prior"]) == (str(tmp_path / "w0"), str(tmp_path / "w0"))
    default, none = (adapt("hog16", summer, prior=prior, dimensions=4) for prior in ("default", "none"))
    assert (default.prior, none.prior) == ("shipped", "none")
    assert none.settings["prior_weight"] == 0
    weights = [one.describer.projection.weight for one in (found, default, none)]
    assert all(np.abs(first - second).max() > 1e-3 for first, second in pairwise(weights))


@pytest.mark.slow
def test_where_no_prior_ships_default_is_none(route: Route) -> None:
    found = adapt("hog", route.choose(["summer"]), dimensions=3, selection=Selection(slice(0, 12)))
    assert found.prior == "none"


@pytest.mark.slow
def test_dimensions_end_with_the_places_less_one(route: Route) -> None:
    few = Selection(slice(0, 9))
    found = adapt("hog16", route.choose(["summer"]), dimensions=96, selection=few)
    assert (found.describer.dimension, found.settings["places"]) == (8, 9)


def refused(kind: type[EverplaceError], says: str, *given: Any, **options: Any) -> None:
    with pytest.raises(kind, match=says) as caught:
        adapt(*given, **options)
    assert "\n" not in str(caught.value)


def test_what_cannot_be_is_one_sentence_and_leaves_nothing(route: Route, tmp_path: Path) -> None:
    summer, out = route.choose(["summer"]), tmp_path / "out"
    refused(ConfigError, "`dimensions` 0 is not possible", "hog16", summer, out, dimensions=0)
    refused(RouteError, "has 2 frames; .* 3 or more", "hog16", summer, out, selection=Selection(slice(0, 2)))
    refused(RouteError, "`self_taught` wants a drive beside the map 'summer'", "hog16", summer, out, self_taught=True)
    refused(RouteError, "`teach_frames` wants a drive beside the map", "hog16", summer, out, teach_frames=slice(0, 5))
    refused(
        RouteError, "no frame of 'winter' is left.*`teach_frames`", "hog16", route, out, teach_frames=slice(500, None)
    )
    refused(MethodError, "there is no method", "hog17", summer, out)
    refused(MethodError, "cannot be joined", "hog16+sad", summer, out)
    refused(CheckpointError, "cannot be read", "hog16", summer, out, prior=tmp_path / "none")
    write_prior(tmp_path / "w0", Prior.of(np.diag(np.arange(1.0, 21)), "hog", {}))
    refused(ConfigError, "the prior is of the method hog", "hog16", summer, out, prior=tmp_path / "w0")
    (tmp_path / "w1").write_bytes((tmp_path / "w0").read_bytes()[:-9])
    refused(CheckpointError, "or it is damaged", "hog16", summer, out, prior=tmp_path / "w1")
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "kept").write_text("x")
    refused(ConfigError, "already exists and is not empty", "hog16", summer, tmp_path / "used")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["used", "w0", "w1"]


def described(values: np.ndarray[Any, np.dtype[np.float32]]) -> Descriptors:
    return Descriptors(values, tuple(map(str, range(len(values)))), "m")


def pairs_of(frames: list[int], places: list[int], of: int) -> SurePairs:
    return SurePairs(np.array(frames), np.array(places), np.full(len(frames), 9, np.float32), of)


@given(seed=st.integers(0, 2**31))
@settings(max_examples=10, deadline=None)
def test_drives_are_learnt_from_in_any_order_and_pairs_weigh_a_place_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = [rng.normal(size=(count, 60)).astype(np.float32) for count in (20, 12, 15)]
    map_drive, *drives = map(described, values)
    pairs = [pairs_of([0, 1, 2, 3], [5, 5, 5, 6], 12), pairs_of([4, 9], [1, 2], 15)]
    base = drive_statistics(map_drive.values)
    learning = Learning(base, map_drive, drives, 3, None)
    swapped = Learning(base, map_drive, drives[::-1], 3, None)
    differences, weights = learning.changes(pairs)
    products = Moments.of(differences, weights).products
    np.testing.assert_allclose(Moments.of(*swapped.changes(pairs[::-1])).products, products, atol=1e-9)
    assert weights == pytest.approx([1 / 3, 1 / 3, 1 / 3, 1, 1, 1])
    wanted = half_differences(np.concatenate([values[1][:4], values[2][[4, 9]]]), values[0][[5, 5, 5, 6, 1, 2]])
    np.testing.assert_array_equal(differences, wanted)
    np.testing.assert_allclose(products, Moments.of(wanted, weights).products)
    np.testing.assert_allclose(base.places.covariance(), np.cov(values[0].T.astype(float), ddof=0), atol=1e-6)
    first, second = (one.solved(two)[0] for one, two in ((learning, pairs), (swapped, pairs[::-1])))
    np.testing.assert_allclose(np.abs(first.weight), np.abs(second.weight), atol=1e-6)


def test_other_light_is_of_frames_spread_over_the_drive(route: Route) -> None:
    hog16 = ep.load("hog16")
    few = route["summer"][:10]
    found = light_moments(hog16, few)
    assert found.weight == 70
    assert np.trace(found.second_moment()) > 0
    again = light_moments(hog16, few)
    np.testing.assert_array_equal(again.products, found.products)


def test_the_map_is_weighted_by_its_places(route: Route) -> None:
    values = ep.load("hog16").describe(route["summer"][:20]).values
    stopped = np.concatenate([values[:5], np.repeat(values[5:6], 30, axis=0), values[6:]])
    assert place_weights(stopped).sum() == pytest.approx(drive_statistics(values).places.weight)
    np.testing.assert_allclose(
        drive_statistics(stopped).places.covariance(), drive_statistics(values).places.covariance(), atol=1e-6
    )
