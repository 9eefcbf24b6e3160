"""Choosing a pair, its truth, and one method on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, RouteError
from everplace.experiments.comparison import compare_methods
from everplace.experiments.comparison_methods import Methods, select_tested
from everplace.experiments.comparison_report import write_comparison
from everplace.experiments.evaluation import evaluate_retrieval
from everplace.experiments.evaluation_report import write_evaluation
from everplace.experiments.manifest import open_study
from everplace.match.matching import Matching
from everplace.match.similarity import similarity
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.route.route import open_route
from everplace.route.selection import Selection, select
from everplace.route.truth import truth_by_position
from everplace.scoring.retrieval import MatchRule, choose_pair, retrieve, retrieve_pair, true_matches
from everplace.scoring.scores import evaluate


def test_a_pair_is_restricted_to_the_places_that_take_part(tiny_route: Path) -> None:
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection(slice(2, 7)))
    assert pair.query.name == "winter"
    assert pair.database.name == "summer"
    assert pair.query.stems == pair.database.stems == ("2", "3", "4", "5", "6")
    assert {traverse.name for traverse in pair.route.traverses} == {"summer", "winter"}


def test_a_traverse_can_be_compared_with_itself(tiny_route: Path) -> None:
    result = retrieve(open_route(tiny_route), "summer", "summer", "hog")
    assert result.scores is not None
    assert result.scores.recall_at["1"] == 1.0
    assert "every frame finds itself" in result.pair.warning
    assert not retrieve(open_route(tiny_route), "winter", "summer", "hog").pair.warning


def test_a_route_two_traverses_and_a_method_give_scores_curve_and_matrix(tiny_route: Path) -> None:
    result = retrieve(open_route(tiny_route), "winter", "summer", "hog", selection=Selection(slice(2, None)))
    places = tuple(str(place) for place in range(2, 12))
    assert (result.query.name, result.query.stems) == ("winter", places)
    assert (result.database.name, result.database.stems) == ("summer", places)
    described = [open_describer("hog").describe(one) for one in (result.query, result.database)]
    np.testing.assert_array_equal(result.similarity, similarity(*described))
    np.testing.assert_array_equal(result.truth, truth_by_position(result.query, result.database, 1))
    assert result.truth is not None
    assert result.curve is not None
    assert result.scores == evaluate(result.similarity, result.truth)
    assert result.curve.area == result.scores.auc_pr


def test_an_opened_method_is_as_good_as_its_name(tiny_route: Path) -> None:
    route = open_route(tiny_route)
    named, given = (retrieve(route, "winter", "summer", method) for method in ("sad", open_describer("sad")))
    np.testing.assert_array_equal(named.similarity, given.similarity)
    assert given.scores == named.scores


def test_the_truth_of_a_retrieval_is_the_given_one_or_the_routes(tiny_route: Path) -> None:
    route = replace(open_route(tiny_route), tolerance=3)
    assert retrieve(route, "winter", "summer", "sad").rule == MatchRule(3)
    assert retrieve(route, "winter", "summer", "sad", tolerance=0).rule == MatchRule(0)
    with pytest.raises(RouteError, match="poses"):
        retrieve(route, "winter", "summer", "sad", radius=5.0)


def test_an_unknown_condition_is_named(tiny_route: Path) -> None:
    with pytest.raises(RouteError, match="autumn"):
        choose_pair(open_route(tiny_route), "autumn", "summer", Selection())


def test_the_truth_comes_from_the_option_then_the_route_then_one_frame(tiny_route: Path) -> None:
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    assert true_matches(pair, MatchRule())[1] == MatchRule(1)
    wider = replace(pair, route=replace(pair.route, tolerance=3))
    assert true_matches(wider, MatchRule())[1] == MatchRule(3)
    matches, truth = true_matches(wider, MatchRule(0))
    assert truth == MatchRule(0)
    np.testing.assert_array_equal(matches, np.eye(12, dtype=bool))


def test_two_truths_at_once_are_refused(tiny_route: Path) -> None:
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    with pytest.raises(ConfigError, match="`radius`"):
        true_matches(pair, MatchRule(1, 5.0))


def test_a_radius_uses_poses(tiny_route: Path) -> None:
    for traverse in ("summer", "winter"):
        rows = [f"{place},{10.0 * place},0,0" for place in range(12)]
        (tiny_route / traverse / "poses.csv").write_text("stem,x,y,heading\n" + "\n".join(rows) + "\n")
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    matches, truth = true_matches(pair, MatchRule(radius=15.0))
    assert str(truth) == "within 15 m"
    places = np.arange(12)
    np.testing.assert_array_equal(matches, np.abs(places[:, None] - places) <= 1)


def test_standardisation_and_sequences_change_the_match(tiny_route: Path) -> None:
    route = open_route(tiny_route)
    plain, centred, alone = (
        retrieve(route, "winter", "summer", "hog", matching=matching)
        for matching in (Matching(), Matching("centre", 3, "mean"), Matching("centre"))
    )
    assert np.abs(plain.similarity - centred.similarity).max() > 0.01
    # The first frame of a sequence has no past: its row is that of the centred match alone.
    np.testing.assert_allclose(centred.similarity[0], alone.similarity[0])
    np.testing.assert_allclose(centred.similarity[2, 2], np.mean([alone.similarity[k, k] for k in range(3)]), rtol=1e-5)
    assert str(Matching("centre", 3)) == "standardised (centre), sequences of 3 (filter, stops not counted)"


def test_descriptors_made_before_are_used_again(tiny_route: Path) -> None:
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    hog = open_describer("hog")
    described = {one.name: hog.describe(one) for one in (pair.query, pair.database)}
    new = retrieve_pair(pair, hog, MatchRule(), Matching())
    used = retrieve_pair(pair, hog, MatchRule(), Matching(), described=described)
    np.testing.assert_array_equal(new.similarity, used.similarity)
    winter = described["winter"]
    turned = {**described, "winter": replace(winter, values=winter.values[::-1].copy())}
    other = retrieve_pair(pair, hog, MatchRule(), Matching(), described=turned)
    np.testing.assert_array_equal(other.similarity, used.similarity[::-1])


def test_stems_that_are_no_places_tell_no_truth_but_poses_do(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    for traverse in ("summer", "winter"):
        rows = [f"{place},{10.0 * place},0,0" for place in range(12)]
        (tiny_route / traverse / "poses.csv").write_text("stem,x,y,heading\n" + "\n".join(rows) + "\n")
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    with pytest.raises(RouteError, match=r"are not aligned, as route.toml says \(aligned = false\), so nobody knows"):
        true_matches(pair, MatchRule())
    np.testing.assert_array_equal(true_matches(pair, MatchRule(radius=1.0))[0], np.eye(12, dtype=bool))
    pair = choose_pair(open_route(tiny_route), "winter", "winter", Selection())
    np.testing.assert_array_equal(true_matches(pair, MatchRule(0))[0], np.eye(12, dtype=bool))


def unaligned(root: Path, how: str) -> None:
    """Makes a route of which nothing says what frames show the same place, in one of the ways that occur."""
    if how == "denied":
        (root / "route.toml").write_text("aligned = false\n")
    else:
        rename(root / "winter", "q")
    if how == "posed":  # but without a radius, which would make a truth of them
        for traverse in ("summer", "winter"):
            pose(root / traverse, 10.0)


@pytest.mark.parametrize("how", ["named apart", "denied", "posed"])
@pytest.mark.parametrize("tolerance", [None, 0, 3])
def test_drives_that_are_not_aligned_get_matches_and_no_scores(
    tiny_route: Path, how: str, tolerance: int | None
) -> None:
    same = retrieve(open_route(tiny_route), "winter", "summer", "hog")
    unaligned(tiny_route, how)
    found = retrieve(open_route(tiny_route), "winter", "summer", "hog", tolerance=tolerance)
    np.testing.assert_array_equal(found.similarity, same.similarity)
    assert (found.rule, found.truth, found.scores, found.curve) == (None, None, None, None)
    assert "nobody knows which frames show the same place" in found.why_unscored
    assert "`everplace data align`" in found.why_unscored
    assert not same.why_unscored


def test_a_mistake_stays_one_where_drives_are_not_aligned(tiny_route: Path) -> None:
    unaligned(tiny_route, "denied")
    route = open_route(tiny_route)
    with pytest.raises(ConfigError, match="tolerance -1 is negative"):
        retrieve(route, "winter", "summer", "sad", tolerance=-1)
    with pytest.raises(RouteError, match="has no poses"):
        retrieve(route, "winter", "summer", "sad", radius=5.0)
    with pytest.raises(ConfigError, match="two truths"):
        retrieve(route, "winter", "summer", "sad", tolerance=1, radius=5.0)
    with pytest.raises(RouteError, match="autumn"):
        retrieve(route, "autumn", "summer", "sad")
    with pytest.raises(RouteError, match="are not aligned"):  # the truth is there, and was not asked for
        retrieve(replace(route, radius=5.0), "winter", "summer", "sad", tolerance=1)


@pytest.mark.parametrize("how", ["named apart", "denied", "posed"])
def test_a_comparison_of_drives_that_are_not_aligned_names_the_remedy(tiny_route: Path, how: str) -> None:
    unaligned(tiny_route, how)
    tested = select_tested(open_route(tiny_route), ["hog"], Selection(), "")
    with pytest.raises(RouteError, match="`everplace data align`"):
        open_study(tested, MatchRule(), Matching())


def rename(directory: Path, prefix: str) -> None:
    for path in list(directory.glob("*.png")):
        path.rename(path.with_name(prefix + path.name))


def pose(directory: Path, metres: float) -> None:
    rows = [f"{path.stem},{metres * int(path.stem.lstrip('qd'))},0,0" for path in directory.glob("*.png")]
    (directory / "poses.csv").write_text("stem,x,y,heading\n" + "\n".join(rows) + "\n")


@pytest.mark.parametrize("same", [True, False])
def test_poses_tell_the_same_places_without_shared_stems(tiny_route: Path, same: bool) -> None:
    """Frames that only one traverse has take part: the route's truth is a radius, and stems mean nothing."""
    (tiny_route / "winter" / "11.png").unlink()
    if not same:
        rename(tiny_route / "winter", "q")
        rename(tiny_route / "summer", "d")
    for traverse in ("summer", "winter"):
        pose(tiny_route / traverse, 10.0)
    (tiny_route / "route.toml").write_text("radius = 15.0\n")
    evaluated = evaluate_retrieval(retrieve(open_route(tiny_route), "winter", "summer", "hog"), "hog")
    scores = evaluated.result.scores
    assert scores is not None
    assert (scores.queries, scores.database, scores.queries_with_match) == (11, 12, 11)
    expected = np.abs(np.arange(11)[:, None] - np.arange(12)) <= 1
    np.testing.assert_array_equal(evaluated.result.truth, expected)
    assert evaluated.metrics()["radius"] == 15.0
    assert scores.recall_at["1"] > 0.5


