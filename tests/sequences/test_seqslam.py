"""SeqSLAM's search against loops in plain Python."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from tests.sequences.hidden_markov import drive

from everplace.errors import ConfigError
from everplace.sequences import seqslam as module
from everplace.sequences.seqslam import VELOCITIES, enhance_contrast, seqslam
from everplace.sequences.sequence_search import average_sequences

matrices = arrays(np.float64, st.tuples(st.integers(1, 7), st.integers(1, 7)), elements=st.integers(-9, 9).map(float))


def slow_contrast(S: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    out = np.empty_like(S)
    for i in range(S.shape[0]):
        for j in range(S.shape[1]):
            near = S[i, max(j - window // 2, 0) : j + window // 2 + 1]
            out[i, j] = (S[i, j] - near.mean()) / near.std() if near.std() > 0 else 0
    return out


def slow_search(S: NDArray[np.float64], length: int, velocities: tuple[float, ...]) -> NDArray[np.float64]:
    out = np.full_like(S, -np.inf)
    for i in range(S.shape[0]):
        for j in range(S.shape[1]):
            for v in velocities:
                steps = [(i - k, j - math.floor(v * k + 0.5)) for k in range(length)]
                values = [S[a, b] for a, b in steps if a >= 0 and b >= 0]
                out[i, j] = max(out[i, j], sum(values) / len(values))
    return out


@settings(max_examples=30, deadline=None)
@given(matrices, st.integers(1, 9))
def test_with_one_velocity_and_no_enhancement_it_is_the_mean(S: NDArray[np.float64], length: int) -> None:
    kept = S.copy()
    found = seqslam(S, length, velocities=(1.0,), window=0)
    np.testing.assert_allclose(found, average_sequences(S, length), rtol=1e-5, atol=1e-6)
    assert (kept == S).all()


@settings(max_examples=30, deadline=None)
@given(matrices, st.integers(1, 9), st.integers(1, 8))
def test_it_is_the_best_trajectory_in_enhanced_scores(S: NDArray[np.float64], length: int, window: int) -> None:
    expected = slow_search(slow_contrast(S, window), length, VELOCITIES)
    np.testing.assert_allclose(seqslam(S, length, window=window), expected, rtol=1e-5, atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(matrices, st.integers(1, 8), st.floats(0.01, 100), st.floats(-100, 100))
def test_contrast_does_not_depend_on_shift_and_scale(
    S: NDArray[np.float64], window: int, scale: float, shift: float
) -> None:
    np.testing.assert_allclose(
        enhance_contrast(S * scale + shift, window), enhance_contrast(S, window), rtol=1e-5, atol=1e-5
    )


def test_blocks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    S = np.random.default_rng(0).normal(size=(23, 8))
    whole = seqslam(S, 6)
    monkeypatch.setattr(module, "_BLOCK", 8 * 4)
    np.testing.assert_array_equal(seqslam(S, 6), whole)


def test_it_is_causal_and_forgets() -> None:
    S = np.random.default_rng(1).normal(size=(12, 9))
    changed = S.copy()
    changed[[3, 10]] += np.square(np.arange(9))
    equal = (seqslam(S, 4) == seqslam(changed, 4)).all(axis=1)
    assert equal.tolist() == [True] * 3 + [False] * 4 + [True] * 3 + [False] * 2


@pytest.mark.parametrize("speed", [0.8, 1.0, 1.2])
def test_an_even_speed_is_followed(speed: float) -> None:
    path = [round(5 + speed * frame) for frame in range(30)]
    found = seqslam(drive(path, 60, separation=3.0), 10).argmax(axis=1)
    assert (np.abs(found - path) <= 1)[9:].all()


def test_unknown_scores_count_in_no_mean() -> None:
    S = np.array([[1.0, 2.0], [np.nan, 4.0], [np.nan, np.nan]])
    found = seqslam(S, 2, velocities=(1.0,), window=0)
    np.testing.assert_allclose(found, np.array([[1, 2], [-np.inf, 2.5], [-np.inf, -np.inf]]))
    rest = np.random.default_rng(2).normal(size=(3, 9))
    gappy = np.insert(rest, 4, np.nan, axis=1)
    # Far from the gap nothing changes.
    np.testing.assert_allclose(enhance_contrast(gappy, 2)[:, :3], enhance_contrast(rest, 2)[:, :3])


@pytest.mark.parametrize(
    ("length", "options"),
    [(0, {}), (3, {"velocities": ()}), (3, {"velocities": (-1.0,)}), (3, {"window": -1})],
)
def test_impossible_options_are_refused(length: int, options: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="not possible"):
        seqslam(np.ones((2, 2)), length, **options)  # type: ignore[arg-type]
