"""Figures 6 to 9 and translation strips: the right blocks of the right frames, for any number of conditions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from everplace.errors import CheckpointError, RouteError
from everplace.experiments.translations import constant_figure, load_divided, swap_figure, translation_figure
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input, to_pixels
from everplace.plots.canvas import png_bytes
from everplace.route.route import Route, open_route

PLACES = 6
SIDE = 32


def network(channels: int = 1, seed: int = 0) -> ConditionVAE:
    settings = {"kind": "c-vae", "height": SIDE, "width": SIDE, "channels": channels, "conditions": ("a", "b")}
    config = ModelConfig.model_validate({**settings, "fully_connected": False})
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return ConditionVAE(config).eval()


def make_route(root: Path, names: list[str], *, channels: int = 1) -> Route:
    """A route of noise, lossless and of the model's size."""
    for number, name in enumerate(names):
        rng = np.random.default_rng(number)
        (root / name).mkdir(parents=True)
        for place in range(PLACES):
            pixels = rng.integers(0, 256, (SIDE, SIDE, channels), dtype=np.uint8)
            Image.fromarray(pixels.squeeze()).save(root / name / f"{place}.png")
    return open_route(root)


def pixels_of(route: Route, name: str) -> NDArray[np.uint8]:
    images = [np.asarray(Image.open(path)) for path in route[name].paths]
    return np.stack([image if image.ndim == 3 else image[:, :, None] for image in images])


def codes(model: ConditionVAE, frames: NDArray[np.uint8]) -> tuple[torch.Tensor, torch.Tensor]:
    with torch.no_grad():
        mean = model.encoder(to_input(torch.from_numpy(frames.copy()))).mean
    return mean[:, :96], mean[:, 96:]


def drawn(model: ConditionVAE, z_p: torch.Tensor, z_c: torch.Tensor) -> NDArray[np.uint8]:
    with torch.no_grad():
        pixels = to_pixels(model.decoder(torch.cat([z_p, z_c])[None]))[0]
    return np.broadcast_to(pixels, (SIDE, SIDE, 3))


@pytest.mark.parametrize(("conditions", "channels"), [(2, 3), (3, 1), (6, 3)])
def test_all_three_figures_of_any_route(tmp_path: Path, conditions: int, channels: int) -> None:
    names = ["autumn", "night", "rain", "spring", "summer", "winter"][:conditions]
    route = make_route(tmp_path, names, channels=channels)
    model = network(channels)
    figures = [
        swap_figure(model, route, label="run"),
        constant_figure(model, route, count=4, label="run"),
        translation_figure(model, route, label="run"),
    ]
    # Two headers and the square; 4 places of each with its decoded image; 3 places with their translations.
    images = [2 * conditions + conditions**2, 2 * 4 * conditions, 3 * (1 + 2 * conditions)]
    assert [len(figure.axes[0].images) for figure in figures] == images
    for figure in figures:
        assert set(names) <= {text.get_text().partition(" ")[0] for text in figure.axes[0].texts}
        assert png_bytes(figure, 40).startswith(b"\x89PNG")


def test_a_swap_takes_the_place_of_the_row_and_the_condition_of_the_column(tmp_path: Path) -> None:
    route, model = make_route(tmp_path, ["summer", "winter"]), network()
    axes = swap_figure(model, route, 4, label="run").axes[0]
    z_p, z_c = zip(*(codes(model, pixels_of(route, name)[4:5]) for name in ("summer", "winter")), strict=True)
    shown = [np.asarray(image.get_array()) for image in axes.images]
    for row in (0, 1):
        for column in (0, 1):
            expected = drawn(model, z_p[row][0], z_c[column][0])
            np.testing.assert_allclose(shown[4 + 2 * row + column], expected, atol=1)
    assert "run: place 4 with z_p and z_c swapped" in [text.get_text() for text in axes.texts]


def test_the_constant_is_the_mean_of_all_frames_of_the_first_traverse(tmp_path: Path) -> None:
    route, model = make_route(tmp_path, ["summer", "winter"]), network()
    axes = constant_figure(model, route, count=2, label="run").axes[0]
    constant = codes(model, pixels_of(route, "summer"))[1].mean(0)
    z_p = codes(model, pixels_of(route, "winter"))[0]
    shown = [np.asarray(image.get_array()) for image in axes.images]
    np.testing.assert_allclose(shown[6], drawn(model, z_p[0], constant), atol=1)
    np.testing.assert_allclose(shown[7], drawn(model, z_p[-1], constant), atol=1)


def test_a_translation_has_the_mean_z_c_of_each_condition_above_its_true_frame(tmp_path: Path) -> None:
    make_route(tmp_path, ["a", "b", "c"])
    (tmp_path / "route.toml").write_text(
        '[traverses.a]\ncondition = "dry"\n[traverses.b]\ncondition = "wet"\n[traverses.c]\ncondition = "wet"\n'
    )
    route, model = open_route(tmp_path), network()
    axes = translation_figure(model, route, count=2, source="c", label="run").axes[0]
    frames = {name: pixels_of(route, name) for name in "abc"}
    z_p = codes(model, frames["c"])[0]
    means = [
        codes(model, frames["a"])[1].mean(0),
        codes(model, np.concatenate([frames["b"], frames["c"]]))[1].mean(0),
    ]
    shown = [np.asarray(image.get_array()) for image in axes.images]
    # The frame; dry and wet as decoded; dry and wet as they are, of which wet is the source's own.
    expected = [frames["c"][-1], *(drawn(model, z_p[-1], mean) for mean in means), frames["a"][-1], frames["c"][-1]]
    assert len(shown) == 2 * len(expected)
    for image, one in zip(shown[len(expected) :], expected, strict=True):
        np.testing.assert_allclose(image, np.broadcast_to(one, image.shape), atol=1)
    assert {"c 0", "c 5", "dry", "wet"} <= {text.get_text() for text in axes.texts}


@pytest.mark.parametrize("kind", ["vae", "cae"])
def test_a_latent_that_is_not_divided_is_one_clear_error(tmp_path: Path, kind: str) -> None:
    settings = {"kind": kind, "height": 32, "width": 32, "channels": 1, "fully_connected": False}
    model = ConditionVAE(ModelConfig.model_validate(settings))
    save_checkpoint(tmp_path / "run", model, {})
    with pytest.raises(CheckpointError, match=f"run is a run of {kind}, which has no z_p and z_c .* c-vae or a cp-vae"):
        load_divided(str(tmp_path / "run"))


def test_places_and_traverses_that_are_not_there_are_named(tmp_path: Path) -> None:
    route, model = make_route(tmp_path, ["summer", "winter"]), network()
    for place in (PLACES, -1):
        with pytest.raises(RouteError, match=f"no place {place}, the traverses share 6; choose one from 0 to 5"):
            swap_figure(model, route, place, label="run")
    with pytest.raises(RouteError, match="'hail'"):
        translation_figure(model, route, source="hail", label="run")
    for path in (tmp_path / "winter").iterdir():
        path.rename(path.with_name(f"w{path.name}"))
    apart = open_route(tmp_path)
    for figure in (swap_figure, constant_figure, translation_figure):
        with pytest.raises(RouteError, match="share no stem, so there is no place to show"):
            figure(model, apart, label="run")
