"""Batches of pairs: two traverses of one place, each frame at most once an epoch, the same whenever drawn."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.errors import ConfigError, RouteError
from everplace.training.augment import Augmentation
from everplace.training.config import TrainConfig
from everplace.training.frames import FrameBlock, SplitRoute
from everplace.training.pairs import PairedFrames, PairOrder, make_frames, make_order, require_shares
from everplace.training.virtual_places import VirtualPlaces

NONE = Augmentation()


def split_of(traverses: int, places: int) -> SplitRoute:
    """Frames whose value says which one it is: traverse × 50 + place."""
    blocks = tuple(
        FrameBlock(
            np.full((places, 8, 8, 1), 0, np.uint8) + (50 * t + np.arange(places, dtype=np.uint8))[:, None, None, None],
            condition=t,
        )
        for t in range(traverses)
    )
    return SplitRoute(tuple("abcd"[:traverses]), blocks, (), aligned=True)


def epoch_of(order: PairOrder, epoch: int) -> list[NDArray[np.int64]]:
    order.set_epoch(epoch)
    return [pairs for _, pairs in order]


@pytest.mark.parametrize(("traverses", "pairs_a_place"), [(2, 1), (3, 1), (4, 2)])
def test_pairs_are_of_one_place_and_two_traverses_and_no_frame_comes_twice(traverses: int, pairs_a_place: int) -> None:
    places = 12
    order = PairOrder(places, traverses, batch_size=6, seed=1)
    pairs = np.concatenate(epoch_of(order, 0))
    assert pairs.shape == (places * pairs_a_place, 2)
    assert (pairs[:, 0] % places == pairs[:, 1] % places).all()
    assert (pairs[:, 0] // places != pairs[:, 1] // places).all()
    assert len(np.unique(pairs)) == pairs.size


def test_the_order_depends_on_seed_and_epoch_alone_and_devices_share_its_batches() -> None:
    def order(seed: int = 1) -> PairOrder:
        return PairOrder(12, 2, batch_size=8, seed=seed)

    first = epoch_of(order(), 3)
    for once, again in zip(first, epoch_of(order(), 3), strict=True):
        np.testing.assert_array_equal(once, again)
    assert (first[0] != epoch_of(order(), 4)[0]).any()
    assert (first[0] != epoch_of(order(2), 3)[0]).any()
    shares = []
    for rank in range(2):
        shared = order()
        shared.share(rank, 2)
        shares.append(epoch_of(shared, 3))
    for whole, one, other in zip(first, *shares, strict=True):
        assert {*map(tuple, whole.tolist())} == {*map(tuple, one.tolist()), *map(tuple, other.tolist())}


def test_a_batch_holds_the_two_frames_of_each_place_side_by_side_with_their_labels() -> None:
    frames = PairedFrames(split_of(2, 10), NONE, VirtualPlaces(), seed=0)
    batch = frames[0, np.array([[3, 13], [17, 7]])]
    assert batch.images[:, 0, 0, 0].tolist() == [3, 53, 57, 7]
    assert batch.conditions.tolist() == [0, 1, 1, 0]
    assert batch.places.tolist() == [3, 3, 7, 7]


def test_the_frames_of_a_place_are_moved_alike_when_asked_for_and_lit_apart() -> None:
    rng = np.random.default_rng(0)
    pictures = rng.integers(60, 190, (10, 16, 16, 1), dtype=np.uint8)
    split = SplitRoute(("a", "b"), (FrameBlock(pictures, 0), FrameBlock(pictures, 1)), (), aligned=True)
    key = np.array([[3, 13], [17, 7]])

    def pairs(augmentation: Augmentation, *, alike: bool) -> NDArray[np.uint8]:
        frames = PairedFrames(split, augmentation, VirtualPlaces(), seed=0, alike=alike)
        return frames[2, key].images.numpy().reshape(2, 2, 16, 16, 1)

    moved = Augmentation(shift=0.2, crop=0.2)
    together, apart = pairs(moved, alike=True), pairs(moved, alike=False)
    assert (together[:, 0] == together[:, 1]).all()
    assert (apart[:, 0] != apart[:, 1]).any(axis=(1, 2, 3)).all()
    # The first frame of a pair is what it is without.
    assert (together[:, 0] == apart[:, 0]).all()
    both = Augmentation(shift=0.2, crop=0.2, brightness=0.2)
    lit = pairs(both, alike=True).astype(int)
    assert (lit[:, 0] == pairs(both, alike=False)[:, 0]).all()
    # The second is as bright as its own position says, and nothing else.
    change = lit[:, 1] - together[:, 1]
    assert all(np.ptp(one) == 0 for one in change)
    assert (lit[:, 0] != lit[:, 1]).any(axis=(1, 2, 3)).all()


def test_virtual_places_are_drawn_from_seed_and_epoch() -> None:
    split = split_of(2, 10)
    key = np.array([[3, 13], [17, 7], [1, 11], [5, 15]])
    virtual = VirtualPlaces(join=1.0)
    first = PairedFrames(split, NONE, virtual, seed=0)[2, key].images
    assert (first == PairedFrames(split, NONE, virtual, seed=0)[2, key].images).all()
    assert (first != PairedFrames(split, NONE, virtual, seed=1)[2, key].images).any()
    assert (first != PairedFrames(split, NONE, virtual, seed=0)[3, key].images).any()
    # The right of each place comes from the next one of the batch.
    assert first[0, 0, -1, 0] == 57
    assert first[1, 0, -1, 0] == 7


def test_frames_come_in_pairs_where_a_remedy_needs_them_and_only_there() -> None:
    split = split_of(2, 10)
    for remedies, paired in (
        ({}, False),
        ({"adversary": 1.0}, False),
        ({"contrastive": 1.0}, True),
        ({"swap": 1.0}, True),
    ):
        config = TrainConfig.build(model="cp-vae", epochs=1, batch_size=4, remedies=remedies)
        assert isinstance(make_frames(split, config), PairedFrames) is paired
        order = make_order(split, config, 3)
        epoch, positions = next(iter(order))
        assert (epoch, positions.shape) == (3, (2, 2) if paired else (4,))


@pytest.mark.parametrize("remedy", ["contrastive", "swap"])
def test_one_traverse_makes_no_pairs(remedy: str) -> None:
    config = TrainConfig.build(model="cp-vae", epochs=1, remedies={remedy: 1.0})
    with pytest.raises(RouteError, match=f"remedies.{remedy} needs two traverses of the same places, and there is one"):
        make_order(split_of(1, 10), config, 0)


OTHER_PLACE = {"swap": 1.0, "swap_z_c": "other_place"}


@pytest.mark.parametrize(
    ("remedies", "batch_size", "devices", "message"),
    [
        ({}, 8, 5, "a batch of 8 frames is too small for 5 devices, which need two each; raise batch_size"),
        (
            {"swap": 1.0}, 9, 4,
            "a batch of 3 pairs of frames (batch_size = 9) is too small for 4 devices with remedies.swap, which needs "
            "1 pair on each; add frames or give fewer --devices",
        ),
        (
            {"swap": 1.0}, 4, 3,
            "a batch of 2 pairs of frames (batch_size = 4) is too small for 3 devices with remedies.swap, which needs "
            "1 pair on each; set batch_size to 6 or more or give fewer --devices",
        ),
        (
            {"contrastive": 1.0}, 3, 1,
            "a batch of 1 pair of frames (batch_size = 3) is too small for 1 device with remedies.contrastive, which "
            "needs 2 pairs on each; set batch_size to 4 or more",
        ),
        ({"contrastive": 1.0, "swap": 1.0}, 6, 2, "with remedies.contrastive, which needs 2 pairs on each"),
        (OTHER_PLACE, 2, 1, 'with remedies.swap_z_c = "other_place", which needs 2 pairs on each'),
    ],
)  # fmt: skip
def test_a_device_without_enough_frames_or_pairs_is_refused_by_the_remedy_that_needs_them(
    remedies: dict[str, Any], batch_size: int, devices: int, message: str
) -> None:
    config = TrainConfig.build(model="cp-vae", epochs=1, batch_size=batch_size, remedies=remedies)
    with pytest.raises(ConfigError, match=re.escape(message)):
        require_shares(split_of(3, 3), config, devices)


@pytest.mark.parametrize(
    ("remedies", "batch_size", "devices", "least"),
    [({}, 9, 4, 2), ({"swap": 1.0}, 6, 3, 1), ({"swap": 1.0}, 2, 1, 1), ({"contrastive": 1.0}, 5, 1, 2),
     (OTHER_PLACE, 8, 2, 2)],
)  # fmt: skip
def test_what_is_not_refused_gives_each_device_what_it_needs(
    remedies: dict[str, Any], batch_size: int, devices: int, least: int
) -> None:
    split = split_of(3, 4)
    config = TrainConfig.build(model="cp-vae", epochs=1, batch_size=batch_size, remedies=remedies)
    require_shares(split, config, devices)
    for rank in range(devices):
        order = make_order(split, config, 0)
        order.share(rank, devices)
        assert min(len(positions) for _, positions in order) >= least
