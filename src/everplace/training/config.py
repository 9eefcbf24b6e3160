"""The whole configuration of a training run, as it stands in config.toml, and the recipes that give its defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import tomli_w
from pydantic import Field, ValidationError, field_validator, model_validator

from everplace.errors import ConfigError, SettingError
from everplace.files import write_text
from everplace.model.bounds import Weights
from everplace.model.model_config import ModelKind, PlaceTerm
from everplace.settings import Settings, explanations, first_problem
from everplace.training.augment import Augmentation

__all__ = [
    "CONFIG_FILE",
    "DEFAULT_EPOCHS",
    "FitConfig",
    "PlaceProjection",
    "TrainConfig",
    "write_config",
]

CONFIG_FILE = "config.toml"
DEFAULT_EPOCHS = 40

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Config = TypeVar("_Config", bound="FitConfig")


class PlaceProjection(Settings):
    """How the projection of oriented gradients to z_p is fitted and trained."""

    ridge: Positive = 2.0
    """Of the discriminant, in units of the mean variance within places."""
    stretches: NonNegative = 20.0
    """Weight of the differences between traverses averaged over whole stretches, beside those at single places, which
    count once."""
    light: NonNegative = 1.0
    """Weight of what other light would change."""
    rate: NonNegative = 0.1
    """Learning rate of the projection, as a fraction of the others'; 0 leaves it as it was fitted."""


