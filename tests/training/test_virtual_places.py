"""Virtual places: what is changed is changed in both frames alike, and comes from where it should."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.training.virtual_places import VirtualPlaces, virtual_pairs

SHAPE = (5, 2, 16, 24, 1)


def noise() -> NDArray[np.uint8]:
    return np.random.default_rng(2).integers(0, 256, SHAPE, dtype=np.uint8)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_nothing_switched_on_is_a_copy() -> None:
    pairs = noise()
    same = virtual_pairs(pairs, VirtualPlaces(), rng())
    np.testing.assert_array_equal(same, pairs)
    assert not np.shares_memory(same, pairs)


@pytest.mark.parametrize(
    "virtual",
    [
        VirtualPlaces(crop=0.4),
        VirtualPlaces(mirror=1.0),
        VirtualPlaces(join=1.0),
        VirtualPlaces(crop=0.3, mirror=0.5, join=0.5),
    ],
)
def test_both_frames_of_a_place_are_changed_alike_and_the_input_is_left(virtual: VirtualPlaces) -> None:
    pairs = noise()
    pairs[:, 1] = pairs[:, 0]
    before = pairs.copy()
    pairs.flags.writeable = False
    changed = virtual_pairs(pairs, virtual, rng(1))
    np.testing.assert_array_equal(changed[:, 0], changed[:, 1])
    np.testing.assert_array_equal(pairs, before)
    assert changed.shape == SHAPE
    assert changed.dtype == np.uint8
    assert (changed != before).any()


def test_the_mirror_turns_left_and_right_and_nothing_else() -> None:
    pairs = noise()
    np.testing.assert_array_equal(virtual_pairs(pairs, VirtualPlaces(mirror=1.0), rng()), pairs[:, :, :, ::-1])


def test_a_joined_place_is_its_own_on_the_left_and_the_next_of_the_batch_on_the_right() -> None:
    pairs = noise()
    joined = virtual_pairs(pairs, VirtualPlaces(join=1.0), rng(4))
    for place in range(len(pairs)):
        own = (joined[place] == pairs[place]).all(axis=(0, 1, 3))
        seam = int(np.argmin(own))
        assert 0.1 * SHAPE[3] < seam < 0.9 * SHAPE[3]
        np.testing.assert_array_equal(joined[place, :, :, :seam], pairs[place, :, :, :seam])
        np.testing.assert_array_equal(joined[place, :, :, seam:], pairs[(place + 1) % len(pairs), :, :, seam:])


def test_shares_are_kept_and_draws_are_seeded() -> None:
    many = np.random.default_rng(0).integers(0, 256, (400, 2, 4, 8, 1), dtype=np.uint8)
    changed = virtual_pairs(many, VirtualPlaces(mirror=0.25), rng(5))
    share = np.mean((changed != many).any(axis=(1, 2, 3, 4)))
    assert 0.18 < share < 0.32
    np.testing.assert_array_equal(changed, virtual_pairs(many, VirtualPlaces(mirror=0.25), rng(5)))
