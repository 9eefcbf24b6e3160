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

from everplace.training.augment import Augmentation
from everplace.training.frames import Batch, EpochOrder, FrameBlock, SplitRoute, TrainingFrames
from everplace.training.prefetch import BatchesAhead


def frames_of(count: int) -> TrainingFrames:
    pixels = np.random.default_rng(1).integers(0, 256, (count, 16, 16, 3), dtype=np.uint8)
    block = FrameBlock(pixels, 0, tuple(map(str, range(count))))
    return TrainingFrames(SplitRoute(("a",), (block,), (), aligned=True), Augmentation(shift=0.2, contrast=0.3), 5)


def threads_alive() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("ahead")]


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


class Noted(TrainingFrames):
    """Notes what it was asked for, and waits until it may answer."""

    def __init__(self) -> None:
        self.asked: list[int] = []
        self.may_answer = threading.Event()

    def __getitem__(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        first = int(key[1][0])
        self.asked.append(first)
        assert self.may_answer.wait(30)
        if first == 13:
            raise ValueError("frame 13 is damaged")
        return Batch(torch.tensor([first]), torch.zeros(1), torch.zeros(1))


class Forward(EpochOrder):
    def _draw(self, rng: np.random.Generator) -> NDArray[np.int64]:
        return np.arange(100)


def settled(frames: Noted, wanted: int) -> None:
    """Waits until so many batches were asked for, and then for more that should not come."""
    end = time.monotonic() + 30
    while len(frames.asked) < wanted and time.monotonic() < end:
        time.sleep(0.001)
    time.sleep(0.1)
    assert sorted(frames.asked) == list(range(wanted))


def test_two_for_each_thread_are_made_ahead_at_once_and_a_stop_ends_the_threads() -> None:
    frames = Noted()
    batches = iter(BatchesAhead(frames, Forward(100, 1, seed=0), pin=False, threads=3))
    taken: list[Batch] = []
    reader = threading.Thread(target=lambda: taken.append(next(batches)))
    reader.start()
    settled(frames, 3)
    frames.may_answer.set()
    reader.join()
    assert int(taken[0].images[0]) == 0
    settled(frames, 7)
    frames.may_answer.clear()
    second = next(batches)
    assert int(second.images[0]) == 1
    settled(frames, 8)
    frames.may_answer.set()
    batches.close()  # type: ignore[attr-defined]
    assert threads_alive() == []
    assert sorted(frames.asked) == list(range(8))


def test_a_failure_comes_in_its_turn() -> None:
    frames = Noted()
    frames.may_answer.set()
    batches = iter(BatchesAhead(frames, Forward(100, 1, seed=0), pin=False, threads=4))
    assert [int(next(batches).images[0]) for _ in range(13)] == list(range(13))
    with pytest.raises(ValueError, match="frame 13 is damaged"):
        next(batches)
    assert threads_alive() == []


@pytest.mark.parametrize("pin", [False, True])
def test_batches_are_page_locked_if_asked_for(monkeypatch: pytest.MonkeyPatch, pin: bool) -> None:
    pinned: list[int] = []

    def pin_memory(tensor: torch.Tensor) -> torch.Tensor:
        pinned.append(id(tensor))
        return tensor.clone()

    monkeypatch.setattr(torch.Tensor, "pin_memory", pin_memory)
    frames, order = frames_of(6), EpochOrder(6, 3, seed=0)
    made = list(BatchesAhead(frames, order, pin=pin, threads=2))
    assert all(torch.equal(one.images, frames[key].images) for one, key in zip(made, order, strict=True))
    assert len(pinned) == (6 if pin else 0)
