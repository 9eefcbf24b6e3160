"""The loop against a plain one written out here; batches made ahead, and numbers gone wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from everplace.errors import DivergedError
from everplace.model.checkpoint import load_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import MODEL_KINDS, ModelConfig
from everplace.model.pixels import to_input
from everplace.model.place_head import PlaceHead
from everplace.route.route import Route
from everplace.threads import map_ahead
from everplace.training import devices
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from everplace.training.frames import Batch, TrainingFrames, split_route
from everplace.training.loop import GRADIENT_NORM
from everplace.training.metrics_table import read_metrics
from everplace.training.run_keeper import RunKeeper
from everplace.training.step import bound_terms, step_noise

MakeConfig = Callable[..., TrainConfig]


def trained_plainly(route: Route, config: TrainConfig) -> tuple[dict[str, torch.Tensor], list[float]]:
    """Weights after the last epoch and the bound of each, by a loop of torch alone in float32, all rates the same."""
    split = split_route(route, config)
    frames = TrainingFrames(split, config.augmentation, config.batch_size, config.seed)
    torch.manual_seed(config.seed)
    model = ConditionVAE(
        ModelConfig(
            kind=config.model, height=32, width=32, fully_connected=config.fully_connected,
            conditions=split.conditions if config.model in ("c-vae", "cp-vae") else (),
            places=split.places if config.model == "cp-vae" else 0,
        )
    )  # fmt: skip
    model.initialise()
    optimizer = torch.optim.AdamW(model.parameters(), lr=1.0, weight_decay=config.weight_decay, fused=True)
    assert config.epochs is not None
    model.train()
    bounds = []
    for epoch in range(config.epochs):
        total, square = 0.0, torch.zeros(())
        for index, positions in enumerate(frames.order(epoch)):
            batch = frames.batch(epoch, positions)
            x = to_input(batch.images)
            output = model(x, step_noise(config.seed, epoch * len(frames) + index, len(x), 128))
            error = (x - output.reconstruction).square().mean()
            log_sigma = -6.0 + torch.nn.functional.softplus(0.5 * torch.log(error + 1e-12) + 6.0)
            warm = min(1.0, (epoch + (index + 1) / len(frames)) / config.warmup_epochs)
            given = config.weights
            weights = given.model_copy(
                update={"beta_place": given.beta_place * warm, "beta_condition": given.beta_condition * warm}
            )
            places = batch.places if config.model == "cp-vae" else None
            bound = bound_terms(model, x, output, log_sigma, batch.conditions, places, weights)["bound"].mean()
            if isinstance(model.place_head, PlaceHead):
                model.place_head.follow(output.posterior.mean.detach()[:, :96], batch.places)
            optimizer.zero_grad()
            torch.autograd.backward(-bound / x[0].numel())
            torch.nn.utils.clip_grad_norm_(model.parameters(), GRADIENT_NORM)
            done = (epoch + index / len(frames)) / config.epochs
            rate = min(1.0, (done + 1e-3) / 0.03) * 0.5 * (1.0 + math.cos(math.pi * done))
            optimizer.param_groups[0]["lr"] = config.learning_rate * rate
            optimizer.step()
            total += float(bound.detach())
            square = square + error.detach()
        bounds.append(total / len(frames))
        mean_square = square / len(frames)
        model.log_sigma.copy_(-6.0 + torch.nn.functional.softplus(0.5 * torch.log(mean_square + 1e-12) + 6.0))
    return model.state_dict(), bounds


@pytest.mark.parametrize("model", MODEL_KINDS)
def test_a_run_gives_the_weights_of_a_plain_loop(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: str
) -> None:
    monkeypatch.setattr(devices, "bf16_is_fast", lambda _: False)
    config = make_config(model=model, epochs=3, validate_every=3, fully_connected_rate=1.0, warmup_epochs=2.0)
    with torch.random.fork_rng():
        expected, bounds = trained_plainly(route, config)
    train(route, config, tmp_path / "run")
    found = load_checkpoint(tmp_path / "run").model.state_dict()
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert torch.equal(found[name], value), name
    np.testing.assert_allclose(read_metrics(tmp_path / "run")["bound"], bounds, rtol=1e-5)


def test_a_run_is_the_same_whether_its_batches_are_made_ahead_or_not(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = make_config(epochs=3, batch_size=4, augmentation={"shift": 0.1, "brightness": 0.2})
    train(route, config, tmp_path / "one")
    made: list[int] = []

    def ahead(frames: TrainingFrames, epoch: int, rank: int, world: int, device: torch.device) -> Iterator[Batch]:
        made.append(epoch)
        return map_ahead(lambda positions: frames.batch(epoch, positions), frames.order(epoch, rank, world), threads=3)

    monkeypatch.setattr(TrainingFrames, "batches", ahead)
    train(route, config, tmp_path / "other")
    assert made == [0, 1, 2]
    one, other = (load_checkpoint(tmp_path / name).model.state_dict() for name in ("one", "other"))
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize(("validate_every", "said"), [(1, "the last good checkpoint stands; "), (9, "")])
def test_weights_gone_wrong_stop_the_run_and_a_checkpoint_is_spoken_of_only_where_there_is_one(
    route: Route,
    make_config: MakeConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    validate_every: int,
    said: str,
) -> None:
    keep = RunKeeper.keep

    def keep_and_poison(keeper: RunKeeper, model: ConditionVAE, *rest: Any, **options: Any) -> None:
        keep(keeper, model, *rest, **options)
        with torch.no_grad():
            model.decoder.output.weight[0] = torch.nan

    monkeypatch.setattr(RunKeeper, "keep", keep_and_poison)
    wrong = f"training diverged in epoch 2: image is not finite; {said}try a lower learning_rate or smaller weights"
    with pytest.raises(DivergedError, match=f"^{wrong}$"):
        train(route, make_config(epochs=4, validate_every=validate_every), tmp_path / "run")
    assert (tmp_path / "run" / "checkpoint.json").exists() is bool(said)
