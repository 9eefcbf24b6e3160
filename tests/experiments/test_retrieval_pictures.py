"""The gallery of matches: which frame it shows as the true one."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.text import Text

from everplace.describe.registry import open_describer
from everplace.experiments.retrieval_pictures import match_figure, matrix_figure
from everplace.match.matching import Matching
from everplace.route.route import open_route
from everplace.scoring.retrieval import MatchRule, Pair, Retrieval, retrieve, retrieve_pair


def shown_as_true(result: Retrieval) -> dict[str, str]:
    """The names below the true frames, by those below their queries."""
    axes = match_figure(result, "sad", count=2 * len(result.query)).axes[0]
    names = [text.get_text().split("/") for text in axes.texts if "/" in text.get_text()]
    triples = [names[start : start + 3] for start in range(0, len(names), 3)]
    return {query[1]: true[1] for query, _, true in triples}


def every_frame(root: Path, truth: MatchRule) -> Retrieval:
    """SAD on all frames of winter and summer, also those of places that the other one has not."""
    route = open_route(root)
    return retrieve_pair(Pair(route, route["winter"], route["summer"]), open_describer("sad"), truth, Matching())


@pytest.mark.parametrize("tolerance", [0, 1, 4])
def test_the_very_place_is_shown_whatever_the_tolerance(tiny_route: Path, tolerance: int) -> None:
    result = retrieve(open_route(tiny_route), "winter", "summer", "sad", tolerance=tolerance)
    assert shown_as_true(result) == {str(place): str(place) for place in range(12)}


def test_a_place_that_was_left_out_has_the_nearest_one_along_the_route(tiny_route: Path) -> None:
    for missing in (4, 5, 11):
        (tiny_route / "summer" / f"{missing}.png").unlink()
    shown = shown_as_true(every_frame(tiny_route, MatchRule(4)))
    assert (shown["4"], shown["5"], shown["11"]) == ("3", "6", "10")
    assert shown["6"] == "6"


def test_without_common_stems_the_nearest_pose_is_shown(tiny_route: Path) -> None:
    for path in list((tiny_route / "winter").iterdir()):
        path.rename(path.with_name(f"q{path.name}"))
    for traverse, prefix, ahead in (("summer", "", 0.0), ("winter", "q", 22.0)):
        rows = "".join(f"{prefix}{place},{10.0 * place + ahead},0,0\n" for place in range(12))
        (tiny_route / traverse / "poses.csv").write_text(f"stem,x,y,heading\n{rows}")
    shown = shown_as_true(every_frame(tiny_route, MatchRule(radius=45.0)))
    assert shown == {f"q{place}": str(min(place + 2, 11)) for place in range(12)}


def test_the_matrix_names_query_database_and_frames(tiny_route: Path) -> None:
    result = every_frame(tiny_route, MatchRule(0))
    figure = matrix_figure(result, "SAD")
    axes = figure.axes[0]
    said = {text.get_text() for text in figure.findobj(Text)}
    assert {"SAD: query winter, database summer", "right: within ±0 frames"} < said
    assert "negative mean absolute difference" in said
    assert (axes.get_ylabel(), axes.get_xlabel()) == ("frame of query winter", "frame of database summer")
    for side in (axes.yaxis, axes.xaxis):
        ticks = zip(side.get_ticklocs(), side.get_ticklabels(), strict=True)
        assert all(text.get_text() == result.query.stems[int(place)] for place, text in ticks)


def test_where_nothing_tells_the_nearest_it_is_the_middle_one(tiny_route: Path) -> None:
    for path in list((tiny_route / "winter").iterdir()):
        path.rename(path.with_name(f"q{path.name}"))
    (tiny_route / "truth.csv").write_text(
        "query_traverse,query,database_traverse,database\n"
        + "".join(f"winter,q{place},summer,{right}\n" for place in range(12) for right in (3, 4, 5))
    )
    (tiny_route / "route.toml").write_text('truth = "truth.csv"\n')
    assert set(shown_as_true(every_frame(tiny_route, MatchRule())).values()) == {"4"}


@pytest.mark.parametrize("count", [3, 8, 40])
def test_without_a_truth_the_best_matches_are_shown_with_their_scores(tiny_route: Path, count: int) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    result = every_frame(tiny_route, MatchRule())
    texts = [text.get_text() for text in match_figure(result, "SAD", count=count).axes[0].texts]
    assert "what is right is not known; number: negative mean absolute difference" in texts
    best = result.similarity.argmax(axis=1)
    chosen = [index for index in range(12) if f"winter/{result.query.stems[index]}" in texts]
    assert (chosen[0], chosen[-1], len(chosen)) == (0, 11, min(count, 12))
    for index in chosen:
        assert f"summer/{result.database.stems[best[index]]}" in texts
        assert f"{result.similarity[index, best[index]]:.3f}" in texts


def test_without_a_truth_the_matrix_marks_the_best_matches_alone(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    result = every_frame(tiny_route, MatchRule())
    axes = matrix_figure(result, "SAD").axes[0]
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["best match"]
    (marks,) = axes.lines
    assert marks.get_xdata().tolist() == result.similarity.argmax(axis=1).tolist()  # type: ignore[union-attr]
    assert "what is right is not known" in {text.get_text() for text in axes.texts}
