"""Whole fits of FAB-MAP on a small route: what they leave, what they give, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.describe.registry import open_describer
from everplace.describe.runs.fabmap import FabMapDescriber
from everplace.errors import ConfigError
from everplace.fabmap.fabmap_model import load_fabmap
from everplace.match.new_place import new_place_probability
from everplace.match.similarity import similarity, top_k
from everplace.progress import quiet
from everplace.route.fingerprint import image_digests
from everplace.route.route import Route, open_route
from everplace.training.fit_fabmap import FabMapTrainConfig, _features, _sample_features, fit_fabmap
from everplace.training.fitted_methods import FITTED_METHODS, build_config, fit_method

PLACES = 10


@pytest.fixture(scope="module")
def textured_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`day` and `dusk` at 10 places of 64×96, full of corners; dusk is a little darker and noisy."""
    rng = np.random.default_rng(3)
    root = tmp_path_factory.mktemp("route") / "textured"
    for condition in ("day", "dusk"):
        (root / condition).mkdir(parents=True)
    for place in range(PLACES):
        coarse = Image.fromarray(rng.integers(0, 256, (16, 24), dtype=np.uint8))
        day = np.asarray(coarse.resize((96, 64), Image.Resampling.BICUBIC))
        Image.fromarray(day).save(root / "day" / f"{place}.png")
        dusk = day * 0.8 + rng.normal(0, 2, day.shape)
        Image.fromarray(dusk.clip(0, 255).astype(np.uint8)).save(root / "dusk" / f"{place}.png")
    return root


@pytest.fixture(scope="module")
def textured(textured_path: Path) -> Route:
    return open_route(textured_path)


def config(**values: Any) -> FabMapTrainConfig:
    built = build_config(**{"model": "fabmap", "words": 60, **values})
    assert isinstance(built, FabMapTrainConfig)
    return built


@pytest.fixture(scope="module")
def run(textured: Route, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "fabmap"
    summary = fit_fabmap(textured, config(frames=":8"), out)
    assert (summary.run, summary.model, summary.frames, summary.words) == (str(out), "fabmap", 16, 60)
    assert summary.conditions == ("day", "dusk")
    return out


def test_a_fit_leaves_a_run_directory(run: Path) -> None:
    assert {path.name for path in run.iterdir() if path.suffix != ".safetensors"} == {
        "checkpoint.json", "config.toml", "resume",
    }  # fmt: skip
    assert 'model = "fabmap"' in (run / "config.toml").read_text()
    about = json.loads((run / "checkpoint.json").read_text())["about"]
    assert about["frames"] == 16
    assert about["trained_stems"] == [str(place) for place in range(8)]
    assert 5 < about["words_a_frame"] < 60


def test_places_are_recognised_by_the_run(run: Path, textured: Route) -> None:
    describer = open_describer(str(run))
    assert isinstance(describer, FabMapDescriber)
    assert (describer.method, describer.dimension, describer.metric) == ("fabmap", 121, "place-posterior")
    assert describer.seen_stems == {str(place) for place in range(8)}
    assert describer.seen_images == {
        digest for one in textured.traverses for digest in image_digests(one.take(list(range(8))))
    }
    query, database = (describer.describe(textured[name], batch=3) for name in ("dusk", "day"))
    best, _ = top_k(query, database, 1)
    assert (best[:, 0] == np.arange(PLACES)).mean() >= 0.8
    new = new_place_probability(query, database)
    np.testing.assert_allclose(np.exp(similarity(query, database)).sum(axis=1) + new, 1.0, rtol=1e-4)
    # Without its own place in the map, a query is more probably new.
    elsewhere = describer.describe(textured["day"][:5])
    assert new_place_probability(query, elsewhere)[5:].mean() > new[5:].mean()


def test_each_row_depends_on_its_own_image_alone(run: Path) -> None:
    describer = open_describer(str(run))
    images = np.random.default_rng(0).integers(0, 256, (4, 64, 96, 1), dtype=np.uint8)
    together = describer.describe_batch(images)
    for index in range(4):
        assert np.array_equal(describer.describe_batch(images[index : index + 1])[0], together[index])


def test_an_image_without_keypoints_still_has_a_probability(run: Path) -> None:
    describer = open_describer(str(run))
    flat = describer.describe_batch(np.zeros((1, 64, 96, 1), np.uint8))
    assert not flat[0, :60].any()
    assert np.isfinite(flat).all()


def test_settings_are_plain_values_that_tell_runs_apart(run: Path) -> None:
    settings = open_describer(str(run)).settings()
    assert all(isinstance(value, str | int | float) for value in settings.values())
    assert (settings["words"], settings["seed"], settings["image_size"]) == (60, 0, "as stored")
    assert settings["weights"] == load_fabmap(run).sha256[:16]


def test_the_same_seed_gives_the_same_model_and_another_another(run: Path, textured: Route, tmp_path: Path) -> None:
    hashes = []
    for seed in (0, 1):
        fit_fabmap(textured, config(frames=":8", seed=seed), tmp_path / str(seed))
        hashes.append(load_fabmap(tmp_path / str(seed)).sha256)
    assert hashes[0] == load_fabmap(run).sha256
    assert hashes[1] != hashes[0]


def test_sampled_new_places_come_from_training_frames(textured: Route, tmp_path: Path) -> None:
    fit_fabmap(textured, config(new_place="sampled", samples=7), tmp_path / "run")
    model = load_fabmap(tmp_path / "run")
    every = {
        model.words(np.asarray(Image.open(path))).tobytes()
        for traverse in textured.traverses
        for path in traverse.paths
    }
    assert model.sample.shape == (7, 60)
    assert {row.tobytes() for row in model.sample} <= every


def test_resuming_a_finished_fit_leaves_it_and_a_stopped_one_starts_anew(textured: Route, tmp_path: Path) -> None:
    out = tmp_path / "run"
    fit_fabmap(textured, config(), out)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file() and path.name != "config.toml"}
    fit_fabmap(textured, config(), out, resume=True)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    with pytest.raises(ConfigError, match="already holds a run; add `resume=True`"):
        fit_fabmap(textured, config(), out)
    with pytest.raises(ConfigError, match="words was 60 and is now 61"):
        fit_fabmap(textured, config(words=61), out, resume=True)
    with pytest.raises(ConfigError, match="model was 'fabmap' and is now 'vae'"):
        fit_method(textured, build_config(model="vae", epochs=1, image_size=(32, 32)), out, resume=True)
    for path in before:
        if "resume" in path.parts or path.name == "checkpoint.json":
            path.unlink()
    fit_fabmap(textured, config(), out, resume=True)
    assert load_fabmap(out).config.words == 60


def test_other_images_are_noticed(textured: Route, textured_path: Path, tmp_path: Path) -> None:
    fit_fabmap(textured, config(), tmp_path / "run")
    copy = tmp_path / "copy"
    for traverse in textured.traverses:
        (copy / traverse.name).mkdir(parents=True)
        for path in traverse.paths:
            (copy / traverse.name / path.name).write_bytes(path.read_bytes())
    fit_fabmap(open_route(copy), config(), tmp_path / "run", resume=True)
    Image.fromarray(np.zeros((64, 96), np.uint8)).save(copy / "day" / "3.png")
    with pytest.raises(ConfigError, match="was trained on other images"):
        fit_fabmap(open_route(copy), config(), tmp_path / "run", resume=True)


def test_too_few_features_are_said_with_their_number(textured: Route, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gave \d+ different SIFT features, too few for words = 60000; lower words"):
        fit_fabmap(textured, config(words=60000), tmp_path / "run")
    assert not list((tmp_path / "run").iterdir())
    fit_fabmap(textured, config(), tmp_path / "run")  # as the message says, into the same place


def test_the_vocabulary_is_of_all_conditions_even_if_there_are_more_frames_than_features(textured: Route) -> None:
    settings = config(words=2, vocabulary_features=PLACES)
    features = _sample_features(textured, settings, quiet)
    assert len(features) == PLACES
    of_day = {row.tobytes() for found in _features(textured.only(["day"]), settings, "", quiet) for row in found}
    from_day = sum(row.tobytes() in of_day for row in features)
    assert 0 < from_day < PLACES


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"wrods": 3}, "wrods: there is no such setting; known are model, .*words"),
        ({"learning_rate": 0.1}, "learning_rate: "),
        ({"words": 1}, "words: .*greater than or equal to 2"),
        ({"keypoints": -1}, "keypoints: "),
        ({"new_place": "mean"}, "new_place: .*'mean-field' or 'sampled'"),
        ({"image_size": (0, 5)}, "image_size"),
        ({"seed": -1}, "seed: "),
        ({"epochs": 3}, "`epochs` does not apply to fabmap"),
        ({"minutes": 3}, "`minutes` does not apply to fabmap"),
        ({"grey": True}, "`grey` does not apply to fabmap"),
        ({"recipe": "faithful"}, "`recipe` does not apply to fabmap"),
    ],
)
def test_a_wrong_value_is_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config(**values)


def test_networks_get_a_length_and_fabmap_one_process(textured: Route, tmp_path: Path) -> None:
    assert FITTED_METHODS == ("vae", "c-vae", "cp-vae", "cae", "fabmap")
    assert build_config(model="cae").model_dump()["epochs"] == 40
    with pytest.raises(ConfigError, match="`devices` and `nodes` do not apply to fabmap"):
        fit_method(textured, config(), tmp_path / "run", devices=2)
    assert not (tmp_path / "run").exists()
