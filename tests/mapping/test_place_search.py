"""Scores of all places, most of them not looked at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.mapping.drives import images_of

from everplace.mapping import place_search
from everplace.mapping.calibration import PROVISIONAL, place_posterior
from everplace.mapping.frame_graph import FrameGraph
from everplace.mapping.frame_window import MAP_MODEL
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import MapAnswer
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.place_search import PlaceSearch
from everplace.mapping.route_map import Map
from everplace.sequences.evidence import likelihood_ratios, standardised
from everplace.sequences.frame_change import View, change_in_steps

PLACES, DRIVES, NUMBERS = 8000, 3, 48


def unit(values: NDArray[np.floating]) -> NDArray[np.float32]:
    found: NDArray[np.float32] = (values / np.linalg.norm(values, axis=-1, keepdims=True)).astype(np.float32)
    return found


class Large:
    """A route on which neighbouring places look alike, driven three times; the last drive saw one half of it."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        views = rng.normal(size=(PLACES, NUMBERS))
        for place in range(1, PLACES):
            views[place] = 0.85 * views[place - 1] + np.sqrt(1 - 0.85**2) * views[place]
        views *= np.arange(1, NUMBERS + 1) ** -0.3
        self.views, self.rng = views, rng
        places = np.concatenate([np.arange(PLACES), np.arange(PLACES), np.arange(PLACES // 2)])
        self.order = PlaceFrames(places, places.astype(float))
        self.vectors = unit(self.seen(places[self.order.rows], 0.5))
        self.drives = np.repeat([0, 1, 2], [PLACES, PLACES, PLACES // 2])[self.order.rows]

    def seen(self, places: NDArray[np.int64], noise: float) -> NDArray[np.float64]:
        shape = (len(places), NUMBERS)
        found: NDArray[np.float64] = self.views[places] + noise * self.views.std() * self.rng.normal(size=shape)
        return found


@pytest.fixture(scope="module")
def large() -> Large:
    return Large()


@pytest.fixture(scope="module")
def searches(large: Large) -> tuple[PlaceSearch, PlaceSearch]:
    """The exact one, and the other."""
    graph = FrameGraph.build(large.vectors)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place_search, "_SAMPLED", 2048)
        return PlaceSearch(large.vectors, large.order), PlaceSearch(large.vectors, large.order, graph)


def queries(large: Large, kind: str) -> NDArray[np.float32]:
    if kind == "elsewhere":
        return unit(large.rng.normal(size=(60, NUMBERS)) * np.arange(1, NUMBERS + 1) ** -0.3)
    noise = {"clear": 0.5, "poor": 1.5}[kind]
    return unit(large.seen(large.rng.integers(0, PLACES, 60), noise))


@pytest.mark.parametrize("kind", ["clear", "poor", "elsewhere"])
@pytest.mark.parametrize("left_out", [False, True], ids=["all", "some left out"])
def test_probabilities_are_those_of_an_exact_search(
    large: Large, searches: tuple[PlaceSearch, PlaceSearch], kind: str, left_out: bool
) -> None:
    exact, graph = searches
    near, off = [], []
    for vector in queries(large, kind):
        hidden = None
        if left_out:
            best = int((large.vectors @ vector).argmax())
            hidden = (large.drives == large.drives[best]) & (np.abs(np.arange(len(large.drives)) - best) < 400)
        there = [search.scores(vector, hidden) for search in (exact, graph)]
        (wanted, wanted_off), (found, found_off) = (place_posterior(one.places, PROVISIONAL) for one in there)
        assert found.sum() + found_off == pytest.approx(1)
        assert np.array_equal(np.isnan(there[0].places), np.isnan(there[1].places))
        assert int(found.argmax()) == int(wanted.argmax())
        near.append(np.abs(found - wanted).max())
        off.append(abs(float(found_off - wanted_off)))
        best_exact, best_graph = (
            search.best_frame(vector, one, int(wanted.argmax()), hidden)
            for search, one in zip((exact, graph), there, strict=True)
        )
        assert best_exact[0] == best_graph[0]
        assert best_exact[1] == pytest.approx(best_graph[1], abs=1e-6)
    assert np.mean(near) <= 0.01
    assert max(near) <= 0.06
    assert np.mean(off) <= 0.015
    assert max(off) <= 0.06


def test_the_scores_that_count_are_exact(large: Large, searches: tuple[PlaceSearch, PlaceSearch]) -> None:
    exact, graph = searches
    recall = []
    for vector in queries(large, "poor"):
        wanted, found = exact.scores(vector).places, graph.scores(vector).places
        best = np.argsort(-wanted)[:10]
        recall.append(np.isclose(found[best], wanted[best], atol=1e-6).mean())
        assert found.mean() == pytest.approx(wanted.mean(), abs=0.05 * float(wanted.std()))
        assert found.std() == pytest.approx(wanted.std(), rel=0.06)
    assert np.mean(recall) >= 0.99


def test_a_stop_and_a_step_are_told_apart_as_by_an_exact_search(
    large: Large, searches: tuple[PlaceSearch, PlaceSearch]
) -> None:
    places = np.arange(3000, 3030)
    drive = unit(large.seen(places, 0.5))
    halt = unit(drive[:1] + 0.002 * large.rng.normal(size=(30, NUMBERS)))

    def changes(search: PlaceSearch, frames: NDArray[np.float32]) -> NDArray[np.float64]:
        views = [View.of(likelihood_ratios(standardised(search.scores(one).places), MAP_MODEL)) for one in frames]
        return np.array([change_in_steps(views[0], view) for view in views[1:]])

    for search in searches:
        assert (changes(search, halt) < MAP_MODEL.repeat).all()
        assert (changes(search, drive) > 0.3).all()


def test_nothing_is_left(large: Large, searches: tuple[PlaceSearch, PlaceSearch]) -> None:
    for search in searches:
        (vector,) = queries(large, "clear")[:1]
        nothing = np.ones(len(large.vectors), np.bool_)
        found = search.scores(vector, nothing)
        assert np.isnan(found.places).all()
        assert search.best_frame(vector, found, 5, nothing)[1] == -np.inf


def answers(map_: Path, images: list[NDArray[np.uint8]], sequence: int) -> list[MapAnswer]:
    localizer = Localizer(map_, sequence=sequence)
    return [
        localizer.locate(image, excluded=("winter", number, 5) if number % 2 else None)
        for number, image in enumerate(images)
    ]


@pytest.mark.parametrize("sequence", [1, 10])
def test_a_localizer_answers_alike_from_a_graph(
    three_map: Path, unchanged_rendered_route: Path, monkeypatch: pytest.MonkeyPatch, sequence: int
) -> None:
    images = images_of(unchanged_rendered_route / "winter")[:40]
    exact = answers(three_map, images, sequence)
    assert not (three_map / "graph").exists()
    monkeypatch.setattr(place_search, "EXACT_BELOW", 100)
    monkeypatch.setattr(place_search, "_CANDIDATES", 40)
    for one, other in zip(answers(three_map, images, sequence), exact, strict=True):
        assert (one.place, one.drive, one.database_frame) == (other.place, other.drive, other.database_frame)
        assert one.score == pytest.approx(other.score, abs=1e-5)
        assert one.probability == pytest.approx(other.probability, abs=0.02)
        assert one.off_map == pytest.approx(other.off_map, abs=0.02)
    assert len(list((three_map / "graph").iterdir())) == 1


def test_a_graph_is_of_the_newest_version_and_moves_with_the_map(
    three_map: Path, unchanged_rendered_route: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(place_search, "EXACT_BELOW", 50)
    Localizer(three_map)
    (first,) = (three_map / "graph").iterdir()
    Localizer(Map.open(three_map, 1))
    assert list((three_map / "graph").iterdir()) == [first]
    Map.open(three_map).remove("winter")
    assert first.exists()  # nobody has asked yet
    Localizer(three_map)
    (second,) = (three_map / "graph").iterdir()
    assert second != first
    assert Map.open(three_map).verify() == []
    moved = three_map.rename(three_map.with_name("moved"))
    changed = (moved / "graph" / second.name).stat().st_mtime_ns
    Localizer(moved)
    assert (moved / "graph" / second.name).stat().st_mtime_ns == changed
