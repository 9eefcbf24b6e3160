"""The gallery of matches: which frame it shows as the true one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.describe.registry import open_describer
from everplace.experiments.retrieval_pictures import match_figure, matrix_figure
from everplace.route.route import open_route
from everplace.route.selection import Selection
from everplace.scoring.retrieval import Matching, Pair, Truth, choose_pair, retrieve, true_matches


def shown_as_true(pair: Pair, truth: NDArray[np.bool_]) -> dict[str, str]:
    """The names below the true frames, by those below their queries."""
    result = retrieve(open_describer("sad"), pair, truth, Matching(), ms_per_image=1.0)
    axes = match_figure(pair, result, count=2 * len(pair.query)).axes[0]
    names = [text.get_text().split("/") for text in axes.texts if "/" in text.get_text()]
    triples = [names[start : start + 3] for start in range(0, len(names), 3)]
    return {query[1]: true[1] for query, _, true in triples}


@pytest.mark.parametrize("tolerance", [0, 1, 4])
def test_the_very_place_is_shown_whatever_the_tolerance(tiny_route: Path, tolerance: int) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    truth = true_matches(chosen, pair, Truth(tolerance))[0]
    assert shown_as_true(pair, truth) == {str(place): str(place) for place in range(12)}


def test_a_place_that_was_left_out_has_the_nearest_one_along_the_route(tiny_route: Path) -> None:
    for missing in (4, 5, 11):
        (tiny_route / "summer" / f"{missing}.png").unlink()
    route = open_route(tiny_route)
    pair = Pair(route["winter"], route["summer"])
    shown = shown_as_true(pair, true_matches(route, pair, Truth(4))[0])
    assert (shown["4"], shown["5"], shown["11"]) == ("3", "6", "10")
    assert shown["6"] == "6"


def test_without_common_stems_the_nearest_pose_is_shown(tiny_route: Path) -> None:
    for path in list((tiny_route / "winter").iterdir()):
        path.rename(path.with_name(f"q{path.name}"))
    for traverse, prefix, ahead in (("summer", "", 0.0), ("winter", "q", 22.0)):
        rows = "".join(f"{prefix}{place},{10.0 * place + ahead},0,0\n" for place in range(12))
        (tiny_route / traverse / "poses.csv").write_text(f"stem,x,y,heading\n{rows}")
    route = open_route(tiny_route)
    pair = Pair(route["winter"], route["summer"])
    shown = shown_as_true(pair, true_matches(route, pair, Truth(radius=45.0))[0])
    assert shown == {f"q{place}": str(min(place + 2, 11)) for place in range(12)}


def test_the_matrix_names_query_database_and_frames(tiny_route: Path) -> None:
    route = open_route(tiny_route)
    pair = Pair(route["winter"], route["summer"])
    result = retrieve(open_describer("sad"), pair, np.eye(12, dtype=bool), Matching(), ms_per_image=1.0)
    axes = matrix_figure(pair, result, title="t", note="n", score="s").axes[0]
    assert (axes.get_ylabel(), axes.get_xlabel()) == ("frame of query winter", "frame of database summer")
    for side in (axes.yaxis, axes.xaxis):
        ticks = zip(side.get_ticklocs(), side.get_ticklabels(), strict=True)
        assert all(text.get_text() == pair.query.stems[int(place)] for place, text in ticks)


def test_where_nothing_tells_the_nearest_it_is_the_middle_one(tiny_route: Path) -> None:
    for path in list((tiny_route / "winter").iterdir()):
        path.rename(path.with_name(f"q{path.name}"))
    route = open_route(tiny_route)
    pair = Pair(route["winter"], route["summer"])
    truth = np.zeros((12, 12), dtype=np.bool_)
    truth[:, 3:6] = True
    assert set(shown_as_true(pair, truth).values()) == {"4"}
