"""The models of Oh and Eoh (2021), Figures 2, 4 and 5: an encoder, a decoder and the heads of the labels."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from everplace.model.architecture import Decoder, Encoder
from everplace.model.model_config import ModelConfig
from everplace.model.place_head import PlaceHead, PositionHead
from everplace.model.posterior import LatentSplit, Posterior

__all__ = ["ConditionVAE", "Output"]


@dataclass(frozen=True, slots=True)
class Output:
    """What one pass gives.

    Attributes:
        posterior: q(z|x).
        z: The sample, (B, D).
        reconstruction: Mean of p(x|z), (B, C, H, W), float32.
        condition_logits: (B, conditions); None for the VAE and the CAE.
        place_logits: (B, places); None unless the model is a CP-VAE.
    """

    posterior: Posterior
    z: Tensor
    reconstruction: Tensor
    condition_logits: Tensor | None
    place_logits: Tensor | None


class ConditionVAE(nn.Module):
    """VAE, C-VAE and CP-VAE: one encoder and decoder, with the label heads that the kind has.

    Without sampling and heads it is the plain convolutional autoencoder (`cae`) of the paper's predecessors (Oh and
    Lee, Park; the paper's references 16 and 17). The paper says no more of them than their names; decided: the same
    encoder and decoder as the VAE's, a deterministic code of 128, trained by the squared error of the pixels, so that
    what the VAE adds is the only difference.

    | symbol          | here                     | shape              |
    |-----------------|--------------------------|--------------------|
    | x               | images                   | (B, C, H, W), [0, 1] |
    | q(z_p, z_c|x)   | encoder                  | mean, log-variance (B, 128) |
    | z = [z_p, z_c]  | split                    | (B, 96), (B, 32)   |
    | p(x|z_p, z_c)   | decoder, log_sigma       | (B, C, H, W)       |
    | p(c|z_c)        | condition_head           | (B, conditions)    |
    | p(p|z_p)        | place_head               | (B, places)        |
    """

    log_sigma: Tensor

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        self.split = LatentSplit(config.place_dimensions, config.condition_dimensions)
        self.encoder = Encoder(config)
        self.decoder = Decoder(config)
        self.condition_head = (
            nn.Linear(config.condition_dimensions, len(config.conditions)) if config.labelled else None
        )
        heads: dict[str, type[PlaceHead | PositionHead]] = {"classes": PlaceHead, "position": PositionHead}
        head = heads[config.place_term]
        self.place_head: PlaceHead | PositionHead | None = (
            head(config.place_dimensions, config.places) if config.places else None
        )
        # The sigma that training reached; fixed wherever a bound is evaluated.
        self.register_buffer("log_sigma", torch.zeros(()))

    @property
    def fully_connected(self) -> tuple[nn.Module, ...]:
        """The fully connected chains of encoder and decoder."""
        return (self.encoder.fully_connected, self.decoder.fully_connected)

    def initialise(self) -> None:
        """Sets the encoder's fully connected chain up for training; slow, so not done where weights are loaded.

        Orthogonal matrices (Saxe et al. 2014) hand all that the convolutions see down the chain, evenly.
        """
        for module in (*self.encoder.fully_connected.modules(), self.encoder.z_mean):
            if isinstance(module, nn.Linear):
                nn.init.orthogonal_(module.weight)

    def forward(self, images: Tensor, noise: Tensor) -> Output:
        """Encodes, samples and decodes.

        Args:
            images: (B, C, H, W) in [0, 1].
            noise: (B, D) standard normal.
        """
        posterior = self.encoder(images)
        z = posterior.sample(noise)
        reconstruction = self.decoder(z)
        condition_head, place_head = self.condition_head, self.place_head
        # The heads cost next to nothing, and their logits lose digits that matter in bfloat16.
        with torch.autocast(images.device.type, enabled=False):
            condition_logits = None if condition_head is None else condition_head(self.split.z_c(z))
            place_logits = None if place_head is None else place_head(self.split.z_p(z))
        return Output(posterior, z, reconstruction, condition_logits, place_logits)

    def descriptor(self, images: Tensor) -> Tensor:
        """The place descriptor: the posterior mean of z_p (of all of z for the plain VAE, the code for the CAE).

        It is that of `encoder`, to the bit, without what only the variance needs; with oriented gradients, where z_p
        is read off no feature map, without the convolutions.

        Args:
            images: (B, C, H, W) in [0, 1].

        Returns:
            (B, 96) float32; (B, 128) for the VAE and the CAE.
        """
        if self.encoder.place_projection is not None:
            return self.encoder.projected_place(images)
        mean: Tensor = self.encoder.z_mean(self.encoder.features(images)).float()
        return self.split.z_p(mean) if self.config.labelled else mean
