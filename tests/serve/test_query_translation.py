"""A query in another condition, where the map's method decodes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from tests.serve.running_service import RunningService, running

from everplace.audit.leakage import encode_frames
from everplace.experiments.translations import decode_latents
from everplace.images.decoding import ImageSpec, convert_image, decode_encoded, decode_image
from everplace.mapping.route_map import Map
from everplace.model.checkpoint import load_checkpoint, save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig

SEEN = ImageSpec((32, 64))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C-VAE as it is before training, which decodes something of each latent."""
    torch.manual_seed(0)
    model = ConditionVAE(ModelConfig(kind="c-vae", conditions=("summer", "winter"), height=32, width=64, channels=3))
    path = tmp_path_factory.mktemp("run")
    save_checkpoint(path, model.eval(), {})
    (path / "config.toml").write_text('model = "c-vae"\n')
    return path


@pytest.fixture(scope="module")
def decoding_map(run: Path, unchanged_tiny_route: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("decoding") / "map"
    Map.create(path, unchanged_tiny_route / "summer", method=str(run)).add(unchanged_tiny_route / "winter")
    return path


@pytest.fixture(scope="module")
def decoding(decoding_map: Path) -> Iterator[RunningService]:
    with running(decoding_map) as served:
        yield served


def translated(service: RunningService, image: Path, condition: str) -> np.ndarray:
    response = service.client.post("/translate", files={"image": image.read_bytes()}, data={"condition": condition})
    assert response.headers["content-type"] == "image/png"
    return np.asarray(Image.open(io.BytesIO(response.content)))


def test_it_is_the_place_of_the_query_and_the_mean_condition(
    decoding: RunningService, decoding_map: Path, run: Path, unchanged_tiny_route: Path
) -> None:
    assert decoding.client.get("/map").json()["decodes"] is True
    query = unchanged_tiny_route / "summer" / "3.png"
    model = load_checkpoint(run).model
    z_p = encode_frames(model, convert_image(decode_image(query, ImageSpec()), SEEN)[None]).z_p
    table = Map.open(decoding_map).frames("thumbnail")
    for condition in ("summer", "winter"):
        files = [row["thumbnail"] for row in table.to_pylist() if row["drive"] == condition]
        frames = np.stack([convert_image(decode_encoded("a", file, ImageSpec()), SEEN) for file in files])
        mean = encode_frames(model, frames).z_c.mean(axis=0, keepdims=True)
        expected = decode_latents(model, z_p, mean)[0].astype(int)
        found = translated(decoding, query, condition).astype(int)
        assert found.shape == (32, 64, 3)
        assert np.abs(found - expected).max() <= 1  # of another number of threads
    assert np.ptp(expected) > 0


def test_a_condition_that_the_map_does_not_know(decoding: RunningService, unchanged_tiny_route: Path) -> None:
    image = (unchanged_tiny_route / "summer" / "3.png").read_bytes()
    for condition in ("night", "../summer", ""):
        response = decoding.client.post("/translate", files={"image": image}, data={"condition": condition})
        assert response.status_code in (404, 422)
        assert condition not in response.json()["detail"] or not condition