def test_pairs_are_the_truth_of_the_route_until_an_option_says_otherwise(tiny_route: Path) -> None:
    rename(tiny_route / "winter", "q")
    pairs = "".join(f"winter,q{place},summer,{place}\n" for place in range(10))
    (tiny_route / "truth.csv").write_text("query_traverse,query,database_traverse,database\n" + pairs)
    (tiny_route / "route.toml").write_text('truth = "truth.csv"\n')
    pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection(slice(2, None)))
    matches, truth = true_matches(pair, MatchRule())
    assert truth == MatchRule(pairs="truth.csv")
    np.testing.assert_array_equal(matches, np.diag([True] * 8 + [False] * 2))
    with pytest.raises(RouteError, match="share no stem"):
        true_matches(pair, MatchRule(tolerance=1))


def test_a_comparison_uses_the_pairs_in_both_directions(tiny_route: Path, tmp_path: Path) -> None:
    rename(tiny_route / "winter", "q")
    pairs = "".join(f"winter,q{place},summer,{place}\n" for place in range(12))
    (tiny_route / "truth.csv").write_text("query_traverse,query,database_traverse,database\n" + pairs)
    (tiny_route / "route.toml").write_text('truth = "truth.csv"\n')
    tested = select_tested(open_route(tiny_route), ["hog"], Selection(), "")
    study = open_study(tested, MatchRule(), Matching())
    metrics = compare_methods(study, Methods({"hog": open_describer("hog")}), tmp_path / "out").metrics()
    assert metrics["truth"] == "truth.csv"
    assert [pair["methods"]["hog"]["queries_with_match"] for pair in metrics["pairs"]] == [12, 12]


