"""What the gradient sees, in which order, with which labels."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from everplace.errors import ConfigError, RouteError
from everplace.route.route import Route, open_route
from everplace.training.augment import Augmentation
from everplace.training.config import TrainConfig
from everplace.training.frames import FrameBlock, SplitRoute, TrainingFrames, images_fingerprint, split_route

MakeConfig = Callable[..., TrainConfig]

NONE = Augmentation()


def numbered_route(root: Path, traverses: dict[str, range]) -> Route:
    """Grey 32×32 frames whose value says which frame it is: traverse index × 100 + stem."""
    for index, (name, stems) in enumerate(traverses.items()):
        (root / name).mkdir(parents=True)
        for stem in stems:
            image = np.full((32, 32), index * 100 + stem, dtype=np.uint8)
            Image.fromarray(image).save(root / name / f"{stem}.png")
    return open_route(root)


def values(block: FrameBlock) -> list[int]:
    return [int(frame[0, 0, 0]) for frame in block.pixels]


def some_frames(count: int, batch: int, seed: int) -> TrainingFrames:
    """Frames of one pixel."""
    block = FrameBlock(np.zeros((count, 1, 1, 1), np.uint8), 0)
    return TrainingFrames(SplitRoute(("a",), (block,), (), aligned=True), NONE, batch, seed)


def test_the_held_out_block_is_contiguous_at_the_end_behind_a_gap(tmp_path: Path, make_config: MakeConfig) -> None:
    route = numbered_route(tmp_path, {"a": range(20), "b": range(20)})
    split = split_route(route, make_config(held_out=0.2, held_out_gap=3, grey=True))
    assert [values(block) for block in split.training] == [list(range(13)), list(range(100, 113))]
    assert [values(block) for block in split.held_out] == [list(range(16, 20)), list(range(116, 120))]
    assert [block.condition for block in split.training] == [0, 1]
    assert (split.conditions, split.aligned, split.places) == (("a", "b"), True, 13)
    assert split.trained_stems == tuple(str(stem) for stem in range(13))
    assert split.held_out_stems == ("16", "17", "18", "19")


def test_traverses_without_shared_stems_have_no_places(tmp_path: Path, make_config: MakeConfig) -> None:
    route = numbered_route(tmp_path, {"a": range(10), "b": range(50, 70)})
    split = split_route(route, make_config(model="c-vae", held_out_gap=0, grey=True))
    assert not split.aligned
    assert split.places == 0
    assert split.trained_stems == tuple(str(stem) for stem in (*range(8), *range(50, 68)))
    assert [len(block.pixels) for block in split.training] == [8, 18]
    batch = TrainingFrames(split, NONE, 8, seed=0).batch(0, np.arange(26))
    assert set(batch.places.tolist()) == {-1}
    assert batch.conditions.tolist() == [0] * 8 + [1] * 18


def test_two_traverses_may_share_a_condition(tmp_path: Path, make_config: MakeConfig) -> None:
    numbered_route(tmp_path, {"a": range(10), "b": range(10), "c": range(10)})
    (tmp_path / "route.toml").write_text('[traverses.a]\ncondition = "x"\n[traverses.c]\ncondition = "x"\n')
    split = split_route(open_route(tmp_path), make_config(held_out_gap=0, grey=True))
    assert [split.conditions[block.condition] for block in split.training] == ["x", "b", "x"]


def test_too_few_frames_are_one_clear_error(tmp_path: Path, make_config: MakeConfig) -> None:
    route = numbered_route(tmp_path, {"a": range(13), "b": range(13)})
    with pytest.raises(RouteError, match=r"traverse a has 13 frames .* hold out 2 behind a gap of 10; .*held_out_gap"):
        split_route(route, make_config(held_out_gap=10, grey=True))


def test_every_frame_has_its_condition_and_place(tmp_path: Path, make_config: MakeConfig) -> None:
    route = numbered_route(tmp_path, {"a": range(10), "b": range(10)})
    frames = TrainingFrames(split_route(route, make_config(held_out_gap=1, grey=True)), NONE, 5, seed=0)
    assert (frames.frames, len(frames)) == (14, 2)
    positions = np.array([13, 0, 7, 6])
    batch = frames.batch(4, positions)
    assert batch.images.shape == (4, 32, 32, 1)
    assert batch.images[:, 5, 5, 0].tolist() == [106, 0, 100, 6]
    assert batch.conditions.tolist() == [1, 0, 1, 0]
    assert batch.places.tolist() == [6, 0, 0, 6]


def test_augmentation_depends_on_seed_epoch_and_position_alone() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (6, 32, 32, 3), dtype=np.uint8)
    split = SplitRoute(("a",), (FrameBlock(pixels, 0),), (), aligned=True)
    strong = Augmentation(shift=0.2, brightness=0.3)
    frames = TrainingFrames(split, strong, 8, seed=1)
    together = frames.batch(2, np.array([0, 1, 2, 3])).images
    apart = frames.batch(2, np.array([3, 5, 1])).images
    assert together[3].equal(apart[0])
    assert together[1].equal(apart[2])
    assert not together[3].equal(frames.batch(3, np.array([3])).images[0])
    assert not together[3].equal(TrainingFrames(split, strong, 8, seed=2).batch(2, np.array([3])).images[0])
    assert np.array_equal(pixels, split.training[0].pixels)


@given(st.integers(2, 60), st.integers(2, 40), st.integers(0, 2**32 - 1), st.integers(0, 50))
@settings(max_examples=40, deadline=None)
def test_an_epoch_is_full_batches_of_distinct_frames(count: int, batch: int, seed: int, epoch: int) -> None:
    frames = some_frames(count, batch, seed)
    batches = list(frames.order(epoch))
    seen = np.concatenate(batches)
    assert len(batches) == len(frames) == count // min(batch, count)
    assert {len(positions) for positions in batches} == {min(batch, count)}
    assert len(np.unique(seen)) == len(seen)
    assert set(seen) <= set(range(count))
    if count % batch == 0:
        assert sorted(seen) == list(range(count))


def test_the_order_is_a_function_of_seed_and_epoch() -> None:
    one, other = some_frames(30, 7, seed=4), some_frames(30, 7, seed=4)
    # Whatever was drawn before.
    assert np.array_equal(next(other.order(9)), next(one.order(9)))
    for epoch in (5, 0):
        assert np.array_equal(np.stack([*one.order(epoch)]), np.stack([*other.order(epoch)]))
    assert not np.array_equal(np.stack([*one.order(0)]), np.stack([*one.order(1)]))
    assert not np.array_equal(np.stack([*one.order(0)]), np.stack([*some_frames(30, 7, seed=5).order(0)]))


@pytest.mark.parametrize("world", [2, 3])
def test_devices_share_out_the_same_batches(world: int) -> None:
    frames = some_frames(40, 8, seed=2)
    parts = [list(frames.order(1, rank, world)) for rank in range(world)]
    for index, batch in enumerate(frames.order(1)):
        assert sorted(np.concatenate([part[index] for part in parts])) == sorted(batch)


def test_a_device_needs_two_frames() -> None:
    some_frames(40, 8, seed=0).require_frames_per_device(4)
    with pytest.raises(ConfigError, match="a batch of 8 frames is too small for 5 devices, which need two each"):
        some_frames(40, 8, seed=0).require_frames_per_device(5)


def test_the_fingerprint_tells_pixels_stems_labels_and_division_apart() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (600, 2, 2, 1), dtype=np.uint8)
    stems = tuple(map(str, range(600)))
    changed = pixels.copy()
    changed[-1, -1, -1] ^= 1
    block = FrameBlock(pixels, 0, stems)
    same = FrameBlock(pixels.copy(), 0, stems)
    first = images_fingerprint(SplitRoute(("a", "b"), (block,), (block,), True))
    assert images_fingerprint(SplitRoute(("a", "b"), (same,), (same,), True)) == first
    others = [
        SplitRoute(("a", "b"), (FrameBlock(changed, 0, stems),), (block,), True),
        SplitRoute(("a", "b"), (block,), (FrameBlock(changed, 0, stems),), True),
        SplitRoute(("a", "b"), (FrameBlock(pixels, 1, stems),), (block,), True),
        SplitRoute(("a", "b"), (FrameBlock(pixels, 0, stems[::-1]),), (block,), True),
        SplitRoute(("a", "b"), (FrameBlock(pixels.reshape(600, 4, 1, 1), 0, stems),), (block,), True),
        SplitRoute(("a", "c"), (block,), (block,), True),
        SplitRoute(("a", "b"), (block,), (block,), False),
        SplitRoute(("a", "b"), (block, block), (), True),
    ]
    assert len({first, *map(images_fingerprint, others)}) == 1 + len(others)


def test_a_cuda_device_gets_the_same_batches_page_locked(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (9, 16, 16, 3), dtype=np.uint8)
    split = SplitRoute(("a",), (FrameBlock(pixels, 0),), (), aligned=True)
    frames = TrainingFrames(split, Augmentation(shift=0.2, contrast=0.3), 2, seed=1)
    pinned: list[int] = []

    def pin_memory(tensor: torch.Tensor) -> torch.Tensor:
        pinned.append(id(tensor))
        return tensor.clone()

    monkeypatch.setattr(torch.Tensor, "pin_memory", pin_memory)
    monkeypatch.setattr(torch.Tensor, "to", lambda tensor, *_, **__: tensor)
    made = list(frames.batches(2, 0, 1, torch.device("cuda")))
    expected = list(frames.batches(2, 0, 1, torch.device("cpu")))
    assert len(made) == len(expected) == len(frames) == 4
    for one, other in zip(made, expected, strict=True):
        assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))
    assert len(pinned) == 3 * 4
