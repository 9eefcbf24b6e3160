"""The projection of oriented gradients: fitted on the training places, and what training then does with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pytest
import torch

from everplace.errors import ConfigError
from everplace.model.checkpoint import load_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input
from everplace.route.route import Route
from everplace.training.config import PlaceProjection, TrainConfig
from everplace.training.fit import train
from everplace.training.frames import FrameBlock, SplitRoute, split_route
from everplace.training.place_projection import fit_place_projection

T = TypeVar("T")
MakeConfig = Callable[..., TrainConfig]


def model(place_dimensions: int = 6) -> ConditionVAE:
    return ConditionVAE(
        ModelConfig(
            kind="cp-vae", height=32, width=32, conditions=("day", "night"), places=8, oriented_gradients=True,
            fully_connected=False, place_dimensions=place_dimensions,
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def split(route: Route, make_config: MakeConfig) -> SplitRoute:
    return split_route(route, make_config())


def z_p(fitted: ConditionVAE, split: SplitRoute, *, mirrored: bool = False) -> list[torch.Tensor]:
    """z_p of the training frames, one tensor a traverse."""
    fitted.eval()
    with torch.no_grad():
        images = [to_input(torch.from_numpy(block.pixels.copy())) for block in split.training]
        return [fitted.descriptor(image.flip(3) if mirrored else image) for image in images]


def test_z_p_finds_the_training_places_and_is_standard(split: SplitRoute) -> None:
    fitted = model()
    fit_place_projection(fitted, split, PlaceProjection())
    day, night = z_p(fitted, split)
    assert (torch.cdist(night, day).argmin(1) == torch.arange(len(day))).all()
    everything = torch.cat([day, night, *z_p(fitted, split, mirrored=True)])
    assert everything.mean(0) == pytest.approx(np.zeros(6), abs=1e-3)
    assert float(everything.var(0, correction=0).mean()) == pytest.approx(1.0, abs=0.01)


def test_a_z_p_larger_than_the_gradients_is_refused(split: SplitRoute) -> None:
    with pytest.raises(ConfigError, match="1024 oriented gradients, too few for a z_p of 1025"):
        fit_place_projection(model(1025), split, PlaceProjection())


def test_rate_0_leaves_the_projection_as_it_starts(
    route: Route, split: SplitRoute, make_config: MakeConfig, tmp_path: Path
) -> None:
    start = model(96)
    fit_place_projection(start, split, PlaceProjection())
    expected = start.encoder.place_projection
    assert expected is not None
    for rate in (0.0, 1.0):
        out = tmp_path / str(rate)
        train(route, make_config(recipe="best", batch_size=8, projection={"rate": rate}), out)
        found = load_checkpoint(out).model.encoder.place_projection
        assert found is not None
        assert torch.equal(found.weight, expected.weight) is (rate == 0.0)


def test_the_bound_chooses_the_epoch(route: Route, make_config: MakeConfig, tmp_path: Path) -> None:
    assert train(route, make_config(recipe="best", batch_size=8), tmp_path / "run").criterion == "held_out_bound"


def test_models_without_place_labels_are_refused(make_config: MakeConfig) -> None:
    with pytest.raises(ConfigError, match="oriented_gradients needs place labels, which c-vae does not use"):
        make_config(model="c-vae", oriented_gradients=True)


def test_what_other_light_changes_is_kept_out(split: SplitRoute) -> None:
    moved = []
    for light in (0.0, 100.0):
        fitted = model()
        fit_place_projection(fitted, split, PlaceProjection(light=light))
        images = to_input(torch.from_numpy(split.training[0].pixels.copy()))
        fitted.eval()
        with torch.no_grad():
            moved.append(float((fitted.descriptor(images.pow(0.6)) - fitted.descriptor(images)).square().mean()))
    assert moved[1] < 0.5 * moved[0]


def test_what_changes_along_a_stretch_is_kept_out() -> None:
    """One drive has a haze of stripes everywhere, the other none: a difference that is no place's."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(60, 200, (4, 4 * 48), np.uint8)
    wide = np.asarray(cv2.resize(coarse, (32 * 48, 32), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    day = wide.reshape(32, 48, 32).transpose(1, 0, 2)[..., None]
    stripes = (20 * np.sin(np.arange(32))).astype(np.int16)[None, :, None, None]
    hazy = (day.astype(np.int16) + stripes).clip(0, 255).astype(np.uint8)
    blocks = tuple(FrameBlock(pixels, index) for index, pixels in enumerate((day, hazy)))
    apart = []
    for stretches in (0.0, 1000.0):
        fitted = ConditionVAE(model().config.model_copy(update={"channels": 1}))
        projection = PlaceProjection(stretches=stretches, light=0.0)
        fit_place_projection(fitted, SplitRoute(("day", "night"), blocks, blocks, True), projection)
        first, second = z_p(fitted, SplitRoute(("day", "night"), blocks, blocks, True))
        apart.append(float((first - second).mean(0).norm() / first.std()))
    assert apart[1] < 0.5 * apart[0]


def test_the_bar_moves_within_a_block_of_places_and_the_solving_is_shown(split: SplitRoute) -> None:
    told: dict[str, tuple[int, int | None]] = {}

    def count(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        for done, item in enumerate(items, start=1):
            told[what] = done, total
            yield item

    fit_place_projection(model(), split, PlaceProjection(), count)
    assert told["the projection"] == (7, 7)  # one block: two traverses, mirrored too, and three kinds of light
    assert told["solving for the projection"] == (1, None)
