"""The whole configuration of a training run, as it stands in config.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import tomli_w
from pydantic import Field, ValidationError, field_validator, model_validator

from everplace import settings
from everplace.errors import SettingError
from everplace.files import readable, write_text
from everplace.model.model_config import ModelKind, PlaceTerm
from everplace.settings import first_problem
from everplace.training.augment import Augmentation
from everplace.training.recipes import recipe
from everplace.training.sections import NonNegative, PlaceProjection, Positive, Remedies, Section, TermWeights
from everplace.training.virtual_places import VirtualPlaces

__all__ = [
    "CONFIG_FILE",
    "DEFAULT_EPOCHS",
    "FitConfig",
    "TrainConfig",
    "read_toml",
    "write_config",
]

CONFIG_FILE = "config.toml"
DEFAULT_EPOCHS = 40

_Config = TypeVar("_Config", bound="FitConfig")


class FitConfig(Section):
    """What every method that is fitted is told: itself, what of the route it is fitted on, and its seed.

    Attributes:
        model: The method's name.
        conditions: Traverses or conditions to train on; empty: all of the route.
        frames: `A:B`, as `--frames`; empty: all.
        drop_dark: Leave out dark places.
        drop_stationary: Leave out places that look like the one before.
        seed: Of all that is random.
    """

    model: str
    conditions: tuple[str, ...] = ()
    frames: str = ""
    drop_dark: bool = False
    drop_stationary: bool = False
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

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
            message = problem.reason
            if problem.known is not None:
                message = f"there is no such setting; known are {', '.join(problem.known)}"
            elif problem.kind != "value_error" and isinstance(problem.value, int | float | str):
                message += f", not {problem.value!r}"
            raise SettingError(problem.setting or "configuration", message) from None

    @classmethod
    def _defaults(cls, values: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG003
        """Defaults that depend on the values."""
        return {}


class TrainConfig(FitConfig):
    """Everything that decides the outcome of the training of a network, beside the images.

    Attributes:
        model: `vae`, `c-vae`, `cp-vae` or `cae`.
        recipe: Name of the recipe that gave the defaults; `faithful` is the paper's bound alone, `best` (CP-VAE only)
            adds remedies.
        image_size: (H, W), multiples of 32.
        grey: One channel instead of three.
        epochs: Passes over the training frames; exactly one of `epochs` and `minutes` is given.
        minutes: Stop after so much training time.
        batch_size: Frames in one step, over all devices.
        learning_rate: At its highest; it warms up and then falls along a cosine.
        fully_connected_rate: Learning rate of the fully connected chains, as a fraction of the others'. A step of
            Adam changes what a layer computes the more, the more inputs it has (Yang et al. 2022).
        weight_decay: Of AdamW.
        warmup_epochs: Epochs over which the KL weights rise from 0 to theirs.
        weights: Weights of the bound's terms.
        remedies: What the paper's bound does not have.
        fully_connected: Table 1's chain of fully connected layers; without it z is read off the feature map.
        oriented_gradients: The mean of z_p is a linear projection of oriented gradients instead of the feature map
            (`cp-vae` only). The projection starts as the discriminant of the training places.
        projection: How that projection is fitted and trained.
        place_term: What p(p|z_p) tells (`cp-vae` only): the training places as `classes`, or the `position` along the
            route, regressed.
        place_spread: Standard deviation, in places, of the softened place target; 0: one class a frame.
        augmentation: How much training images are changed.
        held_out: Fraction of the training places, at their end, kept out of the gradient to choose the epoch.
        held_out_gap: Places left out between the two.
        tolerance: A match this many places away counts as right when the epoch is chosen.
        validate_every: Epochs between validations.
    """

    model: ModelKind
    recipe: Literal["faithful", "best"] = "faithful"
    image_size: tuple[int, int] = (224, 224)
    grey: bool = False
    epochs: Annotated[int, Field(gt=0)] | None = None
    minutes: Positive | None = None
    batch_size: Annotated[int, Field(ge=2)] = 32
    learning_rate: Positive = 1e-3
    fully_connected_rate: Positive = 0.1
    weight_decay: NonNegative = 0.0
    warmup_epochs: NonNegative = 5.0
    weights: TermWeights = TermWeights()
    remedies: Remedies = Remedies()
    fully_connected: bool = True
    oriented_gradients: bool = False
    projection: PlaceProjection = PlaceProjection()
    place_term: PlaceTerm = "classes"
    place_spread: NonNegative = 0.0
    augmentation: Augmentation = Augmentation()
    held_out: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    held_out_gap: Annotated[int, Field(ge=0)] = 10
    tolerance: Annotated[int, Field(ge=0)] = 1
    validate_every: Annotated[int, Field(gt=0)] = 1

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
    def _remedies_fit_the_model(self) -> TrainConfig:
        remedies = self.remedies
        for name, used in (("contrastive", remedies.contrastive), ("swap", remedies.swap)):
            if used and self.model != "cp-vae":
                raise ValueError(f"remedies.{name} needs place labels, which {self.model} does not use; set it to 0")
        for name, used, off in (
            ("adversary", remedies.adversary, "0"),
            ("conditional_prior", remedies.conditional_prior, "false"),
        ):
            if used and self.model not in ("c-vae", "cp-vae"):
                raise ValueError(f"remedies.{name} needs conditions, which {self.model} does not use; set it to {off}")
        if remedies.free_bits and self.model == "cae":
            raise ValueError("remedies.free_bits needs a KL divergence, which cae does not have; set it to 0")
        if self.oriented_gradients and self.model != "cp-vae":
            raise ValueError(f"oriented_gradients needs place labels, which {self.model} does not use; set it to false")
        if self.place_term == "position" and self.model != "cp-vae":
            raise ValueError(f"place_term needs place labels, which {self.model} does not use; set it to classes")
        if remedies.virtual != VirtualPlaces() and (self.weights.place or not remedies.contrastive):
            raise ValueError(
                "remedies.virtual makes places without a class; set weights.place to 0 and remedies.contrastive above 0"
            )
        return self

    @property
    def has_place_classes(self) -> bool:
        """Whether the model tells the training places apart as classes, which virtual places have none of."""
        return self.model == "cp-vae" and self.remedies.virtual == VirtualPlaces()

    def remedies_in_use(self) -> list[str]:
        """What this configuration has that the paper's model has not, in words; empty for a faithful one."""
        remedies, virtual, projection = self.remedies, self.remedies.virtual, self.projection
        whose = {"same_place": "the same", "other_place": "another"}[remedies.swap_z_c]
        named = {
            f"contrastive term (temperature {remedies.temperature:g})": bool(remedies.contrastive),
            f"adversary on z_p (weight {remedies.adversary:g})": bool(remedies.adversary),
            f"swap reconstruction (weight {remedies.swap:g}, z_c of {whose} place)": bool(remedies.swap),
            "conditional prior p(z_c|c)": remedies.conditional_prior,
            f"free bits ({remedies.free_bits:g} nats a dimension)": bool(remedies.free_bits),
            f"virtual places (crop {virtual.crop:g}, mirror {virtual.mirror:g}, join {virtual.join:g})": (
                virtual != VirtualPlaces()
            ),
            "no place classes": self.model == "cp-vae" and not self.has_place_classes,
            "no fully connected chain": not self.fully_connected,
            f"z_p from oriented gradients (ridge {projection.ridge:g}, stretches {projection.stretches:g}, "
            f"light {projection.light:g}, rate {projection.rate:g})": self.oriented_gradients,
        }
        return [name for name, used in named.items() if used]

    @classmethod
    def _defaults(cls, values: dict[str, Any]) -> dict[str, Any]:
        return recipe(str(values.get("model")), str(values.get("recipe", "faithful")))


def read_toml(path: Path) -> dict[str, Any]:
    """Reads the values of a `--config` file.

    Raises:
        ConfigError: The file is missing or is no TOML.
    """
    return settings.read_toml(path, f"--config {readable(path)}")


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
