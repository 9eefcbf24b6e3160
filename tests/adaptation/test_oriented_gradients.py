"""Oriented gradients: against loops in plain Python, and what they must not notice."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from everplace.adaptation.oriented_gradients import OrientedGradients


def picture(height: int = 32, width: int = 64, seed: int = 0, channels: int = 1) -> Tensor:
    """Smooth structures with strong edges, (1, C, H, W)."""
    rng = np.random.default_rng(seed)
    coarse = rng.random((height // 8, width // 8, channels)).astype(np.float32)
    image = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC).reshape(height, width, channels)
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)[None]).clip(0.1, 0.9))


def by_loops(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """The definition, pixel by pixel, for a grey image with a short side of at most 64."""
    height, width = (side * 64 // min(image.shape) for side in image.shape)
    grey = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR).astype(float)
    rows, columns, cone = height // 8, width // 8, math.radians(22.5)
    cells = np.zeros((rows, columns, 16))
    for y in range(height):
        for x in range(width):
            across = grey[y, min(x + 1, width - 1)] - grey[y, max(x - 1, 0)]
            down = grey[min(y + 1, height - 1), x] - grey[max(y - 1, 0), x]
            for direction in range(16):
                away = math.atan2(down, across) - direction * cone
                share = (math.cos(away) - math.cos(cone)) / (1 - math.cos(cone))
                vote = max(share, 0.0) * math.hypot(across, down)
                for row in range(rows):
                    high = max(0.0, 1 - abs(y - 8 * row - 3.5) / 8) / 8
                    if high:
                        for column in range(columns):
                            wide = max(0.0, 1 - abs(x - 8 * column - 3.5) / 8) / 8
                            cells[row, column, direction] += vote * high * wide
    energy = np.pad((cells**2).sum(2), 1, mode="edge")
    around = np.array([[energy[i : i + 3, j : j + 3].mean() for j in range(columns)] for i in range(rows)])
    normalised: NDArray[np.float64] = (cells / np.sqrt(around + 1e-4)[..., None]).transpose(2, 0, 1).ravel()
    return normalised


@pytest.mark.slow
def test_it_is_the_definition() -> None:
    image = picture(32, 64, seed=1)
    found = OrientedGradients(32, 64)(image)[0].numpy()
    assert found == pytest.approx(by_loops(image[0, 0].numpy()), abs=2e-4)


@pytest.mark.parametrize(
    ("height", "width", "features"),
    [(32, 64, 2048), (64, 32, 2048), (224, 224, 1024), (96, 128, 1408), (64, 128, 2048)],
)
def test_the_grid_has_eight_cells_on_the_short_side(height: int, width: int, features: int) -> None:
    gradients = OrientedGradients(height, width)
    assert gradients.features == features
    assert gradients(torch.rand(2, 3, height, width)).shape == (2, features)


@given(seed=st.integers(0, 1000), gain=st.floats(0.75, 1.1), offset=st.floats(-0.05, 0.05))
@settings(max_examples=25, deadline=None)
def test_brightness_and_contrast_are_gone(seed: int, gain: float, offset: float) -> None:
    gradients, image = OrientedGradients(32, 64), picture(seed=seed)
    before, after = gradients(image), gradients(image * gain + offset)
    assert float((before - after).norm() / before.norm()) < 0.05


def test_a_shadow_over_one_half_hardly_matters() -> None:
    gradients, image = OrientedGradients(32, 64), picture(seed=4)
    shadow = torch.ones(64)
    shadow[:32] = 0.6
    changed = (gradients(image * shadow) - gradients(image)).view(16, 8, 16).square().sum((0, 1))
    whole = gradients(image).view(16, 8, 16).square().sum((0, 1))
    assert (changed[:6] < 0.02 * whole[:6]).all(), "inside the shadow"
    assert (changed[10:] == 0).all(), "outside it"


def test_an_edge_votes_for_the_way_it_gets_brighter() -> None:
    image = torch.zeros(1, 1, 64, 64)
    image[..., 32:] = 1.0
    cells = OrientedGradients(64, 64)(image).view(16, 8, 8)
    assert cells.sum((1, 2)).argmax() == 0
    assert OrientedGradients(64, 64)(1 - image).view(16, 8, 8).sum((1, 2)).argmax() == 8
    assert OrientedGradients(64, 64)(image.transpose(2, 3)).view(16, 8, 8).sum((1, 2)).argmax() == 4


def test_a_turned_image_has_turned_directions() -> None:
    gradients, image = OrientedGradients(64, 64), picture(64, 64, seed=2)
    turned = gradients(torch.rot90(image, 1, (2, 3))).view(16, 8, 8)
    expected = torch.rot90(torch.roll(gradients(image).view(16, 8, 8), -4, 0), 1, (1, 2))
    assert torch.allclose(turned, expected, atol=1e-4)


def test_a_flat_image_has_no_gradients() -> None:
    assert OrientedGradients(32, 64)(torch.full((1, 1, 32, 64), 0.7)).abs().max() < 1e-3


def test_large_images_are_smoothed_before_they_shrink() -> None:
    fine = torch.zeros(1, 1, 256, 256)
    fine[..., ::2] = 1.0  # stripes of one pixel, which a short side of 64 cannot show
    inside = OrientedGradients(256, 256)(fine).view(16, 8, 8)[:, 1:-1, 1:-1]
    assert inside.abs().max() < 1e-3


def test_frames_do_not_depend_on_those_beside_them() -> None:
    gradients = OrientedGradients(32, 64)
    images = torch.cat([picture(seed=seed) for seed in range(19)])
    alone = torch.cat([gradients(image[None]) for image in images])
    assert torch.allclose(gradients(images), alone, atol=1e-5)


def test_autocast_does_not_round() -> None:
    gradients, image = OrientedGradients(32, 64), picture(seed=5)
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(gradients(image), gradients(image.clone()))
        under = gradients(image)
    assert torch.equal(under, gradients(image))


def test_colour_is_averaged() -> None:
    gradients, image = OrientedGradients(32, 64), picture(seed=6, channels=3)
    assert torch.allclose(gradients(image), gradients(image.mean(1, keepdim=True)), atol=1e-5)


class Threads(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Notes in how many threads torch computes."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.seen: set[int] = set()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.seen.add(torch.get_num_threads())
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("frames", [1, 8, 19])
@pytest.mark.parametrize("size", [(224, 224), (32, 64), (96, 128)])
def test_one_thread_computes_what_all_would_to_the_bit(frames: int, size: tuple[int, int]) -> None:
    gradients = OrientedGradients(*size)
    images = torch.rand(frames, 3, *size, generator=torch.Generator().manual_seed(1))
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with torch.no_grad():
            by_two = torch.cat([gradients._describe(block) for block in torch.split(images, 8)])
        with Threads() as threads:
            found = gradients(images)
        assert threads.seen == {1}
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert torch.equal(found, by_two)
