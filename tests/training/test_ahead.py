"""Batches made ahead are those that the order asks for, in its order, and no more than agreed."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.data.augment import Augmentation
from everplace.training.ahead import BatchesAhead
from everplace.training.frames import Batch, EpochOrder, FrameBlock, SplitRoute, TrainingFrames


def frames_of(count: int) -> TrainingFrames:
    pixels = np.random.default_rng(1).integers(0, 256, (count, 16, 16, 3), dtype=np.uint8)
    block = FrameBlock(pixels, 0, tuple(map(str, range(count))))
    return TrainingFrames(SplitRoute(("a",), (block,), (), aligned=True), Augmentation(shift=0.2, contrast=0.3), 5)


def threads_alive() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("everplace-batches")]


@settings(max_examples=25, deadline=None)
@given(count=st.integers(1, 40), batch=st.integers(1, 9), threads=st.integers(1, 5))
def test_they_are_those_of_the_order(count: int, batch: int, threads: int) -> None:
    frames, order = frames_of(count), EpochOrder(count, batch, seed=2)
    ahead = BatchesAhead(frames, order, pin=False, threads=threads)
    for epoch in (0, 1):
        ahead.sampler.set_epoch(epoch)
        made, expected = list(ahead), [frames[key] for key in order]
        assert len(made) == len(ahead) == len(order)
        for one, other in zip(made, expected, strict=True):
            assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))
    assert threads_alive() == []


class Slow(TrainingFrames):
    """Counts what it was asked for, and makes the first batch last."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __getitem__(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        first = int(key[1][0])
        self.asked.append(first)
        if len(self.asked) == 1:
            time.sleep(0.05)
        if first == 13:
            raise ValueError("frame 13 is damaged")
        return Batch(torch.tensor([first]), torch.zeros(1), torch.zeros(1))


class Forward(EpochOrder):
    def _draw(self, rng: np.random.Generator) -> NDArray[np.int64]:
        return np.arange(100)


def test_no_more_is_made_than_two_for_each_thread_and_a_stop_ends_the_threads() -> None:
    frames = Slow()
    batches = iter(BatchesAhead(frames, Forward(100, 1, seed=0), pin=False, threads=3))
    taken = [int(next(batches).images[0]) for _ in range(4)]
    assert taken == [0, 1, 2, 3]
    assert len(frames.asked) <= 4 + 2 * 3 - 1
    batches.close()  # type: ignore[attr-defined]
    assert threads_alive() == []


def test_a_failure_comes_in_its_turn() -> None:
    batches = iter(BatchesAhead(Slow(), Forward(100, 1, seed=0), pin=False, threads=4))
    assert [int(next(batches).images[0]) for _ in range(13)] == list(range(13))
    with pytest.raises(ValueError, match="frame 13 is damaged"):
        next(batches)
    assert threads_alive() == []