class FitConfig(Settings):
    """Settings shared by all methods that are fitted."""

    model: str
    """The method's name."""
    conditions: tuple[str, ...] = ()
    """Traverses or conditions to train on; empty: all of the route."""
    frames: str = ""
    """`A:B`, as `--frames`; empty: all."""
    drop_dark: bool = False
    """Leave out dark places."""
    drop_stationary: bool = False
    """Leave out places that look like the one before."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Of all that is random."""

    @classmethod
    def build(cls: type[_Config], /, **values: Any) -> _Config:
        """Makes a configuration from its defaults and the values given over them.

        Args:
            values: Fields of this class; tables may be given in part (`weights={"place": 100}`).

        Raises:
            SettingError: A key does not exist or a value is out of its range.
        """
        try:
            return cls.model_validate(_merge(cls._defaults(values), values))
        except ValidationError as error:
            problem = first_problem(error, cls)
            reason, explained = problem.reason, explanations(cls).get(problem.setting)
            if problem.known is not None:
                reason = f"there is no such setting; known are {', '.join(problem.known)}"
            elif problem.kind != "value_error" and isinstance(problem.value, int | float | str):
                reason += f", not {problem.value!r}"
            reason += f" ({problem.setting}: {explained})" if explained else ""
            raise SettingError(problem.setting or "configuration", reason) from None

    @classmethod
    def _defaults(cls, values: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG003
        """Defaults that depend on the values."""
        return {}


class TrainConfig(FitConfig):
    """Everything that decides the outcome of the training of a network, beside the images."""

    model: ModelKind
    """`vae`, `c-vae`, `cp-vae` or `cae`."""
    recipe: Literal["faithful", "best"] = "faithful"
    """What gave the defaults: `faithful` is the paper's bound alone, `best` (CP-VAE only) adds remedies."""
    image_size: tuple[int, int] = (224, 224)
    """(H, W), multiples of 32."""
    grey: bool = False
    """One channel instead of three."""
    epochs: Annotated[int, Field(gt=0)] | None = None
    """Passes over the training frames; exactly one of `epochs` and `minutes` is given."""
    minutes: Positive | None = None
    """Stop after so much training time."""
    batch_size: Annotated[int, Field(ge=2)] = 64
    """Frames in one step, over all devices."""
    learning_rate: Positive = 1e-3
    """At its highest; it warms up and then falls along a cosine."""
    fully_connected_rate: Positive = 0.1
    """Learning rate of the fully connected chains, as a fraction of the others'. A step of Adam changes what a layer
    computes the more, the more inputs it has (Yang et al. 2022)."""
    weight_decay: NonNegative = 0.1
    """Of AdamW."""
    warmup_epochs: NonNegative = 5.0
    """Epochs over which the KL weights rise from 0 to theirs."""
    weights: Weights = Weights()
    """Weights of the bound's terms."""
    fully_connected: bool = True
    """Table 1's chain of fully connected layers; without it z is read off the feature map."""
    oriented_gradients: bool = False
    """The mean of z_p is a linear projection of oriented gradients instead of the feature map (`cp-vae` only). The
    projection starts as the discriminant of the training places."""
    projection: PlaceProjection = PlaceProjection()
    """How that projection is fitted and trained."""
    place_term: PlaceTerm = "classes"
    """What p(p|z_p) tells (`cp-vae` only): the training places as `classes`, or the `position` along the route,
    regressed."""
    place_spread: NonNegative = 0.0
    """Standard deviation, in places, of the softened place target; 0: one class a frame."""
    augmentation: Augmentation = Augmentation()
    """How much training images are changed."""
    held_out: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    """Fraction of the training places, at their end, kept out of the gradient to choose the epoch."""
    held_out_gap: Annotated[int, Field(ge=0)] = 10
    """Places left out between the two."""
    tolerance: Annotated[int, Field(ge=0)] = 1
    """A match this many places away counts as right when the epoch is chosen."""
    validate_every: Annotated[int, Field(gt=0)] = 1
    """Epochs between validations."""

    @field_validator("image_size")
    @classmethod
    def _multiples_of_32(cls, size: tuple[int, int]) -> tuple[int, int]:
        if any(side < 32 or side % 32 for side in size):
            nearest = "x".join(str(max(32, round(side / 32) * 32)) for side in size)
            raise ValueError(
                f"{size[0]}x{size[1]} is not a multiple of 32 on both sides; give multiples of 32 such as {nearest}"
            )
        return size

    @model_validator(mode="after")
    def _one_length(self) -> TrainConfig:
        if (self.epochs is None) == (self.minutes is None):
            raise ValueError("give exactly one of epochs and minutes")
        return self

    @model_validator(mode="after")
    def _fits_the_model(self) -> TrainConfig:
        for name, used, off in (
            ("oriented_gradients", self.oriented_gradients, "false"),
            ("place_term", self.place_term == "position", "classes"),
        ):
            if used and self.model != "cp-vae":
                raise ValueError(f"{name} needs place labels, which {self.model} does not use; set it to {off}")
        return self

    def remedies_in_use(self) -> list[str]:
        """What this configuration has that the paper's model has not, in words; empty for a faithful one."""
        projection = self.projection
        named = {
            "no fully connected chain": not self.fully_connected,
            f"z_p from oriented gradients (ridge {projection.ridge:g}, stretches {projection.stretches:g}, "
            f"light {projection.light:g}, rate {projection.rate:g})": self.oriented_gradients,
        }
        return [name for name, used in named.items() if used]

    @classmethod
    def _defaults(cls, values: dict[str, Any]) -> dict[str, Any]:
        return _recipe(str(values.get("model")), str(values.get("recipe", "faithful")))


_AUGMENTATION = {"shift": 0.03, "crop": 0.03, "brightness": 0.18, "contrast": 0.35}
_LABEL_WEIGHTS = {"c-vae": {"condition": 100.0}, "cp-vae": {"condition": 100.0, "place": 5000.0}}
_BEST: dict[str, Any] = {"oriented_gradients": True, "fully_connected": False, "fully_connected_rate": 1.0}


def _recipe(model: str, name: str) -> dict[str, Any]:
    """The defaults of a recipe that depend on the kind of model.

    Raises:
        ConfigError: There is no recipe of that name.
    """
    if name not in ("faithful", "best"):
        raise ConfigError(f"`recipe` {name!r} does not exist; choose faithful or best")
    if name == "best" and model != "cp-vae":
        raise ConfigError(f"`recipe=best` is a recipe of cp-vae, not of {model}; choose faithful")
    defaults = {"recipe": name, "augmentation": _AUGMENTATION, "weights": _LABEL_WEIGHTS.get(model, {})}
    if name == "faithful":
        return defaults
    # With a tenth of the image term z_c holds less of the place, and the translated images are closer.
    return {**defaults, **_BEST, "weights": {**_LABEL_WEIGHTS[model], "image": 0.1}}


def write_config(run: Path, config: FitConfig) -> None:
    """Writes config.toml into a run directory."""
    values = config.model_dump(mode="json", exclude_none=True)
    write_text(run / CONFIG_FILE, tomli_w.dumps(values))


def _merge(under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    merged = dict(under)
    for key, value in over.items():
        below = merged.get(key)
        merged[key] = _merge(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged
