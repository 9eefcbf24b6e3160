"""What every method inherits: order, names, arrays, errors, overlap of decoding and describing, bounded memory."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.describe import describer as describer_module
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, DescriptorsError, ImageError, RouteError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.route.folder import open_traverse
from everplace.route.route import open_route
from everplace.route.traverse import Traverse

T = TypeVar("T")


class MeanColour(Describer):
    """Describes an image by the mean of each channel."""

    method = "mean-colour"
    image = ImageSpec()
    dimension = 3

    def __init__(self) -> None:
        self.batches: list[tuple[int, ...]] = []

    def settings(self) -> Settings:
        return {"channels": 3}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        self.batches.append(images.shape)
        return np.asarray(images.mean(axis=(1, 2)), np.float32)


class Broken(MeanColour):
    """Returns too few numbers."""

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        return super().describe_batch(images)[:, :2]


class Undecided(MeanColour):
    """Returns NaN for the image whose first pixel is 7."""

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        values = super().describe_batch(images)
        values[images[:, 0, 0, 0] == 7] = np.nan
        return values


class Large(MeanColour):
    """Wants few images at once."""

    batch = 4


class Pixels(Describer):
    """Describes an image by its own pixels."""

    method = "pixels"

    def __init__(self, image: ImageSpec) -> None:
        assert image.size is not None
        self.image = image
        self.dimension = image.size[0] * image.size[1] * image.channels

    def settings(self) -> Settings:
        return {}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        return images.reshape(len(images), -1).astype(np.float32)


@pytest.fixture
def traverse(tmp_path: Path) -> Traverse:
    """Ten flat images of 4×6 pixels; image i has the colour (i, 2i, 7)."""
    for i in range(10):
        Image.new("RGB", (6, 4), (i, 2 * i, 7)).save(tmp_path / f"{i}.png")
    return open_traverse(tmp_path)


@pytest.mark.parametrize("batch", [1, 3, 10, 64])
def test_rows_stand_in_the_order_of_the_frames(traverse: Traverse, batch: int) -> None:
    describer = MeanColour()
    result = describer.describe(traverse[::-1], batch=batch)
    assert result.names == tuple("9876543210")
    assert result.image_names == tuple(f"{i}.png" for i in range(9, -1, -1))
    assert result.values.tolist() == [[i, 2 * i, 7] for i in range(9, -1, -1)]
    assert (result.method, result.metric, result.settings) == ("mean-colour", "cosine", {"channels": 3})
    assert [shape[0] for shape in describer.batches] == [min(batch, 10 - i) for i in range(0, 10, batch)]


def test_a_method_that_says_no_more_than_it_must_has_the_defaults() -> None:
    describer = MeanColour()
    assert (describer.batch, describer.seen_stems) == (32, frozenset())
    assert describer.checkpoint is None
    assert describer.latent_model is None


def test_a_method_without_its_two_methods_cannot_be_made() -> None:
    class Nothing(Describer):
        method = "nothing"

    with pytest.raises(TypeError, match="describe_batch.*settings"):
        Nothing()  # type: ignore[abstract]


@pytest.mark.parametrize("spec", [ImageSpec((20, 30)), ImageSpec((50, 30), grey=True), ImageSpec((64, 48))])
@pytest.mark.parametrize("colour", [True, False])
def test_arrays_are_described_as_the_files_that_hold_them(tmp_path: Path, spec: ImageSpec, colour: bool) -> None:
    shape = (2, 40, 48, 3) if colour else (2, 40, 48)
    arrays = list(np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8))
    for number, array in enumerate(arrays):
        Image.fromarray(array).save(tmp_path / f"{number}.png")
    describer = Pixels(spec)
    files, several = describer.describe(open_traverse(tmp_path)), describer.describe(arrays)
    assert several.names == ("0", "1")
    assert several.image_names is None
    assert np.array_equal(several.values, files.values)
    alone = describer.describe(arrays[1])
    assert alone.names == ("0",)
    assert np.array_equal(alone.values, files.values[1:])


def test_arrays_of_several_sizes_are_described_together() -> None:
    arrays = [np.full((height, 5, 3), height, np.uint8) for height in (4, 4, 7)]
    describer = MeanColour()
    assert describer.describe(arrays).values[:, 0].tolist() == [4, 4, 7]
    assert describer.batches == [(2, 4, 5, 3), (1, 7, 5, 3)]


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 6, 3)),
        np.zeros((4, 6, 4), np.uint8),
        np.zeros((2, 4, 6, 3), np.uint8),
        np.zeros(6, np.uint8),
        np.zeros((0, 6), np.uint8),
        ["a.png"],
    ],
)
def test_what_is_no_image_is_refused(image: Any) -> None:
    with pytest.raises(ImageError, match=r"an image must be H×W \(grey\) or H×W×3 \(RGB\) numbers of uint8, not "):
        MeanColour().describe(image)


@pytest.mark.parametrize(("batch", "described"), [(None, [4, 4, 2]), (7, [7, 3]), (1, [1] * 10)])
def test_a_large_method_chooses_its_batch_where_nobody_else_does(
    traverse: Traverse, batch: int | None, described: list[int]
) -> None:
    describer = Large()
    assert describer.describe(traverse, batch=batch).values[:, 0].tolist() == list(range(10))
    assert [shape[0] for shape in describer.batches] == described


@pytest.mark.parametrize("method", ["hog", "sad"])
def test_the_batch_does_not_change_the_result(tiny_route: Path, method: str) -> None:
    describer = open_describer(method)
    traverse = open_route(tiny_route)["winter"]
    whole = describer.describe(traverse)
    assert whole.names == traverse.stems
    assert whole.image_names == tuple(path.name for path in traverse.paths)
    assert whole.values.shape == (len(traverse), describer.dimension)
    for batch in (1, 5):
        assert (describer.describe(traverse, batch=batch).values == whole.values).all()
    alone = describer.describe_batch(decode_image(traverse.paths[3], describer.image)[None])
    assert (alone[0] == whole.values[3]).all()


def test_images_of_several_sizes_are_described_where_the_method_takes_them(traverse: Traverse) -> None:
    Image.new("RGB", (3, 3), (4, 8, 7)).save(traverse[4].path)
    describer = MeanColour()
    result = describer.describe(traverse, batch=4)
    assert result.values.tolist() == [[i, 2 * i, 7] for i in range(10)]
    assert describer.batches == [(4, 4, 6, 3), (1, 3, 3, 3), (4, 4, 6, 3), (1, 4, 6, 3)]


def test_an_image_that_cannot_be_decoded_is_named_and_not_skipped(traverse: Traverse) -> None:
    path = traverse[6].path
    path.write_bytes(path.read_bytes()[:50])
    before = threading.active_count()
    with pytest.raises(ImageError, match=r"6\.png"):
        MeanColour().describe(traverse, batch=4)
    assert threading.active_count() == before


def test_a_value_that_is_not_finite_names_its_frame(traverse: Traverse) -> None:
    with pytest.raises(DescriptorsError, match="frame '7' holds NaN"):
        Undecided().describe(traverse, batch=4)


def test_an_array_of_another_shape_is_refused(traverse: Traverse) -> None:
    with pytest.raises(DescriptorsError, match=r"mean-colour returned an array of shape \(4, 2\), not \(4, 3\)"):
        Broken().describe(traverse, batch=4)


def test_misuse_is_refused(traverse: Traverse) -> None:
    with pytest.raises(RouteError, match="no images to describe"):
        MeanColour().describe(traverse[:0])
    with pytest.raises(RouteError, match="no images to describe"):
        MeanColour().describe([])
    with pytest.raises(ConfigError, match="batch of 0"):
        MeanColour().describe(traverse, batch=0)


@pytest.mark.parametrize(
    ("colours", "said"),
    [
        ([0, 0, 0, 9], "3 of the 4 descriptors of .*drive are zero"),
        ([7, 0, 7, 9, 7], "3 of the 5 descriptors of .*drive are equal"),
        ([5, 5], "2 of the 2 descriptors of .*drive are equal"),
    ],
)
def test_a_traverse_of_mostly_equal_descriptors_is_warned_of(tmp_path: Path, colours: list[int], said: str) -> None:
    with pytest.warns(UserWarning, match=said):
        MeanColour().describe(drive_of(tmp_path / "drive", colours))


@pytest.mark.parametrize("colours", [[0, 0, 8, 9], [3, 4], [5], [1, 2, 1, 2, 1, 2]])
def test_a_traverse_of_other_descriptors_is_not_warned_of(tmp_path: Path, colours: list[int]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MeanColour().describe(drive_of(tmp_path / "drive", colours))


def drive_of(directory: Path, colours: Sequence[int]) -> Traverse:
    directory.mkdir()
    for number, colour in enumerate(colours):
        Image.new("RGB", (2, 2), (colour,) * 3).save(directory / f"{number}.png")
    return open_traverse(directory)


def test_progress_counts_described_frames(traverse: Traverse) -> None:
    seen: list[Any] = []

    def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        seen.append((what, total))
        for item in items:
            seen.append(item)
            yield item

    MeanColour().describe(traverse, batch=4, progress=progress)
    assert seen[0] == ("describing", 10)
    assert len(seen) == 11


@dataclass
class Camera:
    """Stands in for the decoder: takes a while an image, and counts what is held."""

    seconds: float
    decoded: int = 0

    def __call__(self, paths: Sequence[Path], spec: ImageSpec) -> Iterator[NDArray[np.uint8]]:
        for _ in paths:
            time.sleep(self.seconds)
            self.decoded += 1
            yield np.zeros((2, 2, 3), np.uint8)


class Ahead(MeanColour):
    """Takes a while an image, and notes how far the decoder was ahead."""

    def __init__(self, camera: Camera) -> None:
        super().__init__()
        self.camera = camera
        self.described = 0
        self.ahead: list[int] = []

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        time.sleep(0.0005 * len(images))
        self.described += len(images)
        self.ahead.append(self.camera.decoded - self.described)
        return super().describe_batch(images)


class Waiting(MeanColour):
    """Describes a batch only once the next one is being decoded."""

    def __init__(self, camera: Camera, frames: int) -> None:
        super().__init__()
        self.camera = camera
        self.frames = frames
        self.described = 0

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        self.described += len(images)
        until = time.monotonic() + 30
        while self.camera.decoded < min(self.described + 1, self.frames):
            assert time.monotonic() < until, "nothing is decoded while a batch is described"
            time.sleep(0.001)
        return super().describe_batch(images)


def drive(frames: int) -> Traverse:
    """Frames that only a camera sees."""
    stems = tuple(map(str, range(frames)))
    return Traverse("drive", "drive", Path(), stems, (".png",) * frames)


def test_decoding_and_describing_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(describer_module, "decode_images", camera := Camera(0.001))
    describer = Waiting(camera, 40)
    describer.describe(drive(40), batch=8)
    assert describer.described == 40


def test_images_are_not_held_beyond_two_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(describer_module, "decode_images", camera := Camera(0.0))
    describer = Ahead(camera)
    describer.describe(drive(200), batch=8)
    assert max(describer.ahead) <= 8 + 1  # the next batch, and the image that showed it to be full
