"""Whole runs on a small route: what they leave, how they end, and what they refuse."""

from __future__ import annotations

import json
import math
import shutil
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from everplace.describe.registry import open_describer
from everplace.errors import CheckpointError, ConfigError, DivergedError, EverplaceError, RouteError
from everplace.model.checkpoint import load_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.pixels import to_input
from everplace.route.fingerprint import image_digests
from everplace.route.route import Route, open_route
from everplace.training import devices, fit
from everplace.training.config import TrainConfig
from everplace.training.fit import TrainSummary, train
from everplace.training.frames import images_fingerprint, split_route
from everplace.training.metrics_table import MetricsTable, read_metrics
from everplace.training.resume_state import RunProgress, load_state, save_state
from everplace.training.run_keeper import CollapseWarning, RunKeeper
from everplace.training.step import BoundStep
from everplace.training.validation import validate

MakeConfig = Callable[..., TrainConfig]


@pytest.fixture(scope="module")
def run(
    route: Route, make_config: MakeConfig, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, TrainSummary, TrainConfig]:
    """A finished run of three epochs."""
    out, config = tmp_path_factory.mktemp("runs") / "cp-vae", make_config(epochs=3, fully_connected=True)
    return out, train(route, config, out, save_every=0), config


def apart_route(root: Path) -> Route:
    """Two traverses without a shared stem."""
    rng = np.random.default_rng(0)
    for condition, first in (("day", 0), ("night", 100)):
        (root / condition).mkdir(parents=True)
        for stem in range(first, first + 8):
            Image.fromarray(rng.integers(0, 256, (32, 32, 3), dtype=np.uint8)).save(root / condition / f"{stem}.png")
    return open_route(root)


def test_a_run_leaves_checkpoint_configuration_and_metrics(
    run: tuple[Path, TrainSummary, TrainConfig], route: Route
) -> None:
    out, summary, config = run
    metrics = read_metrics(out)
    assert metrics["epoch"].tolist() == [1, 2, 3]
    assert np.isfinite(metrics["bound"]).all()
    assert metrics["bound"][2] > metrics["bound"][0]
    best = metrics["held_out_recall_at_1"]
    # At equal recall the later epoch is kept.
    assert summary.best_epoch == 3 - int(np.argmax(best[::-1]))
    assert summary.best_value == pytest.approx(best.max())
    assert replace(summary, seconds=0.0) == TrainSummary(
        str(out), "cp-vae", "faithful", (), 3, 0.0, 16, 8, 4, ("day", "night"), "held_out_recall_at_1",
        summary.best_epoch, summary.best_value,
    )  # fmt: skip
    checkpoint = load_checkpoint(out)
    assert checkpoint.about == {
        "recipe": "faithful",
        "remedies": "",
        "seed": 0,
        "epoch": summary.best_epoch,
        "criterion": "held_out_recall_at_1",
        "value": summary.best_value,
        "images": images_fingerprint(split_route(route, config)),
        "trained_stems": [str(place) for place in range(8)],
        "held_out_stems": ["10", "11"],
        "seen_images": sorted(
            digest
            for traverse in route.traverses
            for place, digest in enumerate(image_digests(traverse))
            if place not in (8, 9)
        ),
    }
    assert checkpoint.seen_stems == {str(place) for place in (*range(8), 10, 11)}
    # The sigma that training reached went along, and the measurement can be repeated with it.
    row = summary.best_epoch - 1
    assert checkpoint.model.log_sigma.exp().item() == pytest.approx(metrics["sigma"][row], rel=1e-5)
    measured = validate(checkpoint.model, split_route(route, config), config.tolerance, config.weights)
    assert measured["held_out_bound"] == pytest.approx(metrics["held_out_bound"][row], rel=1e-4)
    assert not [path.name for path in out.rglob("*") if ".part" in path.name]


def test_a_plain_autoencoder_is_trained_chosen_and_described_by_the_same_machinery(
    route: Route, make_config: MakeConfig, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    config = make_config(model="cae", epochs=3, warmup_epochs=0.0)
    train(route, config, tmp_path / "cae")
    assert not [one for one in recwarn if issubclass(one.category, CollapseWarning)]
    metrics = read_metrics(tmp_path / "cae")
    assert metrics["bound"][2] > metrics["bound"][0]
    assert np.isnan(metrics["kl_place"]).all()
    assert np.isfinite(metrics["held_out_recall_at_1"]).all()
    describer = open_describer(str(tmp_path / "cae"))
    assert (describer.method, describer.dimension, describer.metric) == ("cae", 128, "cosine")
    assert describer.seen_stems == {str(place) for place in (*range(8), 10, 11)}
    images = np.random.default_rng(0).integers(0, 256, (3, 32, 32, 3), dtype=np.uint8)
    model = load_checkpoint(tmp_path / "cae").model
    with torch.no_grad():
        expected = model.descriptor(to_input(torch.from_numpy(images))).numpy()
    rounding = 1e-5 if torch.cuda.is_available() else 1e-6
    np.testing.assert_allclose(describer.describe_batch(images), expected, atol=rounding)


def test_resuming_a_finished_run_returns_at_once_with_the_same_summary(
    run: tuple[Path, TrainSummary, TrainConfig], route: Route
) -> None:
    out, summary, config = run
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.name != "config.toml"}
    assert train(route, config, out, resume=True) == summary
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.name != "config.toml"} == before


