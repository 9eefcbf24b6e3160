"""The best matches under the options of the match."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors, Metric
from everplace.errors import ConfigError
from everplace.match import similarity as module
from everplace.match.matching import Matching, best_matches, find_matches
from everplace.match.similarity import best_columns, similarity
from everplace.sequences.sequence_search import average_sequences


def descriptors(seed: int, count: int) -> Descriptors:
    values = np.random.default_rng(seed).standard_normal((count, 6)).astype(np.float32)
    return Descriptors(values, tuple(map(str, range(count))), "test", "cosine")


@settings(max_examples=50, deadline=None)
@given(
    arrays(np.float32, (5, 7), elements=st.sampled_from([-2.0, -0.0, 0.0, 0.5, 1.0])),
    st.integers(1, 9),
    st.integers(1, 6),
)
def test_best_columns_are_those_of_a_stable_sort(S: NDArray[np.float32], k: int, block: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_BLOCK", block)
        columns, scores = best_columns(S, k)
    wanted = np.argsort(-S, axis=1, kind="stable")[:, :k]
    np.testing.assert_array_equal(columns, wanted)
    np.testing.assert_array_equal(scores, np.take_along_axis(S, wanted, axis=1))


def test_a_score_that_is_none_comes_last() -> None:
    columns, scores = best_columns(np.array([[np.nan, -3.0, np.nan, 2.0]], np.float32), 4)
    assert columns.tolist() == [[3, 1, 0, 2]]
    assert np.isnan(scores[0, 2:]).all()


def test_sequences_are_searched_before_the_best_are_taken() -> None:
    query, database = descriptors(0, 9), descriptors(1, 8)
    indices, scores = best_matches(query, database, 3, Matching(sequence=4, sequence_method="mean"))
    mean = average_sequences(similarity(query, database), 4)
    np.testing.assert_array_equal(indices[:, 0], mean.argmax(axis=1))
    np.testing.assert_array_equal(scores, np.sort(mean, axis=1)[:, :-4:-1])


@pytest.mark.parametrize("sequence", [1, 3])
@pytest.mark.parametrize("k", [0, -1])
def test_no_matches_cannot_be_asked_for(sequence: int, k: int) -> None:
    with pytest.raises(ConfigError, match=f"best {k} matches were asked for"):
        best_matches(descriptors(0, 5), descriptors(1, 5), k, Matching(sequence=sequence))


def drive(count: int, seed: int, metric: Metric = "cosine") -> Descriptors:
    values = np.random.default_rng(seed).standard_normal((count, 16)).astype(np.float32)
    return Descriptors(values, tuple(map(str, range(count))), "test", metric)


@pytest.mark.parametrize("sequence", [1, 5])
@pytest.mark.parametrize("how", ["filter", "seqslam", "mean"])
@pytest.mark.parametrize("metric", ["cosine", "mean-absolute-difference"])
def test_a_drive_that_comes_back_finds_its_loop_and_not_itself(metric: Metric, how: str, sequence: int) -> None:
    once = drive(40, 0, metric).values
    twice = Descriptors(np.vstack([once, once + 0.1]), tuple(map(str, range(80))), "test", metric)
    found = find_matches(twice, twice, 3, Matching(sequence=sequence, sequence_method=how), exclude=10)  # type: ignore[arg-type]
    rows = np.arange(80)[:, None]
    assert (np.abs(found.indices - rows) >= 10)[found.accepted()].all()
    assert (found.indices[5:40, 0] == np.arange(45, 80)).mean() > 0.9
    assert (found.indices[45:, 0] == np.arange(5, 40)).mean() > 0.9


def test_excluded_places_leave_their_probability_to_the_others() -> None:
    words = drive(9, 1, "place-posterior")
    words = replace(words, values=words.values[:, :15])
    found = find_matches(words, words, 9, Matching(), exclude=2)
    assert found.on_map is not None
    np.testing.assert_allclose(found.probability().sum(axis=1), found.on_map, rtol=1e-4)
    assert (found.accepted().sum(axis=1) == [7, 6, 6, 6, 6, 6, 6, 6, 7]).all()


def test_a_drive_elsewhere_is_lost_and_improbable() -> None:
    database = drive(60, 2)
    here = replace(database, values=database.values + 0.3)
    there = drive(60, 3)
    matching = Matching(sequence=8)
    known, unknown = find_matches(here, database, 1, matching), find_matches(there, database, 1, matching)
    assert known.kind == "log-odds"
    assert known.on_map is not None
    assert unknown.on_map is not None
    assert (known.on_map[8:] > 0.9).all()
    assert (known.on_map <= 1 + 1e-6).all()
    assert (unknown.on_map < 0.5).mean() > 0.9
    assert known.accepted(0.9)[8:].all()
    assert unknown.accepted(0.9).mean() < 0.1


def test_scores_that_are_no_probabilities_have_no_least_one_and_other_drives_no_neighbours() -> None:
    d = drive(9, 4)
    for matching in (Matching(), Matching(sequence=3, sequence_method="mean")):
        with pytest.raises(ConfigError, match=r"`min_probability` does not apply: the scores \(cosine\)"):
            find_matches(d, d, 1, matching).accepted(0.5)
    with pytest.raises(ConfigError, match="one and the same drive"):
        find_matches(d, replace(d, names=tuple("abcdefghi")), 1, Matching(), exclude=3)
