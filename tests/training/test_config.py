"""The configuration of a run: recipes, errors that name the key, and config.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from everplace.errors import ConfigError
from everplace.settings import read_toml
from everplace.training.config import CONFIG_FILE, TrainConfig, write_config


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
        ({"recipe": "worst"}, "`recipe` 'worst' does not exist; choose faithful or best"),
        ({"recipe": "best"}, "`recipe=best` is a recipe of cp-vae, not of vae"),
        ({"remedies": {"swap": 1}}, r"remedies: there is no such setting; known are model, .*recipe"),
    ],
)
def test_a_wrong_value_is_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        TrainConfig.build(**{"model": "vae", "epochs": 1, **values})


def test_the_model_must_be_given() -> None:
    with pytest.raises(ConfigError, match="model: Field required"):
        TrainConfig.build(epochs=1)


def test_tables_given_in_part_keep_the_rest_of_the_recipe() -> None:
    defaults = TrainConfig.build(model="cp-vae", epochs=1)
    config = TrainConfig.build(model="cp-vae", epochs=1, weights={"place": 7}, augmentation={"blur": 1.5})
    assert config.weights == defaults.weights.model_copy(update={"place": 7})
    assert config.augmentation == defaults.augmentation.model_copy(update={"blur": 1.5})
    assert config.augmentation.shift > 0
    # The recipe itself was not changed by merging.
    assert TrainConfig.build(model="cp-vae", epochs=1) == defaults


def test_every_setting_is_explained_under_its_field() -> None:
    def unexplained(section: type[BaseModel]) -> list[str]:
        inner = [field.annotation for field in section.model_fields.values()]
        nested = [one for one in inner if isinstance(one, type) and issubclass(one, BaseModel)]
        own = [f"{section.__name__}.{name}" for name, field in section.model_fields.items() if not field.description]
        return own + [name for one in nested for name in unexplained(one)]

    assert unexplained(TrainConfig) == []


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


def test_a_faithful_run_has_no_remedy_and_the_best_names_its_own() -> None:
    assert TrainConfig.build(model="cp-vae", epochs=1).remedies_in_use() == []
    best = TrainConfig.build(model="cp-vae", recipe="best", epochs=1)
    assert best.remedies_in_use() == [
        "no fully connected chain", "z_p from oriented gradients (ridge 2, stretches 20, light 1, rate 0.1)",
    ]  # fmt: skip
