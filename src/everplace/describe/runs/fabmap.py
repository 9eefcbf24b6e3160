"""FAB-MAP (SIFT): binary visual words, compared by the probability that a query was seen at a place.

Cummins and Newman, "FAB-MAP: Probabilistic Localization and Mapping in the Space of Appearance", IJRR 27(6), 2008, with
the default constants of openFABMAP (Glover et al., ICRA 2012). The pieces: `everplace.fabmap.vocabulary` (SIFT and
words), `everplace.fabmap.chow_liu`, `everplace.fabmap.place_likelihood`, `everplace.fabmap.place_posterior`.

Decided here: SIFT instead of SURF; grey images as stored, and those of few pixels enlarged to a short side of 128 (on
64×32 pixels SIFT finds 14 keypoints, enlarged fourfold 45; eightfold no more); no motion model, every place and the new
one equally likely beforehand; no smoothing of the posterior, which changes no order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.fabmap.fabmap_model import FabMap, load_fabmap
from everplace.images.decoding import ImageSpec

__all__ = ["FabMapDescriber", "open_method"]

NOTES = (
    ("RUN of fabmap", "FAB-MAP's visual words (SIFT), with the probability of a new place", "everplace train", 3001),
)


class FabMapDescriber(Describer):
    """Describes with a fitted FAB-MAP.

    A descriptor holds the frame twice, as a place and as an observation, so that two files of descriptors can be
    compared without the run (see `FabMap.embed`).

    Attributes:
        dimension: 2W + 1 for W words; the first W values are the binary words.
        model: Vocabulary and tree.
    """

    method = "fabmap"
    metric = "place-posterior"

    def __init__(self, model: FabMap) -> None:
        self.model = model
        self.image = ImageSpec(model.config.image_size, grey=True)
        self.dimension = 2 * model.config.words + 1
        self.seen_stems = model.seen_stems
        self.seen_images = model.seen_images

    def settings(self) -> Settings:
        """What identifies this model: its configuration, its seed, and the hash of vocabulary and tree."""
        config = self.model.config.model_dump(mode="json")
        size = self.model.config.image_size
        return {
            **config,
            "image_size": f"{size[0]}×{size[1]}" if size else "as stored",
            "seed": int(self.model.about.get("seed", 0)),
            "weights": self.model.sha256[:16],
        }

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes a batch, B×H×W×1 uint8, as B×(2W + 1) float32."""
        return self.model.embed(np.stack([self.model.words(image[..., 0]) for image in images]))


def open_method(argument: str) -> FabMapDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable checkpoint.
    """
    return FabMapDescriber(load_fabmap(Path(argument)))
