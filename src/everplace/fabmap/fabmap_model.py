"""FAB-MAP (SIFT) as it is fitted and kept: a vocabulary, a Chow-Liu tree, and frames that stand for the world.

On disk it is a checkpoint like the others: JSON beside safetensors, see `everplace.tensor_file`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from everplace.errors import CheckpointError
from everplace.fabmap.chow_liu import ChowLiuTree
from everplace.fabmap.place_likelihood import observe, sampled_new_place
from everplace.fabmap.vocabulary import FEATURE_DIMENSIONS, sift_features, words_of
from everplace.files import readable
from everplace.model.checkpoint import CHECKPOINT_NAME
from everplace.model.provenance import images_seen, stems_seen
from everplace.settings import Settings, first_problem
from everplace.tensor_file import load_tensors, save_tensors

__all__ = ["FabMap", "FabMapConfig", "load_fabmap", "save_fabmap"]

_FORMAT = 1
_TREE = ("parent", "present", "after_present", "after_absent")


class FabMapConfig(Settings):
    """What decides how an image becomes words, and words probabilities."""

    words: Annotated[int, Field(ge=2, le=2**16)] = 1500
    """Size W of the vocabulary."""
    keypoints: Annotated[int, Field(ge=0, le=2**20)] = 500
    """The strongest SIFT keypoints of an image that are kept; 0: all."""
    smallest_side: Annotated[int, Field(ge=0, le=1024)] = 128
    """Images whose short side is below so many pixels are enlarged to it; 0: never."""
    image_size: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] | None = None
    """(H, W) to which images are stretched first; without it, as stored."""
    new_place: Literal["mean-field", "sampled"] = "mean-field"
    """How likely an observation is at a new place: by mean field, or averaged over sampled frames."""
    samples: Annotated[int, Field(ge=1)] = 3000
    """Most training frames that `sampled` averages over (openFABMAP: 3,000)."""


@dataclass(frozen=True, eq=False)
class FabMap:
    """A fitted FAB-MAP.

    Attributes:
        config: How images become words, and words probabilities.
        vocabulary: W×128 float32, the words' centres.
        tree: How words occur together.
        sample: S×W words of training frames; S = 0 unless the new place is `sampled`.
        about: How it was fitted: seed, fingerprint of the images and their stems, counts.
        sha256: Of the file of the tensors, in hex; empty for a model that was not loaded from a file.
    """

    config: FabMapConfig
    vocabulary: NDArray[np.float32]
    tree: ChowLiuTree
    sample: NDArray[np.bool_]
    about: dict[str, Any] = field(default_factory=dict)
    sha256: str = ""

    @property
    def seen_stems(self) -> frozenset[str]:
        """Stems of the frames that it was fitted on; empty where that was not recorded."""
        return stems_seen(self.about)

    @property
    def seen_images(self) -> frozenset[str]:
        """The images of these places, told by their content; empty where that was not recorded."""
        return images_seen(self.about)

    def words(self, image: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The words of a grey image H×W, (W,); all False for an image without structure."""
        features = sift_features(image, self.config.keypoints, self.config.smallest_side)
        return words_of(features, self.vocabulary)

    def embed(self, words: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Puts all that a comparison needs of each frame into one vector, as a place and as an observation.

        Args:
            words: M×W.

        Returns:
            M×(2W + 1): the W words of the frame as a place, 0 or 1; what each word of a place adds to the
            log-likelihood of the frame as an observation; and the log-likelihood of that observation at a new place,
            less that at a place where no word was seen. `everplace.fabmap.place_posterior` compares them.
        """
        observations = observe(self.tree, words)
        sampled = self.config.new_place == "sampled"
        new_place = sampled_new_place(observations, self.sample) if sampled else observations.new_place
        embedded: NDArray[np.float32] = np.concatenate(
            [words, observations.coefficients, (new_place - observations.nowhere)[:, None]], axis=1
        ).astype(np.float32)
        return embedded


def save_fabmap(run: Path, model: FabMap) -> None:
    """Writes the model into a run directory as its checkpoint.

    Raises:
        StorageError: Writing failed; an earlier checkpoint still stands.
    """
    arrays = {"vocabulary": model.vocabulary, "sample": model.sample} | {
        name: getattr(model.tree, name) for name in _TREE
    }
    tensors = {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}
    document = {
        "format": _FORMAT,
        "model": {"kind": "fabmap", **model.config.model_dump(mode="json")},
        "about": model.about,
    }
    save_tensors(run, CHECKPOINT_NAME, tensors, document)


def load_fabmap(run: Path) -> FabMap:
    """Reads the model of a run directory.

    Raises:
        CheckpointError: There is none, or it is of another version, malformed or altered.
    """
    tensors, document = load_tensors(run, CHECKPOINT_NAME, _FORMAT)
    described = document.get("model")
    try:
        values = (
            {key: value for key, value in described.items() if key != "kind"} if isinstance(described, dict) else None
        )
        config = FabMapConfig.model_validate(values)
    except ValidationError as error:
        problem = first_problem(error, FabMapConfig)
        raise CheckpointError(
            f"{readable(run / CHECKPOINT_NAME)}.json describes no FAB-MAP: {problem.setting or 'model'}: "
            f"{problem.reason}; train again"
        ) from None
    arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
    if not _fits(config, arrays):
        raise CheckpointError(
            f"the tensors in {readable(run)} do not fit the FAB-MAP that checkpoint.json describes; train again"
        )
    about = document.get("about")
    tree = ChowLiuTree(*(arrays[name] for name in _TREE))
    model = FabMap(config, arrays["vocabulary"], tree, arrays["sample"])
    return replace(model, about=about if isinstance(about, dict) else {}, sha256=document["tensors"]["sha256"])


def _fits(config: FabMapConfig, arrays: dict[str, NDArray[Any]]) -> bool:
    """Whether these are all the arrays of such a model, and hold what they may."""
    words = config.words
    wanted = {
        "vocabulary": ((words, FEATURE_DIMENSIONS), np.float32),
        "sample": ((len(arrays.get("sample", ())), words), np.bool_),
        "parent": ((words,), np.int64),
        **dict.fromkeys(_TREE[1:], ((words,), np.float64)),
    }
    if {name: (array.shape, array.dtype.type) for name, array in arrays.items()} != wanted:
        return False
    probabilities = np.stack([arrays[name] for name in _TREE[1:]])
    return bool(
        np.isfinite(arrays["vocabulary"]).all()
        and ((probabilities > 0) & (probabilities < 1)).all()
        and ((arrays["parent"] >= 0) & (arrays["parent"] < words)).all()
        and (len(arrays["sample"]) > 0) == (config.new_place == "sampled")
    )