def test_a_finished_run_is_not_trained_over(run: tuple[Path, TrainSummary, TrainConfig], route: Route) -> None:
    out, _, config = run
    with pytest.raises(ConfigError, match="already holds a run; add `resume=True`"):
        train(route, config, out)


def test_the_same_seed_gives_the_same_weights_and_leaves_random_numbers_alone(
    run: tuple[Path, TrainSummary, TrainConfig], route: Route, tmp_path: Path
) -> None:
    out, _, config = run
    torch.manual_seed(99)
    state = torch.random.get_rng_state()
    train(route, config, tmp_path / "again")
    assert torch.equal(torch.random.get_rng_state(), state)
    first, again = (load_checkpoint(where).model.state_dict() for where in (out, tmp_path / "again"))
    assert all(torch.equal(first[name], again[name]) for name in first)


@pytest.mark.slow
def test_the_best_recipe_is_trained_named_and_resumed_to_the_same_weights(
    route: Route, make_config: MakeConfig, tmp_path: Path
) -> None:
    config = make_config(epochs=2, recipe="best")
    summary = train(route, config, tmp_path / "whole", save_every=0)
    metrics = read_metrics(tmp_path / "whole")
    assert np.isfinite(metrics["place"]).all()
    checkpoint = load_checkpoint(tmp_path / "whole")
    assert "oriented gradients" in str(checkpoint.about["remedies"])
    assert not list(checkpoint.model.encoder.fully_connected)
    assert summary.frames == 16
    stopped = tmp_path / "stopped"
    train_and_stop_after_an_epoch(route, config, stopped)
    train(route, config, stopped, resume=True, save_every=0)
    again = load_checkpoint(stopped).model.state_dict()
    for name, value in checkpoint.model.state_dict().items():
        assert torch.equal(value, again[name]), name
    assert (read_metrics(stopped)["place"] == metrics["place"]).all()


def train_and_stop_after_an_epoch(route: Route, config: TrainConfig, out: Path) -> None:
    class StopError(Exception):
        pass

    keep = RunKeeper.keep

    def end_early(self: RunKeeper, *rest: Any, **options: Any) -> None:
        keep(self, *rest, **options)
        raise StopError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunKeeper, "keep", end_early)
        with pytest.raises(StopError):
            train(route, config, out, save_every=0)


FORMER = """
[remedies]
contrastive = 0.0
temperature = 0.1
adversary = {adversary}
swap = 0.0
swap_z_c = "same_place"
conditional_prior = false
free_bits = 0.0

[remedies.virtual]
crop = 0.0
mirror = 0.0
join = 0.0
"""


def test_a_run_of_version_0_1_is_resumed_unless_it_had_a_remedy_that_is_gone(
    run: tuple[Path, TrainSummary, TrainConfig], route: Route, tmp_path: Path
) -> None:
    out, summary, config = run
    shutil.copytree(out, tmp_path / "run")
    written = (out / "config.toml").read_text()
    (tmp_path / "run" / "config.toml").write_text(written + FORMER.format(adversary=0.0))
    found = train(route, config, tmp_path / "run", resume=True)
    assert replace(found, run=str(out)) == summary
    (tmp_path / "run" / "config.toml").write_text(written + FORMER.format(adversary=200.0))
    with pytest.raises(ConfigError, match=r"run was trained with remedies\.adversary, .*; name another directory"):
        train(route, config, tmp_path / "run", resume=True)
    (tmp_path / "run" / "metrics.csv").write_text(
        "epoch,seconds,bound,adversary,kl_place\n1,2.5,-3.0,-0.7,4.0\n2,3.5,-2.0,-0.7,5.0\n"
    )
    table = MetricsTable(tmp_path / "run", keep_epochs=1)
    table.append({"epoch": 2.0, "bound": -1.0})
    assert read_metrics(tmp_path / "run")["bound"].tolist() == [-3.0, -1.0]


