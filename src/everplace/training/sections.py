"""The tables of config.toml that only training knows: weights, remedies, the place projection."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from everplace.training.virtual_places import VirtualPlaces

__all__ = ["NonNegative", "PlaceProjection", "Positive", "Remedies", "Section", "TermWeights"]

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Section(BaseModel):
    """A table whose values do not change and whose keys are known."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class TermWeights(Section):
    """Weights of the terms of the bound ("weighted Eq. 1, 3, 5"); all 1 is the bound as the paper writes it.

    Attributes:
        image: Of log p(x|z), summed over pixels.
        condition: Of log p(c|z_c).
        place: Of log p(p|z_p).
        beta_place: Of the KL divergence of z_p, after the warm-up.
        beta_condition: Of the KL divergence of z_c, after the warm-up.
    """

    image: NonNegative = 1.0
    condition: NonNegative = 1.0
    place: NonNegative = 1.0
    beta_place: NonNegative = 1.0
    beta_condition: NonNegative = 1.0


class Remedies(Section):
    """What the paper's bound does not have; all of it is off in the recipe `faithful`.

    Attributes:
        contrastive: Weight of a contrastive place term between the conditions (InfoNCE on the means of z_p).
        temperature: Of the contrastive term.
        adversary: Weight of log p(c|z_p) of a classifier that is trained to tell the condition from the means of z_p,
            against the encoder (gradient reversal).
        swap: Weight of log p(x_b|z_p of a, z_c) for two frames a, b of a place.
        swap_z_c: Whose z_c: `same_place`, that of b, which may hold all of b; `other_place`, that of a frame of
            another place in the condition of b, which can tell nothing of the place. A frame whose condition the batch
            has of no other place is left out.
        conditional_prior: The divergence of z_c is taken from a learned Gaussian of its condition, p(z_c|c).
        free_bits: Divergence of each dimension of z, in nats, that costs nothing.
        virtual: Virtual places for the contrastive term; they have no class, so they need `weights.place = 0`.
    """

    contrastive: NonNegative = 0.0
    temperature: Positive = 0.1
    adversary: NonNegative = 0.0
    swap: NonNegative = 0.0
    swap_z_c: Literal["same_place", "other_place"] = "same_place"
    conditional_prior: bool = False
    free_bits: NonNegative = 0.0
    virtual: VirtualPlaces = VirtualPlaces()

    @property
    def need_pairs(self) -> bool:
        """Whether the frames of a step are to come as pairs of one place."""
        return bool(self.contrastive or self.swap)


class PlaceProjection(Section):
    """How the projection of oriented gradients to z_p is fitted and trained.

    Attributes:
        ridge: Of the discriminant, in units of the mean variance within places.
        stretches: Weight of the differences between traverses averaged over whole stretches, beside those at single
            places, which count once.
        light: Weight of what other light would change.
        rate: Learning rate of the projection, as a fraction of the others'; 0 leaves it as it was fitted.
    """

    ridge: Positive = 2.0
    stretches: NonNegative = 20.0
    light: NonNegative = 1.0
    rate: NonNegative = 0.1
