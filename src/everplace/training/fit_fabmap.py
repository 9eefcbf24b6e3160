"""Fitting FAB-MAP: a vocabulary by k-means and a Chow-Liu tree by counting, in two passes over the training frames.

The first pass draws as many SIFT features from every frame as make up `vocabulary_features`, for scikit-learn's
MiniBatchKMeans; the second counts how the words occur together. Neither holds more than its sample and the counts,
however many frames there are. Sources: `everplace.describe.runs.fabmap`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from everplace.errors import ConfigError
from everplace.fabmap.chow_liu import WordCounts, learn_tree
from everplace.fabmap.fabmap_model import FabMap, FabMapConfig, save_fabmap
from everplace.fabmap.vocabulary import FEATURE_DIMENSIONS, sift_features, words_of
from everplace.files import readable
from everplace.images.decoding import ImageSpec, decode_images
from everplace.locking import locked
from everplace.model.provenance import SEEN_IMAGES, TRAINED_STEMS
from everplace.progress import Progress, quiet
from everplace.route.fingerprint import file_digests, fingerprint
from everplace.route.route import Route
from everplace.training.config import FitConfig
from everplace.training.resume_state import RunProgress, load_state, save_state
from everplace.training.run_directory import prepare_run, require_same_images, require_usable
from everplace.training.seen_images import seen_images
from everplace.training.select_route import select_route

__all__ = ["FabMapSummary", "FabMapTrainConfig", "fit_fabmap"]

_BLOCK = 256
_ITERATIONS = 30


class FabMapTrainConfig(FabMapConfig, FitConfig):
    """Everything that decides the outcome of a fit, beside the images."""

    model: Literal["fabmap"] = "fabmap"
    """`fabmap`."""
    vocabulary_features: Annotated[int, Field(ge=2)] = 200_000
    """Most SIFT features that the vocabulary is learned from, drawn evenly from the frames."""

    @property
    def fabmap(self) -> FabMapConfig:
        """What of it the fitted model keeps."""
        return FabMapConfig.model_validate({name: getattr(self, name) for name in FabMapConfig.model_fields})


@dataclass(frozen=True, slots=True)
class FabMapSummary:
    """What a fit came to.

    Attributes:
        run: The run directory.
        model: `fabmap`.
        seconds: Of fitting; 0 if the run was finished before.
        frames: Training frames.
        conditions: Names of the conditions.
        words: Size of the vocabulary.
    """

    run: str
    model: str
    seconds: float
    frames: int
    conditions: tuple[str, ...]
    words: int


def fit_fabmap(
    route: Route, config: FabMapTrainConfig, out: Path, *, resume: bool = False, progress: Progress = quiet
) -> FabMapSummary:
    """Fits FAB-MAP to the frames of all chosen traverses.

    Args:
        route: An opened route; the configuration chooses from it.
        config: Everything else that decides the outcome.
        out: The run directory, new or (with `resume`) one that this fit began; a fit that was stopped starts anew.
        resume: Let a finished fit with the same settings and images stand.
        progress: Told of reading and describing.

    Raises:
        RouteError: The route does not have what is chosen.
        ConfigError: The configuration is wrong, the frames hold fewer features than words, or `out` holds another run.
        CheckpointError: What should be resumed is damaged.
        ImageError: A frame cannot be decoded.
        StorageError: The run directory cannot be written to.
    """
    require_usable(out, config, resume)
    chosen = select_route(route, config, progress)
    images = _fingerprint(chosen, progress)
    started = time.monotonic()
    frames = sum(map(len, chosen.traverses))
    with locked(out):
        require_usable(out, config, resume)
        state = load_state(out) if resume else None
        if state is not None:
            require_same_images(state, images, out, route.root)
        if state is None or not state.progress.finished:
            stems = dict.fromkeys(stem for traverse in chosen.traverses for stem in traverse.stems)
            seen = {TRAINED_STEMS: tuple(stems), SEEN_IMAGES: seen_images(route, chosen, stems, progress)}
            model = _fit(chosen, config, {"images": images, **seen}, progress)
            prepare_run(out, config, resume)  # not before: a fit that cannot be leaves no run
            save_fabmap(out, model)
            save_state(out, RunProgress(finished=True), None, None, images)
    seconds = time.monotonic() - started
    return FabMapSummary(str(out), config.model, seconds, frames, chosen.conditions, config.words)


def _fit(route: Route, config: FabMapTrainConfig, seen: dict[str, Any], progress: Progress) -> FabMap:
    features = _sample_features(route, config, progress)
    vocabulary = _vocabulary(features, config)
    counts, sample = WordCounts.none(config.words), []
    total = sum(map(len, route.traverses))
    sampled = np.zeros(total, np.bool_)
    if config.new_place == "sampled":
        drawn = np.random.default_rng((config.seed, 1)).permutation(total)[: config.samples]
        sampled[drawn] = True
    block: list[NDArray[np.bool_]] = []
    for index, found in enumerate(_features(route, config, "words", progress)):
        block.append(words_of(found, vocabulary))
        if sampled[index]:
            sample.append(block[-1])
        if len(block) == _BLOCK or index == total - 1:
            counts.add(np.stack(block))
            block.clear()
    about: dict[str, Any] = {
        "seed": config.seed,
        "frames": total,
        "vocabulary_features": len(features),
        "words_a_frame": float(np.trace(counts.together) / total),
        **seen,
    }
    samples = np.array(sample, np.bool_).reshape(-1, config.words)
    return FabMap(config.fabmap, vocabulary, learn_tree(counts), samples, about)


def _features(route: Route, config: FabMapTrainConfig, what: str, progress: Progress) -> Iterator[NDArray[np.uint8]]:
    """SIFT features of every frame, traverse by traverse."""
    spec = ImageSpec(config.image_size, grey=True)
    for traverse in route.traverses:
        decoded = decode_images(traverse.paths, spec)
        for image in progress(decoded, f"{what} of {traverse.name}", len(traverse)):
            yield sift_features(image[..., 0], config.keypoints, config.smallest_side)


def _sample_features(route: Route, config: FabMapTrainConfig, progress: Progress) -> NDArray[np.uint8]:
    """As many features of every frame as make up the wanted number, drawn by (seed, frame) alone.

    Where there are more frames than features wanted, one of each of so many frames, drawn from all traverses.
    """
    total = sum(map(len, route.traverses))
    share = max(1, config.vocabulary_features // total)
    asked = np.ones(total, np.bool_)
    if total > config.vocabulary_features:
        asked[np.random.default_rng((config.seed, 2)).permutation(total)[config.vocabulary_features :]] = False
    sample: list[NDArray[np.uint8]] = [np.zeros((0, FEATURE_DIMENSIONS), np.uint8)]
    for index, found in enumerate(_features(route, config, "SIFT features", progress)):
        if asked[index]:
            drawn = np.random.default_rng((config.seed, 0, index)).permutation(len(found))[:share]
            sample.append(found[np.sort(drawn)])
    features = np.concatenate(sample)
    distinct = len(np.unique(features, axis=0)) if len(features) else 0
    if distinct < config.words:
        raise ConfigError(
            f"the frames of {readable(route.root)} gave {distinct} different SIFT features, too few for "
            f"words = {config.words}; lower words, raise vocabulary_features, or fit on more frames"
        )
    return features


def _vocabulary(features: NDArray[np.uint8], config: FabMapTrainConfig) -> NDArray[np.float32]:
    from sklearn.cluster import MiniBatchKMeans

    means = MiniBatchKMeans(
        config.words, random_state=config.seed, batch_size=4096, n_init=1, max_iter=_ITERATIONS, init="k-means++"
    )
    centres: NDArray[np.float32] = means.fit(features.astype(np.float32)).cluster_centers_.astype(np.float32)
    return centres


def _fingerprint(route: Route, progress: Progress) -> str:
    """SHA-256, in hex, of all images with their conditions and stems."""
    labels = [(traverse.condition, traverse.stems) for traverse in route.traverses]
    return fingerprint(labels, chain.from_iterable(file_digests(traverse, progress) for traverse in route.traverses))
