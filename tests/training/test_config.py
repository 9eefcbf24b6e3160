"""The configuration of a run: recipes, errors that name the key, and config.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from everplace.errors import ConfigError
from everplace.training.config import CONFIG_FILE, TrainConfig, read_toml, write_config
from everplace.training.recipes import recipe


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"leraning_rate": 1}, r"leraning_rate: .*; known are model, .*learning_rate"),
        ({"weights": {"plce": 1}}, r"weights\.plce: .*; known are image, condition, place, beta_place"),
        ({"augmentation": {"rotate": 1}}, r"augmentation\.rotate: .*; known are shift, crop"),
        ({"learning_rate": 0}, "learning_rate: .*greater than 0"),
        ({"learning_rate": float("nan")}, "learning_rate: "),
        ({"weights": {"place": -1}}, r"weights\.place: .*greater than or equal to 0"),
        ({"weights": 3}, "weights: "),
        ({"batch_size": 1}, "batch_size: "),
        ({"held_out": 0.5}, "held_out: .*less than 0.5"),
        ({"image_size": (32,)}, r"image_size"),
        ({"image_size": (0, 64)}, "image_size: 0x64 is not .* give multiples of 32 such as 32x64"),
        ({"image_size": (-32, 64)}, "image_size: .* multiples of 32 such as 32x64"),
        ({"image_size": (100, 64)}, "image_size: .* multiples of 32 such as 96x64"),
        ({"cls": 1}, "cls: .*; known are model"),
        ({"epochs": 0}, "epochs: "),
        ({"seed": -1}, "seed: "),
        ({"model": "gan"}, "model: .*'vae', 'c-vae', 'cp-vae' or 'cae'"),
        ({"epochs": 3, "minutes": 1}, "give exactly one of epochs and minutes"),
        ({"epochs": None}, "give exactly one of epochs and minutes"),
        ({"recipe": "worst"}, "--recipe 'worst' does not exist; choose faithful or best"),
        ({"recipe": "best"}, "--recipe best is a recipe of cp-vae, not of vae"),
        ({"remedies": {"mixup": 1}}, r"remedies\.mixup: .*; known are contrastive, temperature, adversary"),
        ({"remedies": {"virtual": {"nope": 1}}}, r"remedies\.virtual\.nope: .*; known are (?!contrastive)"),
        ({"remedies": {"contrastive": 1}}, "remedies.contrastive needs place labels, which vae does not use; set"),
        (
            {"model": "c-vae", "remedies": {"swap": 1}},
            "remedies.swap needs place labels, which c-vae does not use",
        ),
        ({"remedies": {"adversary": 1}}, "remedies.adversary needs conditions, which vae does not use; set it to 0"),
        (
            {"model": "cae", "remedies": {"conditional_prior": True}},
            "remedies.conditional_prior needs conditions, which cae does not use; set it to false",
        ),
        (
            {"model": "cae", "remedies": {"free_bits": 1}},
            "remedies.free_bits needs a KL divergence, which cae does",
        ),
        ({"remedies": {"free_bits": -1}}, r"remedies\.free_bits: .*greater than or equal to 0"),
        (
            {"model": "cp-vae", "remedies": {"contrastive": 1, "virtual": {"join": 0.5}}},
            "remedies.virtual makes places without a class; set weights.place to 0",
        ),
    ],
)
def test_a_wrong_value_is_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        TrainConfig.build(**{"model": "vae", "epochs": 1, **values})


def test_the_model_must_be_given() -> None:
    with pytest.raises(ConfigError, match="model: Field required"):
        TrainConfig.build(epochs=1)


def test_tables_given_in_part_keep_the_rest_of_the_recipe() -> None:
    defaults = recipe("cp-vae", "faithful")
    config = TrainConfig.build(model="cp-vae", epochs=1, weights={"place": 7}, augmentation={"blur": 1.5})
    assert config.weights.place == 7
    assert config.weights.condition == defaults["weights"]["condition"]
    assert config.augmentation.blur == 1.5
    assert config.augmentation.shift == defaults["augmentation"]["shift"]
    # The recipe itself was not changed by merging.
    assert recipe("cp-vae", "faithful") == defaults


def test_recipes_weigh_only_the_labels_that_a_kind_has() -> None:
    assert TrainConfig.build(model="vae", epochs=1).weights.model_dump() == dict.fromkeys(
        ("image", "condition", "place", "beta_place", "beta_condition"), 1.0
    )
    assert TrainConfig.build(model="c-vae", epochs=1).weights.place == 1.0


@pytest.mark.parametrize("length", [{"epochs": 3}, {"minutes": 0.7}])
def test_config_toml_gives_the_configuration_back(tmp_path: Path, length: dict[str, float]) -> None:
    config = TrainConfig.build(
        model="c-vae", conditions=("a", 'quo"ted'), frames="3:", grey=True, image_size=(64, 96),
        seed=5, learning_rate=1.1e-4, weights={"beta_place": 0.3}, augmentation={"shift": 0.07}, **length,
    )  # fmt: skip
    write_config(tmp_path, config)
    assert TrainConfig.model_validate(read_toml(tmp_path / CONFIG_FILE)) == config
    assert TrainConfig.build(**read_toml(tmp_path / CONFIG_FILE)) == config


def test_a_config_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    with pytest.raises(ConfigError, match=r"cannot read --config .*mine\.toml: No such file"):
        read_toml(path)
    path.write_text("epochs = ")
    with pytest.raises(ConfigError, match=r"mine\.toml is not valid TOML"):
        read_toml(path)
    path.write_bytes(b'a = "\xff"')
    with pytest.raises(ConfigError, match=r"mine\.toml is not valid TOML"):
        read_toml(path)
    path.write_text("a = " + "[" * 100_000)
    with pytest.raises(ConfigError, match=r"mine\.toml (nests its values too deeply|is not valid TOML)"):
        read_toml(path)


def test_a_faithful_run_has_no_remedy_and_the_best_names_its_own() -> None:
    assert TrainConfig.build(model="cp-vae", epochs=1).remedies_in_use() == []
    best = TrainConfig.build(model="cp-vae", recipe="best", epochs=1)
    assert best.remedies_in_use() == [
        "no fully connected chain", "z_p from oriented gradients (ridge 2, stretches 20, light 1, rate 0.1)",
    ]  # fmt: skip


def test_every_remedy_is_named() -> None:
    config = TrainConfig.build(
        model="cp-vae",
        epochs=1,
        weights={"place": 0.0},
        remedies={
            "contrastive": 5000.0,
            "adversary": 100.0,
            "swap": 0.5,
            "conditional_prior": True,
            "free_bits": 0.25,
            "virtual": {"crop": 0.3, "mirror": 0.5, "join": 0.5},
        },
    )
    assert config.remedies_in_use() == [
        "contrastive term (temperature 0.1)",
        "adversary on z_p (weight 100)",
        "swap reconstruction (weight 0.5, z_c of the same place)",
        "conditional prior p(z_c|c)",
        "free bits (0.25 nats a dimension)",
        "virtual places (crop 0.3, mirror 0.5, join 0.5)",
        "no place classes",
    ]
