from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from everplace.errors import ConfigError
from everplace.importing.foreign_route import Encoded, ForeignFrame
from everplace.importing.sampling import (
    TIME_ROUNDING,
    sample_by_change,
    sample_by_distance,
    sample_by_number,
    sample_by_time,
)
from everplace.route.selection import stationary_places
from everplace.route.traverse import Pose

EMPTY = np.zeros((1, 1, 1), dtype=np.uint8)


def timed(times: list[float]) -> Iterator[ForeignFrame]:
    return (ForeignFrame(str(number), EMPTY, seconds=seconds) for number, seconds in enumerate(times))


def placed(positions: list[tuple[float, float]]) -> Iterator[ForeignFrame]:
    return (ForeignFrame(str(number), EMPTY, Pose(x, y, 0.0)) for number, (x, y) in enumerate(positions))


def numbers(frames: Iterator[ForeignFrame]) -> list[int]:
    return [int(frame.stem) for frame in frames]


@settings(max_examples=40, deadline=None)
@given(count=st.integers(0, 50), every=st.integers(1, 60))
def test_by_number(count: int, every: int) -> None:
    assert numbers(sample_by_number(timed([0.0] * count), every)) == list(range(0, count, every))


def test_one_frame_a_second_at_the_rates_of_videos() -> None:
    for rate in (1, 5, 10, 24, 25, 30, 50, 60):
        for digits in (15, 3):  # Matroska rounds to milliseconds
            times = [round(number / rate, digits) for number in range(10 * rate)]
            assert numbers(sample_by_time(timed(times), 1.0)) == list(range(0, 10 * rate, rate))


@settings(max_examples=40, deadline=None)
@given(
    steps=st.lists(st.floats(0, 3), max_size=40),
    start=st.floats(-1e6, 2e9),
    seconds=st.floats(0.05, 5),
)
def test_by_time_keeps_the_first_frame_of_each_span(steps: list[float], start: float, seconds: float) -> None:
    times = [start + way for way in itertools.accumulate(steps, initial=0.0)]
    kept = numbers(sample_by_time(timed(times), seconds))
    assert kept[0] == 0
    spans = [math.floor((moment - times[0] + TIME_ROUNDING) / seconds) for moment in times]
    assert [spans[number] for number in kept] == sorted(set(spans))
    assert all(number == spans.index(spans[number]) for number in kept)


def test_time_that_goes_back_is_left_out() -> None:
    assert numbers(sample_by_time(timed([5.0, 6.0, 3.0, 6.5, 7.1]), 1.0)) == [0, 1, 4]


@settings(max_examples=40, deadline=None)
@given(speeds=st.lists(st.floats(0.11, 0.9), min_size=1, max_size=60), metres=st.floats(1, 4))
def test_by_distance_keeps_one_frame_in_each_stretch(speeds: list[float], metres: float) -> None:
    ways = [*itertools.accumulate((speed * metres for speed in speeds), initial=0.0)]
    kept = numbers(sample_by_distance(placed([(way, 0.0) for way in ways]), metres))
    assert kept[0] == 0
    reached = [ways[number] / metres for number in kept]
    # No step is longer than a stretch, so that none is missed, and each is met within the step that enters it.
    assert [math.floor(way + 1e-9) for way in reached] == list(range(len(kept)))
    assert len(kept) == math.floor(ways[-1] / metres + 1e-9) + 1


def test_standing_with_a_jittering_receiver_is_no_way() -> None:
    rng = np.random.default_rng(3)
    jitter = [(float(x), float(y)) for x, y in rng.uniform(-0.3, 0.3, (500, 2))]
    assert numbers(sample_by_distance(placed([(0.0, 0.0), *jitter]), 10.0)) == [0]


def test_there_and_back_counts_as_way() -> None:
    there = [(float(x), 0.0) for x in range(11)]
    assert numbers(sample_by_distance(placed([*there, *there[-2::-1]]), 5.0)) == [0, 5, 10, 15, 20]


@settings(max_examples=25, deadline=None)
@given(choice=st.lists(st.integers(0, 3), min_size=1, max_size=12), alike=st.floats(-0.5, 0.99))
def test_by_change_agrees_with_the_filter_for_stationary_places(choice: list[int], alike: float) -> None:
    rng = np.random.default_rng(5)
    scenes = rng.integers(0, 256, (4, 32, 64, 1), dtype=np.uint8)
    pictures = [scenes[scene] for scene in choice]
    frames = (ForeignFrame(str(number), picture) for number, picture in enumerate(pictures))
    expected = np.flatnonzero(~stationary_places([np.stack(pictures)], above=alike)).tolist()
    assert numbers(sample_by_change(frames, alike)) == expected


def test_by_change_reads_files_encoded_images_and_pixels(tmp_path: Path) -> None:
    scenes = np.random.default_rng(6).integers(0, 256, (2, 32, 64, 3), dtype=np.uint8)
    Image.fromarray(scenes[0]).save(tmp_path / "a.png")
    buffer = io.BytesIO()
    Image.fromarray(scenes[0]).save(buffer, "PNG")
    contents = [tmp_path / "a.png", Encoded(buffer.getvalue(), ".png"), scenes[0], scenes[1], scenes[1]]
    frames = (ForeignFrame(str(number), content) for number, content in enumerate(contents))
    assert numbers(sample_by_change(frames, 0.95)) == [0, 3]


def test_what_sampling_needs_is_named() -> None:
    with pytest.raises(ConfigError, match=r"every_seconds needs the time .* 'a' has none; sample with every_frames"):
        next(sample_by_time(iter([ForeignFrame("a", EMPTY)]), 1.0))
    with pytest.raises(ConfigError, match="every_metres needs the pose"):
        next(sample_by_distance(iter([ForeignFrame("a", EMPTY)]), 1.0))
