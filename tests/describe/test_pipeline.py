"""The pipeline: order, names, errors, overlap of decoding and describing, bounded memory."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.describe import pipeline
from everplace.describe.describer import Metric
from everplace.describe.pipeline import describe_paths, describe_traverse, time_describer
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, DescriptorsError, ImageError, RouteError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.route.route import open_route

T = TypeVar("T")


@dataclass
class MeanColour:
    """Describes an image by the mean of each channel."""

    image: ImageSpec = field(default_factory=ImageSpec)
    method: str = "mean-colour"
    dimension: int = 3
    metric: Metric = "cosine"
    batches: list[tuple[int, ...]] = field(default_factory=list)

    def settings(self) -> dict[str, str | int | float | bool]:
        return {"channels": 3}

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        self.batches.append(images.shape)
        return np.asarray(images.mean(axis=(1, 2)), np.float32)


class Broken(MeanColour):
    """Returns too few numbers."""

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        return super().describe(images)[:, :2]


class Undecided(MeanColour):
    """Returns NaN for the image whose first pixel is 7."""

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        values = super().describe(images)
        values[images[:, 0, 0, 0] == 7] = np.nan
        return values


@dataclass
class Large(MeanColour):
    """Wants few images at once."""

    batch: int = 4


class Unsure(MeanColour):
    """Also returns a variance."""

    def describe_with_variance(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        values = self.describe(images)
        return values, values + 1


@pytest.fixture
def images(tmp_path: Path) -> list[Path]:
    """Ten flat images of 4×6 pixels; image i has the colour (i, 2i, 7)."""
    paths = [tmp_path / f"{i}.png" for i in range(10)]
    for i, path in enumerate(paths):
        Image.new("RGB", (6, 4), (i, 2 * i, 7)).save(path)
    return paths


def names(paths: Sequence[Path]) -> list[str]:
    return [path.stem for path in paths]


@pytest.mark.parametrize("batch", [1, 3, 10, 64])
def test_rows_stand_in_the_order_of_the_paths(images: list[Path], batch: int) -> None:
    describer = MeanColour()
    backwards = images[::-1]
    result = describe_paths(describer, backwards, names(backwards), batch=batch)
    assert result.names == tuple("9876543210")
    assert result.values.tolist() == [[i, 2 * i, 7] for i in range(9, -1, -1)]
    assert (result.method, result.metric, result.settings) == ("mean-colour", "cosine", {"channels": 3})
    assert result.variance is None
    assert [shape[0] for shape in describer.batches] == [min(batch, 10 - i) for i in range(0, 10, batch)]


@pytest.mark.parametrize(("batch", "described"), [(None, [4, 4, 2]), (7, [7, 3]), (1, [1] * 10)])
def test_a_large_method_chooses_its_batch_where_nobody_else_does(
    images: list[Path], batch: int | None, described: list[int]
) -> None:
    describer = Large()
    assert describe_paths(describer, images, names(images), batch=batch).values[:, 0].tolist() == list(range(10))
    assert [shape[0] for shape in describer.batches] == described


@pytest.mark.parametrize("method", ["hog", "sad"])
def test_the_batch_does_not_change_the_result(tiny_route: Path, method: str) -> None:
    describer = open_describer(method)
    traverse = open_route(tiny_route)["winter"]
    whole = describe_traverse(describer, traverse)
    assert whole.names == traverse.stems
    assert whole.image_names == tuple(path.name for path in traverse.paths)
    assert whole.values.shape == (len(traverse), describer.dimension)
    for batch in (1, 5):
        assert (describe_traverse(describer, traverse, batch=batch).values == whole.values).all()
    alone = describer.describe(decode_image(traverse.paths[3], describer.image)[None])
    assert (alone[0] == whole.values[3]).all()


def test_a_variance_comes_along(images: list[Path]) -> None:
    result = describe_paths(Unsure(), images, names(images), batch=4)
    assert result.variance is not None
    assert (result.variance == result.values + 1).all()


def test_images_of_several_sizes_are_described_where_the_method_takes_them(images: list[Path]) -> None:
    Image.new("RGB", (3, 3), (4, 8, 7)).save(images[4])
    describer = MeanColour()
    result = describe_paths(describer, images, names(images), batch=4)
    assert result.values.tolist() == [[i, 2 * i, 7] for i in range(10)]
    assert describer.batches == [(4, 4, 6, 3), (1, 3, 3, 3), (4, 4, 6, 3), (1, 4, 6, 3)]


def test_an_image_that_cannot_be_decoded_is_named_and_not_skipped(images: list[Path]) -> None:
    images[6].write_bytes(images[6].read_bytes()[:50])
    before = threading.active_count()
    with pytest.raises(ImageError, match=r"6\.png"):
        describe_paths(MeanColour(), images, names(images), batch=4)
    assert threading.active_count() == before


def test_a_value_that_is_not_finite_names_its_frame(images: list[Path]) -> None:
    with pytest.raises(DescriptorsError, match="frame '7' holds NaN"):
        describe_paths(Undecided(), images, names(images), batch=4)


def test_an_array_of_another_shape_is_refused(images: list[Path]) -> None:
    with pytest.raises(DescriptorsError, match=r"mean-colour returned an array of shape \(4, 2\), not \(4, 3\)"):
        describe_paths(Broken(), images, names(images), batch=4)


def test_misuse_is_refused(images: list[Path]) -> None:
    with pytest.raises(RouteError, match="no images to describe"):
        describe_paths(MeanColour(), [], [])
    with pytest.raises(RouteError, match="no images to time"):
        time_describer(MeanColour(), [])
    with pytest.raises(DescriptorsError, match="10 images for 1 names"):
        describe_paths(MeanColour(), images, ["a"])
    with pytest.raises(ConfigError, match="batch of 0"):
        describe_paths(MeanColour(), images, names(images), batch=0)


def test_progress_counts_described_frames(images: list[Path]) -> None:
    seen: list[Any] = []

    def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        seen.append((what, total))
        for item in items:
            seen.append(item)
            yield item

    describe_paths(MeanColour(), images, names(images), batch=4, progress=progress)
    assert seen[0] == ("describing", 10)
    assert len(seen) == 11


@dataclass
class Camera:
    """Stands in for the decoder: takes a while an image, and counts what is held."""

    seconds: float
    decoded: int = 0

    def __call__(
        self, paths: Sequence[Path], spec: ImageSpec, *, threads: int | None = None
    ) -> Iterator[NDArray[np.uint8]]:
        for _ in paths:
            time.sleep(self.seconds)
            self.decoded += 1
            yield np.zeros((2, 2, 3), np.uint8)


@dataclass
class Slow(MeanColour):
    """Takes a while an image, and notes how far the decoder was ahead."""

    seconds: float = 0.0
    camera: Camera | None = None
    described: int = 0
    ahead: list[int] = field(default_factory=list)

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        time.sleep(self.seconds * len(images))
        self.described += len(images)
        if self.camera is not None:
            self.ahead.append(self.camera.decoded - self.described)
        return super().describe(images)


@dataclass
class Waiting(MeanColour):
    """Describes a batch only once the next one is being decoded."""

    camera: Camera = field(default_factory=lambda: Camera(0.0))
    frames: int = 0
    described: int = 0

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        self.described += len(images)
        until = time.monotonic() + 30
        while self.camera.decoded < min(self.described + 1, self.frames):
            assert time.monotonic() < until, "nothing is decoded while a batch is described"
            time.sleep(0.001)
        return super().describe(images)


def test_decoding_and_describing_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    count, batch = 40, 8
    paths = [Path(str(i)) for i in range(count)]
    monkeypatch.setattr(pipeline, "decode_images", camera := Camera(0.001))
    describer = Waiting(camera=camera, frames=count)
    describe_paths(describer, paths, names(paths), batch=batch)
    assert describer.described == count


def test_images_are_not_held_beyond_two_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [Path(str(i)) for i in range(200)]
    camera = Camera(0.0)
    monkeypatch.setattr(pipeline, "decode_images", camera)
    describer = Slow(seconds=0.0005, camera=camera)
    describe_paths(describer, paths, names(paths), batch=8)
    assert max(describer.ahead) <= 8 + 1  # the next batch, and the image that showed it to be full


def test_time_is_that_of_one_image_without_decoding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "decode_images", Camera(0.2))
    describer = Slow(seconds=0.004)
    paths = [Path(str(i)) for i in range(20)]
    assert 4 <= time_describer(describer, paths, frames=5) < 200
    assert [shape[0] for shape in describer.batches] == [1] * 6  # one to warm up
