"""Sequence averaging against the formula in plain Python, and the choice of the search."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.choices import SEQUENCE_METHODS, SequenceMethod
from everplace.errors import ConfigError, DescriptorsError
from everplace.sequences.route_filter import filter_windows
from everplace.sequences.seqslam import seqslam
from everplace.sequences.sequence_search import average_sequences, search_sequences


def slow(S: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    out = np.empty_like(S)
    for i in range(S.shape[0]):
        for j in range(S.shape[1]):
            steps = range(min(length - 1, i, j) + 1)
            out[i, j] = sum(S[i - k, j - k] for k in steps) / len(steps)
    return out


@settings(max_examples=30, deadline=None)
@given(
    arrays(np.float64, st.tuples(st.integers(1, 6), st.integers(1, 6)), elements=st.integers(-9, 9).map(float)),
    st.integers(1, 8),
)
def test_it_is_the_mean_along_the_diagonal(S: NDArray[np.float64], length: int) -> None:
    kept = S.copy()
    assert np.allclose(average_sequences(S, length), slow(S, length))
    assert (kept == S).all()


def test_it_is_causal() -> None:
    S = np.random.default_rng(0).random((8, 8))
    later = S.copy()
    later[5:] = 0
    assert (average_sequences(S, 3)[:5] == average_sequences(later, 3)[:5]).all()


def test_length_1_is_a_copy() -> None:
    S = np.ones((2, 3), np.float32)
    out = average_sequences(S, 1)
    out[0, 0] = 7
    assert out.dtype == np.float32
    assert S[0, 0] == 1


def test_integers_are_averaged_as_numbers() -> None:
    assert average_sequences(np.array([[1, 0], [0, 2]]), 2).tolist() == [[1, 0], [0, 1.5]]


@pytest.mark.parametrize("length", [0, -3])
def test_a_length_below_1_is_refused(length: int) -> None:
    with pytest.raises(ConfigError, match=f"a sequence of {length} frames"):
        average_sequences(np.ones((2, 2)), length)


def test_the_method_chooses_the_search() -> None:
    S = np.random.default_rng(9).random((6, 7)).astype(np.float32)
    np.testing.assert_array_equal(search_sequences(S, 3, "mean"), average_sequences(S, 3))
    np.testing.assert_array_equal(search_sequences(S, 3, "seqslam"), seqslam(S, 3))
    np.testing.assert_array_equal(search_sequences(S, 3, "filter"), filter_windows(S, 3))
    np.testing.assert_array_equal(search_sequences(S, 3), filter_windows(S, 3))


@pytest.mark.parametrize("method", SEQUENCE_METHODS)
def test_one_frame_is_no_sequence(method: SequenceMethod) -> None:
    S = np.random.default_rng(10).random((4, 5)).astype(np.float32)
    found = search_sequences(S, 1, method)
    np.testing.assert_array_equal(found, S)
    assert found is not S


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(ConfigError, match="the sequence method 'dtw' is not known; choose filter, seqslam, mean"):
        search_sequences(np.ones((2, 2)), 2, "dtw")  # type: ignore[arg-type]


@pytest.mark.parametrize("method", SEQUENCE_METHODS)
@pytest.mark.parametrize("length", [1, 3])
@pytest.mark.parametrize("S", [np.zeros(5), np.zeros((0, 3)), np.array([["a"]])])
def test_what_is_no_matrix_of_scores_is_refused(method: SequenceMethod, length: int, S: NDArray[Any]) -> None:
    with pytest.raises(DescriptorsError, match="are no traverse"):
        search_sequences(S, length, method)
