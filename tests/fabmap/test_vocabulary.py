"""Features of images large, small and flat, and the nearest word of each."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.fabmap.vocabulary import sift_features, words_of
from everplace.images.decoding import resize_image


def textured(height: int, width: int, seed: int = 0) -> NDArray[np.uint8]:
    coarse = np.random.default_rng(seed).integers(0, 256, (height // 4, width // 4, 1), dtype=np.uint8)
    return resize_image(coarse, (height, width))[..., 0]


def test_features_are_whole_numbers_and_limited_to_the_strongest() -> None:
    image = textured(128, 160)
    every, few = sift_features(image, 0, 0), sift_features(image, 20, 0)
    assert every.dtype == few.dtype == np.uint8
    assert len(every) > 50
    assert few.shape == (20, 128)
    assert {row.tobytes() for row in few} <= {row.tobytes() for row in every}
    assert (sift_features(image, 0, 0) == every).all()


def test_small_images_are_enlarged() -> None:
    image = textured(32, 64)
    enlarged = np.asarray(cv2.resize(image, (256, 128), interpolation=cv2.INTER_CUBIC), np.uint8)
    assert np.array_equal(sift_features(image, 0, 128), sift_features(enlarged, 0, 0))
    assert not np.array_equal(sift_features(image, 0, 128), sift_features(image, 0, 0))
    large = textured(128, 160)
    assert (sift_features(large, 0, 128) == sift_features(large, 0, 0)).all()


@pytest.mark.parametrize("image", [np.zeros((32, 64)), np.full((200, 300), 255), np.zeros((1, 1)), np.zeros((1, 4000))])
def test_an_image_without_structure_has_no_features_and_no_words(image: NDArray[np.float64]) -> None:
    features = sift_features(image.astype(np.uint8), 500, 128)
    assert features.shape == (0, 128)
    assert not words_of(features, np.ones((3, 128), np.float32)).any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_words_are_the_nearest_centres(seed: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.integers(0, 256, (6, 128), dtype=np.uint8)
    vocabulary = rng.uniform(0, 255, (9, 128)).astype(np.float32)
    nearest = {min(range(9), key=lambda word: ((f - vocabulary[word]) ** 2).sum()) for f in features.astype(float)}
    assert set(np.flatnonzero(words_of(features, vocabulary))) == nearest
