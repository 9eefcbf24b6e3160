"""The leakage audit: what the bound does not forbid, measured on frames that were not trained on.

The bound of CP-VAE does not say that z_p is free of the condition, nor that z_c is free of the place, nor that z_p
holds anything at all. Three measurements tell (see docs, "How it works"): probes that predict the condition from each
block, retrieval by each block, and the error of images decoded from swapped blocks beside what costs nothing.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import permutations
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import RouteError
from everplace.match.similarity import similarity
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import inference
from everplace.model.pixels import to_input
from everplace.model.posterior import ACTIVE_ABOVE, BLOCKS, LatentSplit
from everplace.route.truth import tolerance_band
from everplace.scoring.scores import evaluate

__all__ = ["Audit", "Latents", "Probe", "SwapError", "audit", "encode_frames"]

_BATCH = 64


@dataclass(frozen=True, slots=True)
class Latents:
    """Posterior means of N frames, with the mean KL divergence of each dimension.

    Attributes:
        z: N×D, the means.
        kl: Mean KL of each dimension, in nats, (D,).
        split: The order of the blocks.
    """

    z: NDArray[np.float32]
    kl: NDArray[np.float32]
    split: LatentSplit

    @property
    def z_p(self) -> NDArray[np.float32]:
        """N×96."""
        return self.split.z_p(self.z)

    @property
    def z_c(self) -> NDArray[np.float32]:
        """N×32."""
        return self.split.z_c(self.z)


@dataclass(frozen=True, slots=True)
class Probe:
    """How well the condition can be predicted from a block, on places that the probe has not seen.

    Attributes:
        linear: Accuracy of logistic regression.
        mlp: Accuracy of a perceptron with one hidden layer of 64.
        chance: Accuracy of guessing the most frequent condition.
    """

    linear: float
    mlp: float
    chance: float


@dataclass(frozen=True, slots=True)
class SwapError:
    """Mean squared error, per pixel value in [0, 1], of frame i in traverse v decoded from z_p of frame i in u.

    The conditions of u and v differ.

    Attributes:
        mean_z_c: With the mean z_c of traverse v: the place can only have come from z_p.
        same_place_z_c: With z_c of the same place in v.
        other_place_z_c: With z_c of another place in v. Where this is much above `same_place_z_c`, z_c carries the
            place.
        unchanged: Baseline: frame i in u itself.
        mean_image: Baseline: the mean image of v.
    """

    mean_z_c: float
    same_place_z_c: float
    other_place_z_c: float
    unchanged: float
    mean_image: float


@dataclass(frozen=True, slots=True)
class Audit:
    """What the two blocks hold, on held-out frames.

    Attributes:
        condition_from_z_p: Wanted: chance. None: all traverses show one condition.
        condition_from_z_c: Wanted: 1. None: all traverses show one condition.
        recall_at_1: Retrieval between the traverses by `z_p`, `z_c` and all of `z`; wanted: z_p the best, z_c none.
        swap: Errors of swap reconstruction. None: all traverses show one condition.
        recall_chance: Recall@1 of a guess.
        active_dimensions: Dimensions of `z_p` and `z_c` whose mean KL divergence is above 0.01 nats.
        kl: KL divergence of `z_p` and `z_c` in nats, a mean over frames.
        kl_per_dimension: The same of each dimension, in the order of the latent.
        places: Places audited.
        frames: Frames audited, in all traverses.
        divided: Whether the model's labels divide z; False: a plain VAE, for which the blocks are only its first 96
            and last 32 dimensions.
        tolerance: Retrieval counts a match that is this many of the audited places away as right.
    """

    condition_from_z_p: Probe | None
    condition_from_z_c: Probe | None
    recall_at_1: dict[str, float]
    recall_chance: float
    swap: SwapError | None
    active_dimensions: dict[str, int]
    kl: dict[str, float]
    kl_per_dimension: dict[str, list[float]]
    places: int
    frames: int
    divided: bool
    tolerance: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


def encode_frames(model: ConditionVAE, pixels: NDArray[np.uint8]) -> Latents:
    """Encodes N×H×W×C uint8 frames in batches; the model stays on its device and in evaluation mode."""
    device = model.log_sigma.device
    means: list[Tensor] = []
    kl = torch.zeros(model.config.latent_dimensions, device=device)
    model.eval()
    with inference():
        for images in _batches(pixels, device):
            posterior = model.encoder(images)
            means.append(posterior.mean.cpu())
            kl += posterior.kl().sum(0)
    return Latents(torch.cat(means).numpy(), (kl / len(pixels)).cpu().numpy(), model.split)


def audit(
    model: ConditionVAE,
    frames: Sequence[NDArray[np.uint8]],
    tolerance: int,
    *,
    conditions: Sequence[str],
) -> Audit:
    """Audits a model on the same places seen in several traverses.

    Args:
        model: A trained model; for the plain VAE the two blocks are its first 96 and last 32 dimensions.
        frames: One array N×H×W×C a traverse; row i of each shows the same place.
        tolerance: A match this many places away is right.
        conditions: The condition of each traverse; several may share one.

    Raises:
        RouteError: There are fewer than two traverses or fewer than four places.
    """
    if len(frames) < 2 or len(frames[0]) < 4:
        raise RouteError("the leakage audit needs two traverses of at least four shared places; widen `frames`")
    latents = [encode_frames(model, pixels) for pixels in frames]
    mean_kl = model.split.blocks(np.mean([part.kl for part in latents], axis=0))
    kl = {symbol: mean_kl[block] for block, symbol in BLOCKS.items()}
    z = {symbol: [model.split.blocks(part.z)[block] for part in latents] for block, symbol in BLOCKS.items()}
    z["z"] = [part.z for part in latents]
    places = range(len(frames[0]))
    truth = tolerance_band(places, places, tolerance)
    return Audit(
        condition_from_z_p=_probe(z["z_p"], conditions),
        condition_from_z_c=_probe(z["z_c"], conditions),
        recall_at_1={name: _recall(blocks, truth) for name, blocks in z.items()},
        recall_chance=float(truth.mean()),
        swap=_swap_error(model, frames, latents, conditions),
        active_dimensions={symbol: int((of_block > ACTIVE_ABOVE).sum()) for symbol, of_block in kl.items()},
        kl={symbol: float(of_block.sum()) for symbol, of_block in kl.items()},
        kl_per_dimension={symbol: of_block.tolist() for symbol, of_block in kl.items()},
        places=len(frames[0]),
        frames=sum(map(len, frames)),
        divided=model.config.labelled,
        tolerance=tolerance,
    )


def _probe(blocks: Sequence[NDArray[np.float32]], conditions: Sequence[str]) -> Probe | None:
    """Fits on one contiguous half of the places and scores on the other, both ways round."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression
    from sklearn.neural_network import MLPClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    shares = [count / len(conditions) for count in Counter(conditions).values()]
    if len(shares) < 2:
        return None
    places = np.tile(np.arange(len(blocks[0])), len(blocks))
    values = np.concatenate(blocks)
    classes = np.repeat(conditions, len(blocks[0]))
    first = places < len(blocks[0]) // 2
    # Regularised and fitted to the end: a probe that is stopped early, on few frames, misses leaks that are there.
    probes = {
        "linear": LogisticRegression(max_iter=1000),
        "mlp": MLPClassifier((64,), solver="lbfgs", alpha=1.0, max_iter=300, random_state=0),
    }
    accuracy = {}
    for name, probe in probes.items():
        scores = []
        for fit in (first, ~first):
            with warnings.catch_warnings():
                # The last digits of the weights do not matter here.
                warnings.simplefilter("ignore", ConvergenceWarning)
                fitted = make_pipeline(StandardScaler(), probe).fit(values[fit], classes[fit])
            scores.append(fitted.score(values[~fit], classes[~fit]))
        accuracy[name] = float(np.mean(scores))
    return Probe(**accuracy, chance=max(shares))