def test_nothing_is_printed_on_stdout(
    route: Route, make_config: MakeConfig, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    train(route, make_config(model="vae", epochs=1), tmp_path / "run", resume=True, show=True)
    shown = capfd.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("epoch 1 (")
    assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize("minutes", [1e-9, 0.01])
def test_a_run_by_the_clock_ends_near_it_with_a_checkpoint(
    route: Route, make_config: MakeConfig, tmp_path: Path, minutes: float
) -> None:
    summary = train(route, make_config(minutes=minutes, validate_every=1000), tmp_path / "run")
    assert summary.epochs >= 1
    assert summary.best_epoch == summary.epochs
    assert load_checkpoint(tmp_path / "run").about["epoch"] == summary.epochs
    # It stops at the first step after the time; generous for a busy machine.
    assert 60 * minutes <= summary.seconds < 60 * minutes + 20


@pytest.mark.parametrize("model", ["vae", "c-vae"])
def test_traverses_that_are_not_aligned_are_trained_on_and_chosen_by_the_bound(
    make_config: MakeConfig, tmp_path: Path, model: str
) -> None:
    route = apart_route(tmp_path / "route")
    summary = train(route, make_config(model=model, held_out_gap=0), tmp_path / "run")
    assert (summary.criterion, summary.places) == ("held_out_bound", 0)
    assert summary.best_value == pytest.approx(np.nanmax(read_metrics(tmp_path / "run")["held_out_bound"]), rel=1e-5)


def test_what_cannot_be_trained_is_one_clear_error_and_makes_no_directory(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    apart = apart_route(tmp_path / "apart")
    denied = replace(route, stems_are_places=False)
    refused: list[tuple[Route, TrainConfig, int, type[EverplaceError], str]] = [
        (route, make_config(model="c-vae", conditions=("day",)), 1, ConfigError, "c-vae needs at least two conditions"),
        (apart, make_config(held_out_gap=0), 1, RouteError, "share no stem, and cp-vae learns from the same places"),
        (denied, make_config(held_out_gap=0), 1, RouteError, "are not aligned, as route.toml says"),
        (route, make_config(held_out_gap=10), 1, RouteError, "12 frames to train on, too few"),
        (route, make_config(conditions=("dusk",)), 1, RouteError, "'dusk'"),
        (route, make_config(frames="5:1"), 1, ConfigError, "5:1"),
        (route, make_config(batch_size=6), 4, ConfigError, "a batch of 6 frames is too small for 4 devices"),
    ]
    for chosen, config, count, error, message in refused:
        with pytest.raises(error, match=message):
            train(chosen, config, tmp_path / "run", devices=count)
        assert not (tmp_path / "run").exists(), message


def test_more_places_than_the_route_had_is_a_clear_error_when_resuming(
    route: Route, make_config: MakeConfig, tmp_path: Path
) -> None:
    config = make_config()
    train(route, config, tmp_path / "run", save_every=0)
    fewer = torch.nn.Linear(2, 2)
    save_state(tmp_path / "run", RunProgress(epoch=1), fewer, torch.optim.AdamW(fewer.parameters()))
    with pytest.raises(EverplaceError, match="do not fit the model that config.toml and the route make"):
        train(route, config, tmp_path / "run", resume=True)


@pytest.mark.parametrize("batch_size", [8, 16])
def test_a_run_that_diverges_says_so_and_keeps_no_checkpoint_of_it(
    route: Route, make_config: MakeConfig, tmp_path: Path, batch_size: int
) -> None:
    """With all frames in one batch only the validation can tell."""
    config = make_config(learning_rate=1e30, batch_size=batch_size, weights={"image": 1.0})
    with pytest.raises(DivergedError, match=r"diverged in epoch 1: .* is not finite; try a lower learning_rate"):
        train(route, config, tmp_path / "run", save_every=0)
    assert not (tmp_path / "run" / "checkpoint.json").exists()
    assert load_state(tmp_path / "run") is None


def test_the_last_good_checkpoint_outlives_a_run_that_diverges(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, kept = tmp_path / "run", []
    keep = RunKeeper.keep

    def keep_and_poison(self: RunKeeper, model: ConditionVAE, *rest: Any, **options: Any) -> None:
        keep(self, model, *rest, **options)
        kept.append((out / "checkpoint.json").read_bytes())
        with torch.no_grad():
            model.encoder.z_mean.weight[0, 0] = math.nan

    monkeypatch.setattr(RunKeeper, "keep", keep_and_poison)
    with pytest.raises(DivergedError, match=r"diverged in epoch 2: .* not finite; the last good checkpoint stands"):
        train(route, make_config(), out)
    assert [(out / "checkpoint.json").read_bytes()] == kept
    assert all(torch.isfinite(value).all() for value in load_checkpoint(out).model.state_dict().values())


def test_a_state_with_nan_is_not_resumed(route: Route, make_config: MakeConfig, tmp_path: Path) -> None:
    out, config = tmp_path / "run", make_config()
    train(route, config, out)
    model = load_checkpoint(out).model
    with torch.no_grad():
        model.encoder.z_mean.weight[0, 0] = math.nan
    save_state(out, RunProgress(epoch=1, best_epoch=1, best_value=0.0), model, torch.optim.AdamW(model.parameters()))
    with pytest.raises(CheckpointError, match=r"holds NaN or infinity in 'model\.encoder\.z_mean\.weight'"):
        train(route, config, out, resume=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "remedy"), [("cp-vae", "place"), pytest.param("vae", "image", marks=pytest.mark.slow)]
)
def test_a_block_that_collapses_is_warned_of_once(
    route: Route, make_config: MakeConfig, tmp_path: Path, model: str, remedy: str
) -> None:
    weights = {"beta_place": 1e9, "beta_condition": 0.0, "place": 0.0}
    config = make_config(
        model=model,
        weights=weights,
        warmup_epochs=0.0,
        epochs=16,
        batch_size=4,
        validate_every=16,
        learning_rate=1e-2,
        fully_connected=True,
        fully_connected_rate=1.0,
    )
    with pytest.warns(CollapseWarning) as caught:
        train(route, config, tmp_path / "run")
    messages = [str(warning.message) for warning in caught if warning.category is CollapseWarning]
    assert len(messages) == 1
    assert messages[0].startswith("z_p has collapsed in epoch ")
    assert messages[0].endswith(f"try a lower weights.beta_place, a longer warmup_epochs or a higher weights.{remedy}")


def test_a_run_that_ends_while_the_divergence_gains_weight_is_warned_of_a_collapse(
    route: Route, make_config: MakeConfig, tmp_path: Path
) -> None:
    config = make_config(epochs=2, warmup_epochs=9.0)
    split = split_route(route, config)
    keeper = RunKeeper(tmp_path, config, split, "", [], RunProgress(), 60.0)
    row = {"epoch": 2.0, "kl_place": 0.1, "active_place": 0.0, "kl_condition": 5.0, "active_condition": 9.0}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        keeper._warn_of_collapse(row, last=False)
    with pytest.warns(CollapseWarning, match="z_p has collapsed in epoch 2"):
        keeper._warn_of_collapse(row, last=True)


def test_training_in_bfloat16_keeps_the_bound_in_float32(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: set[torch.dtype] = set()
    original = BoundStep.forward

    def noted(step: BoundStep, *given: Any) -> Any:
        loss, means, z_p = original(step, *given)
        seen.update(value.dtype for value in (loss, z_p, *means.values(), *step.parameters()))
        return loss, means, z_p

    monkeypatch.setattr(devices, "bf16_is_fast", lambda _: True)
    monkeypatch.setattr(BoundStep, "forward", noted)
    train(route, make_config(epochs=1, batch_size=4), tmp_path / "run")
    assert seen == {torch.float32}
    assert np.isfinite(read_metrics(tmp_path / "run")["bound"]).all()


def test_json_values_of_a_checkpoint_are_plain(run: tuple[Path, TrainSummary, TrainConfig]) -> None:
    document = json.loads((run[0] / "checkpoint.json").read_text())
    assert document["format"] == 1
    assert document["model"]["places"] == 8
    assert document["model"]["conditions"] == ["day", "night"]


@pytest.mark.parametrize("finished", [True, False])
def test_a_run_is_not_continued_with_other_images(
    run: tuple[Path, TrainSummary, TrainConfig], route: Route, tmp_path: Path, finished: bool
) -> None:
    out, _, config = run
    shutil.copytree(out, tmp_path / "run")
    shutil.copytree(route.root, tmp_path / "route")
    other = tmp_path / "route" / "night" / "11.png"
    shutil.copy(route.root / "night" / "10.png", other)
    if not finished:
        model = load_checkpoint(out).model
        images = load_checkpoint(out).about["images"]
        save_state(tmp_path / "run", RunProgress(epoch=1), model, torch.optim.AdamW(model.parameters()), images)
    before = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    with pytest.raises(ConfigError, match=f"run was trained on other images than {tmp_path / 'route'}; name another"):
        train(open_route(tmp_path / "route"), config, tmp_path / "run", resume=True)
    assert {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()} == before
    # The same images elsewhere are the same.
    shutil.copy(route.root / "night" / "11.png", other)
    if finished:
        assert train(open_route(tmp_path / "route"), config, tmp_path / "run", resume=True).epochs == 3


@pytest.mark.parametrize("what", ["a file", "a run"])
def test_what_stands_at_out_is_refused_before_any_image_is_read(
    route: Route, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    out = tmp_path / "run"
    if what == "a file":
        out.write_text("")
    else:
        out.mkdir()
        (out / "checkpoint.json").write_text("")
    monkeypatch.setattr(fit, "select_route", lambda *_: pytest.fail("the route was read"))
    with pytest.raises(ConfigError, match="run is a file|run already holds a run"):
        train(route, make_config(), out)
