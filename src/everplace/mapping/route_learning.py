"""Adapts a descriptor to a route: from one drive, from aligned drives, or from drives that it matches by itself."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.adaptation.drive_statistics import DriveStatistics, half_differences
from everplace.adaptation.moments import Moments
from everplace.adaptation.place_weights import pair_weights, place_weights
from everplace.adaptation.prior import Prior, load_prior, require_fitting, shipped_prior, write_prior
from everplace.adaptation.route_adaptation import taught_projection, within_places
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.reduced import reduced, unreduced
from everplace.describe.registry import open_describer
from everplace.describe.runs.adapted import AdaptedDescriber, write_adapted
from everplace.errors import ConfigError, RouteError
from everplace.files import readable, require_free_directory, whole_directory
from everplace.images.decoding import ImageSpec, decode_image, decode_images
from everplace.mapping.described_drive import light_moments as moments_of_images
from everplace.mapping.placement import pairs_by_name
from everplace.mapping.self_teaching import SurePairs, sure_pairs
from everplace.mapping.taught_drive import TaughtDrive, places_by_name
from everplace.mapping.teaching_report import ShownDrive, write_teaching_report
from everplace.match.standardise import require_standardisable
from everplace.plots.canvas import Image
from everplace.progress import Progress, quiet, shown
from everplace.route.fingerprint import image_digests
from everplace.route.route import Route
from everplace.route.selection import Selection, select, spread
from everplace.route.traverse import Traverse

__all__ = ["Adaptation", "Learning", "adapt", "drive_statistics", "light_moments"]

_LIGHT_FRAMES = 512
"""Frames of the map that are looked at in other light."""
_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Adaptation:
    """A descriptor adapted to a route, and what it was made from.

    Attributes:
        describer: The result, ready to describe.
        drives: What the other drives taught.
        prior: Where the prior came from: "none", "shipped" or a file.
        prior_weight: Pairs that the prior counts as.
        settings: What is written beside the numbers.
    """

    describer: AdaptedDescriber
    drives: tuple[TaughtDrive, ...]
    prior: str
    prior_weight: float
    settings: dict[str, str | int | float | bool] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """What `--json` prints."""
        return {
            **self.settings,
            "dimension": self.describer.dimension,
            "drives": [drive.summary() for drive in self.drives],
        }


def adapt(
    method: str | os.PathLike[str] | Describer,
    route: Route,
    out: str | os.PathLike[str] | None = None,
    *,
    dimensions: int = 96,
    self_taught: bool = False,
    prior: str | os.PathLike[str] = "default",
    selection: Selection | None = None,
    teach_frames: slice | None = None,
    save_prior: str | os.PathLike[str] | None = None,
    details: Mapping[str, str] | None = None,
    progress: Progress = quiet,
) -> Adaptation:
    """Adapts a descriptor to a route, in closed form.

    With one traverse the map is known and, beside the prior, what other light changes in it. With several that are
    aligned, the pairs of the same place tell how a place changes. Self-taught, the names of later drives are ignored:
    their frames are matched with the first traverse by the route model, and what is sure counts as pairs; the
    second round matches with the descriptor of the first.

    Args:
        method: Any whose descriptors are compared by cosine: a run directory or a name; opened already, nothing can be
            written.
        route: Its first traverse is the map.
        out: The run directory to write; None: nothing is written.
        dimensions: D; lowered to the map's places less one. Frames of one view are one place.
        self_taught: Match the further traverses instead of believing their names.
        prior: "default" (the shipped one, where there is one for the method), "none", or a file of `save_prior`.
        selection: Which places take part.
        teach_frames: Of the further traverses, the places that teach; None: all.
        save_prior: File to write this route's scatter within places to, as a prior for other routes.
        details: Where the report comes from, such as the command: self-taught, `out` holds a page of what was matched.
        progress: Told of the describing and solving.

    Raises:
        ConfigError: The method gives words, the dimensions are below 1, the prior is of another method, or `out` is in
            use.
        RouteError: Nothing is left of the route, or the drives share no places where they must.
        MethodError: The method does not exist or cannot run here.
        CheckpointError: The run directory or the prior is damaged.
        ImageError: A frame cannot be decoded.
        StorageError: `out` or the prior's file cannot be written to.
    """
    if dimensions < 1:
        raise ConfigError(f"`dimensions` {dimensions} is not possible; give at least 1")
    name = method.method if isinstance(method, Describer) else os.fspath(method)
    if out is not None:
        if isinstance(method, Describer):
            raise ConfigError("`method` must be a name or a run directory where `out` is given")
        require_free_directory(Path(out))
    describer = reduced(method if isinstance(method, Describer) else open_describer(method, progress=progress))
    require_standardisable(describer.method, describer.metric)
    known, origin = _chosen_prior(prior, describer)
    chosen = select(route, selection or Selection(), progress, only_shared=not self_taught)
    _require_teachable(chosen, self_taught, teach_frames)
    map_drive, others = chosen.traverses[0], chosen.traverses[1:]
    described = describer.describe(map_drive, progress=progress)
    base = drive_statistics(described.values, light_moments(describer, map_drive, progress))
    taught = [drive[teach_frames] if teach_frames is not None else drive for drive in others]
    for drive in taught:
        if not len(drive):
            raise RouteError(f"no frame of {drive.name!r} is left to learn from; begin `teach_frames` lower")
    features = [describer.describe(drive, progress=progress) for drive in taught]

    learn = Learning(base, described, features, dimensions, known)
    if self_taught:
        pairs = shown(progress, "matching the drives", learn.matched)
    else:
        pairs = [pairs_by_name(drive.stems, map_drive.stems) for drive in taught]
    projection, weight = shown(progress, "solving for the descriptor", lambda: learn.solved(pairs))
    drives = tuple(
        TaughtDrive(
            drive.name,
            drive.stems,
            map_drive.stems,
            found,
            places_by_name(drive.stems, map_drive.stems) if self_taught and chosen.stems_are_places else None,
        )
        for drive, found in zip(taught, pairs, strict=True)
    )
    settings: dict[str, str | int | float | bool] = {
        "method": name,
        "map": map_drive.name,
        "frames": len(map_drive),
        "places": round(base.places.weight),
        "dimensions": len(projection.bias),
        "self_taught": self_taught,
        "prior": origin,
        "prior_weight": weight,
        "pairs": sum(len(found.frames) for found in pairs),
    }
    seen = frozenset(stem for drive, found in zip(taught, pairs, strict=True) for stem in _stems(drive, found))
    whole, projection = unreduced(describer, projection)
    images = [drive.take(found.frames) for drive, found in zip(taught, pairs, strict=True)]
    digests = frozenset(digest for part in images for digest in image_digests(part, progress))
    result = AdaptedDescriber(whole, projection, settings, seen, digests)
    if save_prior is not None:
        none = Moments.none(describer.dimension)
        within = within_places(base + DriveStatistics(none, none, Moments.of(*learn.changes(pairs))), None, 0.0)
        write_prior(Path(save_prior), Prior.of(within, describer.method, describer.settings()))
    adaptation = Adaptation(result, drives, origin, weight, settings)
    if out is not None:
        with whole_directory(Path(out)) as directory:
            write_adapted(directory, name, result, settings)
            if self_taught:
                told = {key: str(settings[key]) for key in ("method", "prior", "dimensions")}
                shown_drives = [
                    ShownDrive(told_drive, _picture_of(drive), _picture_of(map_drive))
                    for told_drive, drive in zip(drives, taught, strict=True)
                ]
                write_teaching_report(directory, map_drive.name, shown_drives, {**told, **(details or {})})
    return adaptation


def _require_teachable(chosen: Route, self_taught: bool, teach_frames: slice | None) -> None:
    """Makes sure that the chosen drives can teach as they are asked to."""
    map_drive, others = chosen.traverses[0], chosen.traverses[1:]
    if len(map_drive) < 3:
        raise RouteError(
            f"the map {map_drive.name!r} has {len(map_drive)} frames; a descriptor is adapted to 3 or more"
        )
    if others and not self_taught and not chosen.aligned:
        raise RouteError(
            f"the traverses of {readable(chosen.root)} {chosen.why_not_aligned}; find the same places with `everplace "
            "data align`, or let the drives be matched with `self_taught`"
        )
    if not others and (self_taught or teach_frames is not None):
        option = "`self_taught`" if self_taught else "`teach_frames`"
        raise RouteError(f"{option} wants a drive beside the map {map_drive.name!r} to learn from; give two traverses")


def drive_statistics(features: NDArray[np.float32], light: Moments | None = None) -> DriveStatistics:
    """What the frames of one drive alone tell of a route: how its places differ, and what other light changes.

    Args:
        features: N×F.
        light: See `light_moments`; None: nothing of it.
    """
    places = Moments.of(features, place_weights(features))
    none = Moments.none(features.shape[1])
    return DriveStatistics(places, light or none, none)


def light_moments(describer: Describer, drive: Traverse, progress: Progress = quiet) -> Moments:
    """What other light, weather and a camera turned a little change in a descriptor of this drive's frames.

    At most 512 frames, evenly spread, are looked at.
    """
    chosen = drive.take(spread(len(drive), _LIGHT_FRAMES))
    return moments_of_images(list(decode_images(chosen.paths, describer.image)), describer, progress)


class Learning:
    """A map and drives, described, from which pairs and in the end a projection are made."""

    def __init__(
        self,
        base: DriveStatistics,
        map_drive: Descriptors,
        drives: Sequence[Descriptors],
        dimensions: int,
        prior: Prior | None,
    ) -> None:
        self._base, self._map, self._drives = base, map_drive, drives
        self._dimensions, self._prior = dimensions, prior
        self._map_weights = place_weights(map_drive.values)
        self._drive_weights = [place_weights(drive.values) for drive in drives]

    def matched(self) -> list[SurePairs]:
        """The sure pairs of every drive, of the last of two rounds."""
        pairs: list[SurePairs] = []
        for _ in range(_ROUNDS):
            projection, _ = self.solved(pairs)
            pairs = [
                sure_pairs(self._projected(self._map, projection), self._projected(drive, projection))
                for drive in self._drives
            ]
        return pairs

    def changes(self, pairs: Sequence[SurePairs]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """K×F half differences of the pairs, and (K,) their weights."""
        differences = [np.empty((0, self._base.places.features), np.float32)]
        weights = [np.empty(0)]
        for found, drive, own in zip(pairs, self._drives, self._drive_weights, strict=False):
            differences.append(half_differences(drive.values[found.frames], self._map.values[found.places]))
            weights.append(pair_weights(found.places, self._map_weights, own[found.frames]))
        return np.concatenate(differences), np.concatenate(weights)

    def solved(self, pairs: Sequence[SurePairs]) -> tuple[Projection, float]:
        """The projection by these pairs, and the weight that the prior has in it."""
        return taught_projection(self._base, *self.changes(pairs), self._dimensions, self._prior)

    @staticmethod
    def _projected(descriptors: Descriptors, projection: Projection) -> Descriptors:
        return Descriptors(projection.apply(descriptors.values), descriptors.names, descriptors.method)


def _picture_of(drive: Traverse) -> Callable[[int], Image]:
    return lambda frame: decode_image(drive.paths[frame], ImageSpec())


def _stems(drive: Traverse, pairs: SurePairs) -> list[str]:
    return [drive.stems[frame] for frame in pairs.frames.tolist()]


def _chosen_prior(prior: str | os.PathLike[str], describer: Describer) -> tuple[Prior | None, str]:
    if prior == "none":
        return None, "none"
    if prior == "default":
        found = shipped_prior(describer.method, describer.settings())
        return found, "none" if found is None else "shipped"
    loaded = load_prior(Path(prior))
    require_fitting(loaded, describer.method, describer.settings(), describer.dimension)
    return loaded, readable(prior)