def _recall(blocks: Sequence[NDArray[np.float32]], truth: NDArray[np.bool_]) -> float:
    """Recall@1 by cosine, a mean over all ordered pairs of traverses."""
    names = tuple(map(str, range(len(truth))))
    described = [Descriptors(block, names, method="block") for block in blocks]
    pairs = permutations(described, 2)
    return float(np.mean([evaluate(similarity(a, b), truth).recall_at["1"] for a, b in pairs]))


def _swap_error(
    model: ConditionVAE,
    frames: Sequence[NDArray[np.uint8]],
    latents: Sequence[Latents],
    conditions: Sequence[str],
) -> SwapError | None:
    """A mean over all ordered pairs of traverses whose conditions differ."""
    errors = [
        _swap_pair(model, (frames[u], frames[v]), (latents[u], latents[v]))
        for u, v in permutations(range(len(frames)), 2)
        if conditions[u] != conditions[v]
    ]
    return SwapError(*np.mean(errors, axis=0).tolist()) if errors else None


def _swap_pair(
    model: ConditionVAE,
    frames: tuple[NDArray[np.uint8], NDArray[np.uint8]],
    latents: tuple[Latents, Latents],
) -> tuple[float, ...]:
    """The five errors of one ordered pair of traverses, in the order of `SwapError`."""
    device = model.log_sigma.device
    source, target = frames
    z_p = torch.from_numpy(latents[0].z_p)
    own = torch.from_numpy(latents[1].z_c)
    half = len(own) // 2
    choices = (own.mean(0, keepdim=True).expand_as(own), own, own.roll(half, dims=0))
    mean_image = to_input(torch.from_numpy(_mean(target)[None]).to(device))
    sums = np.zeros(len(choices) + 2)
    with inference():
        start = 0
        for before, after in zip(_batches(source, device), _batches(target, device), strict=True):
            rows = slice(start, start + len(before))
            decoded = [model.decoder(model.split.join(z_p[rows], z_c[rows]).to(device)) for z_c in choices]
            for index, image in enumerate([*decoded, before, mean_image]):
                sums[index] += float((image.clamp(0, 1) - after).square().mean(dim=(1, 2, 3)).sum())
            start = rows.stop
    return tuple((sums / len(source)).tolist())


def _mean(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    total = np.zeros(pixels.shape[1:])
    for start in range(0, len(pixels), _BATCH):
        total += pixels[start : start + _BATCH].sum(axis=0, dtype=np.float64)
    mean: NDArray[np.uint8] = np.rint(total / len(pixels)).astype(np.uint8)
    return mean


def _batches(pixels: NDArray[np.uint8], device: torch.device) -> Iterator[Tensor]:
    for start in range(0, len(pixels), _BATCH):
        yield to_input(torch.from_numpy(np.array(pixels[start : start + _BATCH])).to(device))
