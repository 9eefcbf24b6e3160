"""What is fixed when a model is built: its kind, image, latent sizes and labels."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from everplace.settings import Settings

__all__ = ["LABELLED_KINDS", "MODEL_KINDS", "ModelConfig", "ModelKind", "PlaceTerm"]

ModelKind = Literal["vae", "c-vae", "cp-vae", "cae"]
MODEL_KINDS: tuple[ModelKind, ...] = ("vae", "c-vae", "cp-vae", "cae")
LABELLED_KINDS: tuple[ModelKind, ...] = ("c-vae", "cp-vae")
"""Kinds whose labels divide the latent into z_p and z_c."""
PlaceTerm = Literal["classes", "position"]

PositiveInt = Annotated[int, Field(gt=0)]


class ModelConfig(Settings):
    """The shape of a model; together with its weights it is all that a checkpoint needs."""

    kind: ModelKind
    """`vae` (Eq. 1), `c-vae` (Eq. 3), `cp-vae` (Eq. 5), or `cae`, a plain convolutional autoencoder."""
    height: PositiveInt = 224
    """Image height H in pixels, a multiple of 32."""
    width: PositiveInt = 224
    """Image width W in pixels, a multiple of 32."""
    channels: Literal[1, 3] = 3
    """3 for RGB, 1 for grey."""
    conditions: tuple[str, ...] = ()
    """Names of the conditions, in the order of the condition head's classes."""
    places: Annotated[int, Field(ge=0)] = 0
    """Number of training places, the classes of the place head (`cp-vae` only, else 0)."""
    place_term: PlaceTerm = "classes"
    """What p(p|z_p) tells: the `classes`, or the `position` along the route."""
    fully_connected: bool = True
    """Table 1's chain of fully connected layers; without it z is read off the feature map."""
    oriented_gradients: bool = False
    """The mean of z_p is a linear projection of oriented gradients instead of the feature map (`cp-vae` only)."""
    place_dimensions: PositiveInt = 96
    """Size of z_p, the condition-invariant block (the paper: 96)."""
    condition_dimensions: PositiveInt = 32
    """Size of z_c, the condition-sensitive block (the paper: 32)."""

    @model_validator(mode="after")
    def _check(self) -> ModelConfig:
        if self.height % 32 or self.width % 32:
            raise ValueError(
                f"image size {self.height}x{self.width} is not a multiple of 32 on both sides; "
                f"the nearest one is {_nearest(self.height)}x{_nearest(self.width)}"
            )
        if self.labelled and len(self.conditions) < 2:
            raise ValueError(f"{self.kind} needs at least two conditions to tell apart, not {len(self.conditions)}")
        if self.kind == "cp-vae" and self.places == 1:
            raise ValueError(f"cp-vae needs at least two places to tell apart, not {self.places}")
        if self.oriented_gradients and self.kind != "cp-vae":
            raise ValueError(f"oriented_gradients belongs to cp-vae, whose z_p holds the place, not to {self.kind}")
        return self

    @property
    def latent_dimensions(self) -> int:
        """Size of z = [z_p, z_c]."""
        return self.place_dimensions + self.condition_dimensions

    @property
    def labelled(self) -> bool:
        """Whether labels divide z into z_p and z_c; else z is one block, and all of it the descriptor."""
        return self.kind in LABELLED_KINDS

    @property
    def descriptor_dimensions(self) -> int:
        """Size of the place descriptor: z_p, or all of z."""
        return self.place_dimensions if self.labelled else self.latent_dimensions


def _nearest(side: int) -> int:
    return max(32, round(side / 32) * 32)
