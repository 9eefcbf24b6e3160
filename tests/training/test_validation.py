"""The choice of the epoch: measured on held-out frames, without a trace in the model."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import similarity
from everplace.model.bounds import Weights
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input
from everplace.scoring.scores import evaluate
from everplace.training.config import TrainConfig
from everplace.training.frames import FrameBlock, SplitRoute
from everplace.training.step import bound_terms, step_noise
from everplace.training.validation import criterion_name, validate


def pixels(seed: int, frames: int = 9) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (frames, 32, 32, 1), dtype=np.uint8)


def split_of(*blocks: NDArray[np.uint8], aligned: bool = True) -> SplitRoute:
    held_out = tuple(FrameBlock(block, index % 2) for index, block in enumerate(blocks))
    return SplitRoute(("a", "b"), held_out, held_out, aligned)


@pytest.fixture(scope="module")
def model() -> ConditionVAE:
    config = ModelConfig(kind="cp-vae", height=32, width=32, channels=1, conditions=("a", "b"), places=9)
    with torch.random.fork_rng():
        torch.manual_seed(1)
        made = ConditionVAE(config)
        made(torch.rand(16, 1, 32, 32), torch.randn(16, 128))
    made.log_sigma.fill_(-0.5)
    return made


def test_identical_traverses_are_recognised_perfectly(model: ConditionVAE) -> None:
    measured = validate(model, split_of(pixels(0), pixels(0)), 0, Weights())
    assert measured["held_out_recall_at_1"] == 1.0
    assert measured["held_out_auc_pr"] == pytest.approx(1.0)


def test_scores_are_the_mean_over_all_ordered_pairs(model: ConditionVAE) -> None:
    blocks = [pixels(0), pixels(1), np.concatenate([pixels(0, 4), pixels(2, 5)])]
    measured = validate(model, split_of(*blocks), 1, Weights())
    model.eval()
    with torch.no_grad():
        z = [model.descriptor(to_input(torch.from_numpy(block))).numpy() for block in blocks]
    model.train()
    described = [Descriptors(one, tuple("abcdefghi"), method="m") for one in z]
    truth = np.abs(np.subtract.outer(np.arange(9), np.arange(9))) <= 1
    scores = [evaluate(similarity(described[i], described[j]), truth) for i in range(3) for j in range(3) if i != j]
    assert measured["held_out_recall_at_1"] == pytest.approx(np.mean([score.recall_at["1"] for score in scores]))
    assert measured["held_out_auc_pr"] == pytest.approx(np.mean([score.auc_pr for score in scores]))


def test_the_bound_is_that_of_the_held_out_frames_with_the_fixed_sigma(model: ConditionVAE) -> None:
    block = pixels(3)
    measured = validate(model, split_of(block), 0, Weights(condition=4.0))
    images = to_input(torch.from_numpy(block))
    model.eval()
    with torch.no_grad():
        output = model(images, step_noise(0, 0, 9, 128))
        conditions = torch.zeros(9, dtype=torch.long)
        terms = bound_terms(model, images, output, model.log_sigma, conditions, None, Weights(condition=4.0))
    model.train()
    assert measured == {"held_out_bound": pytest.approx(float(terms["bound"].mean()), rel=1e-6)}


@pytest.mark.parametrize("training", [True, False])
def test_model_state_and_mode_and_random_numbers_are_left_alone(model: ConditionVAE, training: bool) -> None:
    model.train(training)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    state = torch.random.get_rng_state()
    first = validate(model, split_of(pixels(0), pixels(1)), 0, Weights())
    assert model.training is training
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    assert torch.equal(torch.random.get_rng_state(), state)
    assert validate(model, split_of(pixels(0), pixels(1)), 0, Weights()) == first
    model.train()


def test_frames_that_are_not_aligned_are_judged_by_the_bound(model: ConditionVAE) -> None:
    apart = split_of(pixels(0), pixels(1, frames=5), aligned=False)
    config = TrainConfig.build(model="cp-vae", epochs=1)
    assert criterion_name(apart, config) == "held_out_bound"
    assert criterion_name(split_of(pixels(0)), config) == "held_out_bound"
    assert criterion_name(split_of(pixels(0), pixels(1)), config) == "held_out_recall_at_1"
    assert set(validate(model, apart, 0, Weights())) == {"held_out_bound"}


def test_a_model_that_is_no_number_any_more_is_told_by_the_bound(model: ConditionVAE) -> None:
    bias = model.encoder.z_mean.bias
    before = bias.detach().clone()
    with torch.no_grad():
        bias[3] = torch.inf
        measured = validate(model, split_of(pixels(0), pixels(1)), 0, Weights())
        bias.copy_(before)
    assert set(measured) == {"held_out_bound"}
    assert np.isnan(measured["held_out_bound"])
