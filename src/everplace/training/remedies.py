"""What the remedies of a run add to one step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn

from everplace.model.bounds import Weights, gaussian_log_likelihood, label_log_likelihood
from everplace.model.condition_vae import ConditionVAE, Output
from everplace.model.model_config import ModelConfig
from everplace.model.posterior import LatentSplit, Posterior
from everplace.model.remedies import ConditionAdversary, ConditionalPrior, free_bits, info_nce, reversal_strength
from everplace.training.sections import Remedies

__all__ = ["RemedyTerms"]


class RemedyTerms(nn.Module):
    """The terms that a run's remedies add, with the parameters that only training needs.

    The parameters are kept in the state to resume from and not in the checkpoint. Without the remedies that have
    some there are none, and nothing random is drawn for them.

    Attributes:
        adversary: Guesses the condition from z_p; None if it is off.
        conditional_prior: p(z_c|c); None if it is off.
    """

    def __init__(self, model: ModelConfig, remedies: Remedies) -> None:
        super().__init__()
        conditions = len(model.conditions)
        self.adversary = ConditionAdversary(model.place_dimensions, conditions) if remedies.adversary else None
        self.conditional_prior = (
            ConditionalPrior(conditions, model.condition_dimensions) if remedies.conditional_prior else None
        )
        self._remedies = remedies

    def forward(
        self,
        model: ConditionVAE,
        images: Tensor,
        output: Output,
        log_sigma: Tensor,
        labels: tuple[Tensor, Tensor],
        progress: float,
    ) -> dict[str, Tensor]:
        """The terms of the remedies that are on.

        Args:
            model: The network.
            images: (B, C, H, W) in [0, 1]; where a remedy needs pairs, the two frames of a place follow each other.
            output: What the model made of them.
            log_sigma: The decoder's log sigma.
            labels: (B,) indices of the condition, and (B,) indices of the training place.
            progress: How much of the run is done, in [0, 1].

        Returns:
            In nats: `contrastive` (B/2,); `adversary`, the adversary's log p(c|z_p), (B,); `swap`, (B,), or
            with z_c of another place one for each frame that has a donor of it, and one 0 where none has;
            `kl_conditional`, KL(q(z_c|x) || p(z_c|c)), (B,); `free_place` and `free_condition`, by how much free
            bits raise the cost of the mean divergence of a block, scalars that are never negative.
        """
        remedies, split, posterior = self._remedies, model.split, output.posterior
        conditions, places = labels
        terms: dict[str, Tensor] = {}
        if remedies.contrastive:
            z_p = split.z_p(posterior.mean)
            terms["contrastive"] = info_nce(z_p[0::2], z_p[1::2], remedies.temperature, places[0::2])
        if self.adversary is not None:
            # As for the heads of the model, bfloat16 is too coarse for the logits.
            with torch.autocast(images.device.type, enabled=False):
                logits = self.adversary(split.z_p(posterior.mean), reversal_strength(progress))
            terms["adversary"] = label_log_likelihood(logits, conditions)
        if remedies.swap:
            frames = donors = torch.arange(len(images), device=images.device)
            if remedies.swap_z_c == "other_place":
                frames, donors = _donors(conditions, places)
            terms["swap"] = _swap_log_likelihood(model, images, output.z, frames, donors, log_sigma)
        if self.conditional_prior is None and not remedies.free_bits:
            return terms
        kl_place, kl_condition = self.kl(split, posterior, conditions)
        if self.conditional_prior is not None:
            terms["kl_conditional"] = kl_condition.sum(1)
        if remedies.free_bits:
            for name, block in (("free_place", kl_place), ("free_condition", kl_condition)):
                terms[name] = free_bits(block, remedies.free_bits) - block.mean(0).sum()
        return terms

    def kl(self, split: LatentSplit, posterior: Posterior, conditions: Tensor) -> tuple[Tensor, Tensor]:
        """KL divergence of the posterior from the priors of the run, of each frame and dimension.

        Args:
            split: The order of the blocks.
            posterior: (B, D).
            conditions: (B,) indices.

        Returns:
            That of z_p from N(0, I), (B, P), and of z_c from p(z_c|c), or N(0, I) if that is off, (B, C). In nats.
        """
        kl = posterior.kl()
        if self.conditional_prior is None:
            return split.z_p(kl), split.z_c(kl)
        assert posterior.log_variance is not None
        of_z_c = Posterior(split.z_c(posterior.mean), split.z_c(posterior.log_variance))
        return split.z_p(kl), self.conditional_prior.kl(of_z_c, conditions)

    def objective(self, terms: dict[str, Tensor], weights: Weights) -> Tensor:
        """What a step maximises: the bound with what the remedies add to it.

        Args:
            terms: Those of the bound, and what `forward` gave.
            weights: Weights of the bound's terms.

        Returns:
            Scalar, a mean over frames in nats.
        """
        remedies = self._remedies
        objective = terms["bound"].mean()
        for name, weight in (
            ("contrastive", remedies.contrastive),
            ("adversary", remedies.adversary),
            ("swap", remedies.swap),
            ("free_place", -weights.beta_place),
            ("free_condition", -weights.beta_condition),
        ):
            if name in terms:
                objective = objective + weight * terms[name].mean()
        if "kl_conditional" in terms:
            # Takes the place of the divergence from N(0, I) that the bound holds.
            instead = terms["kl_condition"] - terms["kl_conditional"]
            objective = objective + weights.beta_condition * instead.mean()
        return objective


def _swap_log_likelihood(
    model: ConditionVAE, images: Tensor, z: Tensor, frames: Tensor, donors: Tensor, log_sigma: Tensor
) -> Tensor:
    """Log p(x_b|z_p of a, z_c) for frames b, with a the other frame of the place (Mathieu et al. 2016).

    Args:
        model: The network.
        images: (B, C, H, W); the two frames of a place follow each other.
        z: (B, D), samples.
        frames: (S,), the frames b.
        donors: (S,), the frame whose z_c each is decoded from.
        log_sigma: The image term's. It is held fixed here: it is that of the frames' own reconstructions, which would
            otherwise be made worse to make a swap's error more likely.

    Returns:
        (S,) in nats; one 0 without frames.
    """
    if not len(frames):
        return images.new_zeros(1)
    split = model.split
    other = split.z_p(z).reshape(-1, 2, split.place).flip(1).flatten(0, 1)
    with _running_statistics_kept(model.decoder):
        swapped = model.decoder(split.join(other[frames], split.z_c(z)[donors]))
    return gaussian_log_likelihood(images[frames], swapped, log_sigma.detach())


def _donors(conditions: Tensor, places: Tensor) -> tuple[Tensor, Tensor]:
    """Frames for which the batch holds another place under the same condition, each with the next such one, its donor.

    Args:
        conditions: (B,) indices.
        places: (B,) indices; with four traverses a place may have two pairs in a batch.

    Returns:
        (S,) frames and (S,) donors, around the end of the batch. No frame is alone: its donor has a donor too.
    """
    order = torch.arange(len(conditions), device=conditions.device)
    ahead = (order[None, :] - order[:, None] - 1) % len(order)
    fits = (conditions[None, :] == conditions[:, None]) & (places[None, :] != places[:, None])
    frames = fits.any(1).nonzero().flatten()
    return frames, torch.where(fits, ahead, len(order)).argmin(1)[frames]


@contextmanager
def _running_statistics_kept(network: nn.Module) -> Iterator[None]:
    """Leaves the estimates of batch normalisation alone, which are those of the frames' own latents."""
    layers = [layer for layer in network.modules() if isinstance(layer, nn.modules.batchnorm._BatchNorm)]
    for layer in layers:
        layer.track_running_stats = False
    try:
        yield
    finally:
        for layer in layers:
            layer.track_running_stats = True
