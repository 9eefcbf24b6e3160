"""The leakage audit on models whose answers are known: they read and write the latent as pixels."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from everplace.audit import leakage as module
from everplace.audit.leakage import Audit, Probe, SwapError, audit, encode_frames
from everplace.errors import RouteError
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input
from everplace.model.posterior import Posterior

Pixels = NDArray[np.uint8]


def audited(
    model: ConditionVAE, frames: Sequence[Pixels], tolerance: int, conditions: Sequence[str] | None = None
) -> Audit:
    """An audit of traverses each of which has a condition of its own, unless others are given."""
    return audit(model, frames, tolerance, conditions=conditions or [str(number) for number in range(len(frames))])


class PixelEncoder(nn.Module):
    """The mean of dimension d is the value of pixel d; the variance is that of the prior."""

    def forward(self, images: Tensor) -> Posterior:
        mean = images.flatten(1)[:, :128]
        return Posterior(mean, torch.zeros_like(mean))


class PixelDecoder(nn.Module):
    """Writes the latent into the first 128 pixels and leaves the others black."""

    def forward(self, z: Tensor) -> Tensor:
        return functional.pad(z, (0, 1024 - 128)).view(-1, 1, 32, 32)


def network() -> ConditionVAE:
    config = ModelConfig(
        kind="cp-vae", height=32, width=32, channels=1, conditions=("a", "b"), places=3, fully_connected=False
    )
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return ConditionVAE(config).eval()


@pytest.fixture(scope="module")
def pixel_model() -> ConditionVAE:
    model = network()
    model.encoder, model.decoder = PixelEncoder(), PixelDecoder()  # type: ignore[assignment]
    return model


def pictures(z_p: NDArray[np.integer], z_c: NDArray[np.integer]) -> Pixels:
    """Frames that show z_p (N×96) and z_c (N×32) in their first 128 pixels."""
    frames = np.zeros((len(z_p), 1024), dtype=np.uint8)
    frames[:, :96], frames[:, 96:128] = z_p, z_c
    return frames.reshape(-1, 32, 32, 1)


def codes(seed: int, frames: int, size: int) -> NDArray[np.int64]:
    return np.random.default_rng(seed).integers(0, 256, (frames, size))


def mean_square(a: NDArray[np.integer], b: NDArray[np.integer]) -> float:
    """Of differences of pixel values, per pixel of a frame."""
    return float((((a - b) / 255) ** 2).sum(axis=1).mean() / 1024)


def probes(found: Audit) -> tuple[Probe, Probe]:
    """The probes of z_p and z_c."""
    assert found.condition_from_z_p is not None
    assert found.condition_from_z_c is not None
    return found.condition_from_z_p, found.condition_from_z_c


def swap_of(found: Audit) -> SwapError:
    assert found.swap is not None
    return found.swap


def test_a_latent_that_is_disentangled_is_found_so(pixel_model: ConditionVAE) -> None:
    places = codes(0, 20, 96)
    conditions = [np.tile(code, (20, 1)) for code in codes(1, 2, 32)]
    found = audited(pixel_model, [pictures(places, condition) for condition in conditions], tolerance=0)
    # Both conditions show the same z_p, so whatever a probe says is right for one of the two.
    assert (probes(found)[0].linear, probes(found)[0].mlp) == (0.5, 0.5)
    assert (probes(found)[1].linear, probes(found)[1].mlp) == (1.0, 1.0)
    assert probes(found)[1].chance == 0.5
    assert found.recall_at_1["z_p"] == 1.0
    # All z_c of a condition are the same: each query takes the first frame.
    assert found.recall_at_1["z_c"] == pytest.approx(1 / 20)
    swap = swap_of(found)
    assert [swap.mean_z_c, swap.same_place_z_c, swap.other_place_z_c] == pytest.approx([0, 0, 0], abs=1e-12)
    assert swap.unchanged == pytest.approx(mean_square(conditions[0], conditions[1]))
    assert swap.mean_image == pytest.approx(mean_square(places, places.mean(0).round().astype(int)[None]), rel=1e-4)


def test_a_z_c_that_carries_the_place_is_told(pixel_model: ConditionVAE) -> None:
    """The shortcut: z_c is the place, z_p the condition."""
    places = codes(2, 20, 32)
    conditions = [np.tile(code, (20, 1)) for code in codes(3, 2, 96)]
    found = audited(pixel_model, [pictures(condition, places) for condition in conditions], tolerance=0)
    assert probes(found)[0].linear == 1.0
    assert probes(found)[1].linear == 0.5
    assert found.recall_at_1["z_c"] == 1.0
    assert found.recall_at_1["z_p"] == pytest.approx(1 / 20)
    between = mean_square(conditions[0], conditions[1])
    assert swap_of(found).same_place_z_c == pytest.approx(between)
    assert swap_of(found).other_place_z_c == pytest.approx(between + mean_square(places, np.roll(places, 10, axis=0)))
    mean = places.mean(0)[None] * np.ones((20, 1))
    assert swap_of(found).mean_z_c == pytest.approx(between + mean_square(places * 1000, mean * 1000) / 1e6, rel=1e-4)
    assert swap_of(found).unchanged == pytest.approx(between)


def test_tolerance_counts_places(pixel_model: ConditionVAE) -> None:
    places = codes(4, 12, 96)
    constant = np.tile(codes(5, 1, 32), (12, 1))
    # Each frame of the second condition shows the place two further on.
    frames = [pictures(places, constant), pictures(np.roll(places, -2, axis=0), constant)]
    found = audited(pixel_model, frames, tolerance=1)
    assert found.recall_at_1["z_p"] == 0.0
    # Of 144 pairs 12 are of one place and 2 × 11 of neighbours.
    assert found.recall_chance == pytest.approx(34 / 144)
    # But for the two at the end, whose match is at the start.
    assert audited(pixel_model, frames, tolerance=2).recall_at_1["z_p"] == pytest.approx(10 / 12)


def test_one_leaking_dimension_of_96_is_found_by_both_probes(pixel_model: ConditionVAE) -> None:
    constant = np.zeros((200, 32), dtype=np.int64)
    blocks = [codes(6 + condition, 200, 96) for condition in (0, 1)]
    rng = np.random.default_rng(8)
    for condition, block in enumerate(blocks):
        block[:, 40] = 50 + 150 * condition + rng.integers(0, 50, 200)
    found = audited(pixel_model, [pictures(block, constant) for block in blocks], tolerance=0)
    assert probes(found)[0].linear > 0.95
    assert probes(found)[0].mlp > 0.95


def test_a_leak_that_is_not_linear_is_found_by_the_perceptron(pixel_model: ConditionVAE) -> None:
    """By day two groups of dimensions agree, by night they are opposed; each alone tells nothing."""
    constant = np.zeros((200, 32), dtype=np.int64)
    blocks = [codes(16 + condition, 200, 96) for condition in (0, 1)]
    rng = np.random.default_rng(18)
    for condition, block in enumerate(blocks):
        sign = rng.choice([-1, 1], (200, 1))
        block[:, :8] = 128 + 90 * sign + rng.integers(-20, 20, (200, 8))
        block[:, 8:16] = 128 + 90 * sign * (1 - 2 * condition) + rng.integers(-20, 20, (200, 8))
    found = audited(pixel_model, [pictures(block, constant) for block in blocks], tolerance=0)
    assert probes(found)[0].mlp > 0.95
    assert abs(probes(found)[0].linear - 0.5) < 0.15


def test_what_is_not_there_is_not_found(pixel_model: ConditionVAE) -> None:
    frames = [pictures(codes(20 + c, 150, 96), codes(30 + c, 150, 32)) for c in range(3)]
    found = audited(pixel_model, frames, tolerance=0)
    for probe in probes(found):
        assert probe.chance == pytest.approx(1 / 3)
        assert abs(probe.linear - 1 / 3) < 0.1
        assert abs(probe.mlp - 1 / 3) < 0.1


def test_divergences_and_active_dimensions(pixel_model: ConditionVAE) -> None:
    z_p, z_c = codes(9, 6, 96), codes(10, 6, 32)
    # KL = mean² / 2 here: 0.1² / 2 = 0.005 is below the threshold, 0.2² / 2 = 0.02 above it.
    z_p[:, :90], z_p[:, 90:] = 26, 51
    z_c[:, 1:] = 0
    found = audited(pixel_model, [pictures(z_p, z_c), pictures(z_p, z_c)], tolerance=0)
    assert found.active_dimensions == {"z_p": 6, "z_c": 1}
    assert found.kl["z_p"] == pytest.approx(0.5 * (90 * (26 / 255) ** 2 + 6 * (51 / 255) ** 2), rel=1e-5)
    assert found.kl["z_c"] == pytest.approx(0.5 * ((z_c[:, 0] / 255) ** 2).mean(), rel=1e-5)
    assert found.kl_per_dimension["z_p"] == pytest.approx([0.5 * (26 / 255) ** 2] * 90 + [0.5 * 0.2**2] * 6, rel=1e-4)
    assert found.kl_per_dimension["z_c"][1:] == [0.0] * 31
    assert (found.places, found.frames, found.divided) == (6, 12, True)


def test_encoding_does_not_depend_on_batches() -> None:
    model = network()
    frames = np.random.default_rng(0).integers(0, 256, (130, 32, 32, 1), dtype=np.uint8)
    latents = encode_frames(model, frames)
    with torch.no_grad():
        posterior = model.encoder(to_input(torch.from_numpy(frames)))
    np.testing.assert_allclose(latents.z_p, posterior.mean[:, :96].numpy(), atol=1e-6)
    np.testing.assert_allclose(latents.z_c, posterior.mean[:, 96:].numpy(), atol=1e-6)
    np.testing.assert_allclose(latents.kl, posterior.kl().mean(0).numpy(), rtol=1e-4, atol=1e-7)


def test_swap_errors_of_a_real_network_by_a_direct_computation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_BATCH", 8)
    model = network()
    rng = np.random.default_rng(1)
    frames = [rng.integers(0, 256, (14, 32, 32, 1), dtype=np.uint8) for _ in range(3)]
    found = swap_of(audited(model, frames, tolerance=1))
    images = [to_input(torch.from_numpy(block)) for block in frames]
    rows = []
    with torch.no_grad():
        z = [model.encoder(block).mean for block in images]
        for u in range(3):
            for v in range(3):
                if u == v:
                    continue
                z_c = z[v][:, 96:]
                for_each = (z_c.mean(0).expand(14, 32), z_c, torch.cat([z_c[7:], z_c[:7]]))
                decoded = [model.decoder(torch.cat([z[u][:, :96], part], dim=1)).clamp(0, 1) for part in for_each]
                guesses = [*decoded, images[u], images[v].mean(0, keepdim=True).expand(14, -1, -1, -1)]
                rows.append([float((guess - images[v]).square().mean()) for guess in guesses])
    expected = np.mean(rows, axis=0)
    assert [
        found.mean_z_c, found.same_place_z_c, found.other_place_z_c, found.unchanged, found.mean_image
    ] == pytest.approx(expected.tolist(), rel=1e-4)  # fmt: skip


@pytest.mark.parametrize("places", [4, 5, 9])
def test_a_few_places_are_enough(places: int) -> None:
    rng = np.random.default_rng(places)
    frames = [rng.integers(0, 256, (places, 32, 32, 1), dtype=np.uint8) for _ in range(3)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = audited(network(), frames, tolerance=0)
    assert 0 <= probes(found)[0].mlp <= 1
    assert json.loads(json.dumps(found.to_dict()))["swap"]["unchanged"] == swap_of(found).unchanged


@pytest.mark.parametrize(("traverses", "places"), [(1, 10), (2, 3), (0, 0)])
def test_too_few_traverses_or_places_are_one_clear_error(traverses: int, places: int) -> None:
    frames = [np.zeros((places, 32, 32, 1), dtype=np.uint8) for _ in range(traverses)]
    with pytest.raises(RouteError, match="needs two traverses of at least four shared places; widen `frames`"):
        audited(network(), frames, tolerance=0)


def test_the_audit_is_repeatable_and_leaves_the_model_alone() -> None:
    model = network()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    frames = [np.random.default_rng(c).integers(0, 256, (12, 32, 32, 1), dtype=np.uint8) for c in range(2)]
    assert audited(model, frames, tolerance=1) == audited(model, frames, tolerance=1)
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())


def test_traverses_of_one_condition_are_one_class(pixel_model: ConditionVAE) -> None:
    """z_p holds the drive and z_c the condition: three drives, two of them in winter."""
    places = [codes(40 + drive, 20, 96) for drive in range(3)]
    winter, summer = (np.tile(code, (20, 1)) for code in codes(50, 2, 32))
    frames = [pictures(z_p, z_c) for z_p, z_c in zip(places, (winter, winter, summer), strict=True)]
    found = audited(pixel_model, frames, tolerance=0, conditions=("winter", "winter", "summer"))
    _, probe = probes(found)
    assert (probe.linear, probe.mlp) == (1.0, 1.0)
    assert probe.chance == pytest.approx(2 / 3)
    # As drives they cannot be told apart: the two in winter have the same z_c.
    _, alone = probes(audited(pixel_model, frames, tolerance=0))
    assert alone.linear == pytest.approx(2 / 3)
    # Each winter with summer and back, but not one winter with the other.
    between = [mean_square(places[w], places[2]) + mean_square(winter, summer) for w in (0, 1)]
    assert swap_of(found).unchanged == pytest.approx(np.mean(between))


def test_with_one_condition_there_is_nothing_to_probe_or_swap(pixel_model: ConditionVAE) -> None:
    frames = [pictures(codes(60, 12, 96), codes(61 + drive, 12, 32)) for drive in range(2)]
    found = audited(pixel_model, frames, tolerance=0, conditions=["rain", "rain"])
    written = json.loads(json.dumps(found.to_dict()))
    assert [written[key] for key in ("condition_from_z_p", "condition_from_z_c", "swap")] == [None, None, None]
    assert written["recall_at_1"]["z_p"] == 1.0
    assert set(written) == {
        "condition_from_z_p",
        "condition_from_z_c",
        "recall_at_1",
        "swap",
        "recall_chance",
        "active_dimensions",
        "kl",
        "kl_per_dimension",
        "places",
        "tolerance",
        "frames",
        "divided",
    }