def banded(queries: list[int], database: list[int]) -> NDArray[np.bool_]:
    """The truth of frames at these places, ±1 place."""
    distance: NDArray[np.int64] = np.abs(np.array(queries)[:, None] - np.array(database))
    return distance <= 1


def test_queries_of_some_places_look_in_the_whole_map(tiny_route: Path) -> None:
    for place in set(range(12)) - {2, 5, 6, 9}:
        (tiny_route / "winter" / f"{place}.png").unlink()
    route = open_route(tiny_route)
    pair = choose_pair(route, "winter", "summer", Selection())
    matches, _ = true_matches(pair, MatchRule())
    np.testing.assert_array_equal(matches, banded([2, 5, 6, 9], list(range(12))))
    # The other way round only places that the map has are asked for; they are counted along the whole way.
    pair = choose_pair(route, "summer", "winter", Selection())
    assert pair.query.stems == pair.database.stems == ("2", "5", "6", "9")
    matches, _ = true_matches(pair, MatchRule())
    np.testing.assert_array_equal(matches, banded([2, 5, 6, 9], [2, 5, 6, 9]))
    assert matches.sum() == 6
    pair = choose_pair(route, "winter", "summer", Selection(slice(1, 3)))
    matches, _ = true_matches(pair, MatchRule())
    np.testing.assert_array_equal(matches, banded([5, 6], [5, 6, 7, 8]))


