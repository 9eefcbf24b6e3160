"""Rates and weights over a run, from their definitions."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch

from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.training.config import TrainConfig
from everplace.training.schedule import RunClock, kl_warm_up, learning_rate, make_optimizer, set_learning_rate

MakeConfig = Callable[..., TrainConfig]


def test_the_rate_warms_up_and_falls_along_a_cosine(make_config: MakeConfig) -> None:
    config = make_config(learning_rate=2.0)
    assert learning_rate(config, 0.0) == pytest.approx(2.0 * 0.001 / 0.03)
    assert learning_rate(config, 0.5) == pytest.approx(1.0)
    assert learning_rate(config, 0.75) == pytest.approx(1.0 + math.cos(0.75 * math.pi))
    assert learning_rate(config, 1.0) == pytest.approx(0.0, abs=1e-12)


def test_the_weight_of_the_divergence_rises_from_nothing_to_its_own(make_config: MakeConfig) -> None:
    config = make_config(warmup_epochs=4.0, weights={"beta_place": 2.0, "beta_condition": 0.5, "place": 7.0})
    half = kl_warm_up(config, 2.0)
    assert (half.beta_place, half.beta_condition, half.place) == (1.0, 0.25, 7.0)
    assert kl_warm_up(config, 9.0) == config.weights
    assert kl_warm_up(make_config(warmup_epochs=0.0), 0.01).beta_place == 1.0


def test_a_run_is_measured_by_its_epochs_or_its_minutes(make_config: MakeConfig) -> None:
    clock = RunClock(make_config(epochs=4), 10, 100.0, shared=lambda _: pytest.fail("epochs need no clock"))
    assert clock.done(1, 5) == pytest.approx(0.375)
    assert clock.seconds >= 100.0
    # All devices go by the seconds of the first.
    by_minutes = RunClock(make_config(minutes=2.0), 10, 0.0, shared=lambda _: 30.0)
    assert by_minutes.done(7, 0) == pytest.approx(0.25)
    assert RunClock(make_config(minutes=2.0), 10, 500.0, shared=lambda seconds: seconds).done(0, 0) == 1.0


def test_chains_and_the_projection_have_rates_of_their_own(make_config: MakeConfig) -> None:
    config = make_config(oriented_gradients=True, fully_connected=True, projection={"rate": 0.25})
    with torch.random.fork_rng():
        model = ConditionVAE(
            ModelConfig(
                kind="cp-vae", height=32, width=64, conditions=("a", "b"), places=3, oriented_gradients=True
            )
        )  # fmt: skip
    optimizer = make_optimizer(model, config)
    set_learning_rate(optimizer, 8.0)
    rates = {id(p): group["lr"] for group in optimizer.param_groups for p in group["params"]}
    assert len(rates) == len(list(model.parameters()))
    projection = model.encoder.place_projection
    assert projection is not None
    assert rates[id(projection.weight)] == 2.0
    chains = {id(p) for chain in model.fully_connected for p in chain.parameters()}
    assert {rates[one] for one in chains} == {8.0 * config.fully_connected_rate}
    assert rates[id(model.decoder.output.weight)] == 8.0
    # The order of a stopped run's moments.
    assert [id(p) for group in optimizer.param_groups for p in group["params"]] == [id(p) for p in model.parameters()]
