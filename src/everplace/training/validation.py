"""Which epoch is kept: retrieval between the traverses on held-out places, or the bound where they are not aligned."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import similarity
from everplace.model.bounds import Weights
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import inference
from everplace.model.pixels import to_input
from everplace.route.truth import tolerance_band
from everplace.scoring.scores import evaluate
from everplace.training.config import TrainConfig
from everplace.training.frames import FrameBlock, SplitRoute
from everplace.training.step import bound_terms, step_noise

__all__ = ["criterion_name", "validate"]

_BATCH = 32


def criterion_name(split: SplitRoute, config: TrainConfig) -> str:
    """The column of the metrics that chooses the epoch; higher is better.

    A projection of oriented gradients finds places before the first epoch. How many it finds of the few that are held
    out then says nothing about the rest of the model, and the bound chooses.
    """
    comparable = split.aligned and len(split.held_out) > 1
    return "held_out_recall_at_1" if comparable and not config.oriented_gradients else "held_out_bound"


def validate(model: ConditionVAE, split: SplitRoute, tolerance: int, weights: Weights) -> dict[str, float]:
    """Measures a model on the held-out frames, without touching its state.

    Args:
        model: On any device; its mode is restored.
        split: The held-out blocks.
        tolerance: A match this many places away is right.
        weights: Weights of the bound's terms; CP-VAE's place term is left out, since these places have no class.

    Returns:
        `held_out_bound`, a mean over frames in nats (for the CAE its objective), and for aligned traverses
        `held_out_recall_at_1` and `held_out_auc_pr`, means over all ordered pairs of traverses. The bound alone, as
        NaN, where the model gives numbers that are not finite.
    """
    was_training = model.training
    model.eval()
    try:
        with inference():
            parts = [_encode(model, block, weights, index) for index, block in enumerate(split.held_out)]
    finally:
        model.train(was_training)
    bounds = torch.cat([bound for _, bound in parts])
    measured = {"held_out_bound": float(bounds.mean())}
    finite = all(torch.isfinite(descriptors).all() for descriptors, _ in parts)
    if not finite:
        measured["held_out_bound"] = math.nan
    if not finite or not split.aligned or len(parts) < 2:
        return measured
    places = range(len(parts[0][0]))
    truth = tolerance_band(places, places, tolerance)
    names = tuple(str(place) for place in places)
    described = [Descriptors(z.numpy(), names, method=model.config.kind) for z, _ in parts]
    scores = [
        evaluate(similarity(query, database), truth)
        for query in described
        for database in described
        if query is not database
    ]
    measured["held_out_recall_at_1"] = float(np.mean([score.recall_at["1"] for score in scores]))
    measured["held_out_auc_pr"] = float(np.mean([score.auc_pr for score in scores]))
    return measured


def _encode(model: ConditionVAE, block: FrameBlock, weights: Weights, seed: int) -> tuple[Tensor, Tensor]:
    """Descriptors (N, D) and bounds (N,) of a block, on the CPU."""
    device = model.log_sigma.device
    descriptors, bounds = [], []
    for start in range(0, len(block.pixels), _BATCH):
        images = to_input(torch.from_numpy(block.pixels[start : start + _BATCH].copy()).to(device))
        noise = step_noise(seed, start, len(images), model.config.latent_dimensions).to(device)
        output = model(images, noise)
        conditions = torch.full((len(images),), block.condition, device=device)
        terms = bound_terms(model, images, output, model.log_sigma, conditions, None, weights)
        mean = output.posterior.mean
        descriptors.append(model.split.z_p(mean) if model.config.labelled else mean)
        bounds.append(terms["bound"])
    return torch.cat(descriptors).float().cpu(), torch.cat(bounds).float().cpu()