@pytest.mark.slow
def test_a_comparison_and_an_evaluation_agree_on_the_whole_map(tiny_route: Path, tmp_path: Path) -> None:
    for place in set(range(12)) - {2, 5, 6, 9}:
        (tiny_route / "winter" / f"{place}.png").unlink()
    route = open_route(tiny_route)
    study = open_study(select_tested(route, ["hog"], Selection(), ""), MatchRule(), Matching("centre"))
    compared = compare_methods(study, Methods({"hog": open_describer("hog")}), tmp_path / "out")
    assert compared.metrics()["places"] == 4
    found = {(pair["query"], pair["database"]): pair["methods"]["hog"] for pair in compared.metrics()["pairs"]}
    for names, database in ((("winter", "summer"), 12), (("summer", "winter"), 4)):
        alone = evaluate_retrieval(retrieve(route, *names, "hog", matching=Matching("centre")), "hog").metrics()
        assert (alone["queries"], alone["database"], alone["queries_with_match"]) == (4, database, 4)
        for name in ("recall_at", "auc_pr", "average_precision", "queries", "database"):
            assert found[names][name] == alone[name]
    write_comparison(compared, tmp_path / "out", title="t", details={})
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_filter_acts_on_each_traverse_alone_where_stems_do_not_count(tiny_route: Path) -> None:
    (tiny_route / "winter" / "3.png").unlink()
    route = open_route(tiny_route)
    shared = select(route, Selection(slice(2, 5)))
    assert [traverse.stems for traverse in shared.traverses] == [("2", "4", "5")] * 2
    alone = select(route, Selection(slice(2, 5)), only_shared=False)
    assert [traverse.stems for traverse in alone.traverses] == [("2", "3", "4"), ("2", "4", "5")]


@pytest.mark.slow
def test_the_audit_looks_at_shared_places_where_the_scores_do_not_need_them(tiny_route: Path, tmp_path: Path) -> None:
    (tiny_route / "winter" / "3.png").unlink()
    (tiny_route / "summer" / "0.png").unlink()
    for traverse in ("summer", "winter"):
        pose(tiny_route / traverse, 10.0)
    (tiny_route / "route.toml").write_text("radius = 15.0\n")
    config = ModelConfig(
        kind="c-vae", height=32, width=64, channels=1, conditions=("summer", "winter"), fully_connected=False
    )
    save_checkpoint(tmp_path / "run", ConditionVAE(config), {"recipe": "faithful"})
    (tmp_path / "run" / "config.toml").touch()
    evaluated = evaluate_retrieval(retrieve(open_route(tiny_route), "winter", "summer", tmp_path / "run"), "run")
    scores = evaluated.result.scores
    assert scores is not None
    assert (scores.queries, scores.database) == (11, 11)
    assert evaluated.audit is not None
    write_evaluation(evaluated, tmp_path / "out", details={})
    assert (tmp_path / "out" / "swap.png").is_file()


@pytest.mark.parametrize(
    ("frames", "asking", "stems"),
    [(None, slice(4, None), range(4, 12)), (None, slice(None, 2), range(2)), (slice(3, 9), slice(5, 20), range(5, 9))],
)
def test_some_places_ask_and_the_map_keeps_all(
    tiny_route: Path, frames: slice | None, asking: slice, stems: range
) -> None:
    result = retrieve(
        open_route(tiny_route), "winter", "summer", "hog", selection=Selection(frames), query_frames=asking
    )
    assert [int(stem) for stem in result.query.stems] == list(stems)
    assert len(result.database) == (12 if frames is None else 6)
    assert result.truth is not None
    assert result.truth.any(axis=1).all()


@pytest.mark.parametrize("asking", [slice(12, None), slice(0, 3)])
def test_places_that_ask_must_be_there(tiny_route: Path, asking: slice) -> None:
    with pytest.raises(RouteError, match="`query_frames`"):
        retrieve(
            open_route(tiny_route), "winter", "summer", "hog", selection=Selection(slice(3, None)), query_frames=asking
        )
