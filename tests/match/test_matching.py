"""The best matches under the options of the match."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError
from everplace.match import similarity as module
from everplace.match.matching import Matching, best_matches
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
