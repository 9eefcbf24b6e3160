"""What a new version of a map is made of: its rows, what is learnt from all frames, and the turn to write."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.adaptation.prior import shipped_prior
from everplace.errors import ConfigError, MapError
from everplace.files import readable
from everplace.importing.positions.pose_track import read_named_poses
from everplace.locking import locked
from everplace.mapping.condition_model import ConditionModel
from everplace.mapping.described_drive import DescribedDrive
from everplace.mapping.map_columns import as_matrix
from everplace.mapping.map_learning import MapFrames, learn, light_arrays, light_of
from everplace.mapping.map_state import MapState
from everplace.mapping.map_tables import MapTables
from everplace.mapping.placement import Placement
from everplace.progress import Progress, shown

__all__ = ["commit_learnt", "drive_entry", "drive_rows", "first_version", "one_writer", "require_free", "with_poses"]


def first_version(
    tables: MapTables,
    document: Mapping[str, Any],
    name: str,
    described: DescribedDrive,
    placement: Placement,
    progress: Progress,
) -> MapState:
    """Makes the tables of a map of one drive, and commits it; what fails leaves none.

    Args:
        tables: Of the map.
        document: See `MapState`.
        name: Of the drive.
        described: The drive, with what other light changes.
        placement: Of the drive.
        progress: Told of the learning.
    """
    assert described.light is not None
    try:
        tables.create(int(document["features"]), int(document["dimensions"]))
        frames = tables.add_frames(drive_rows(name, described, placement))
        before = MapState(0, "", document, light_arrays(described.light), frames)
        return commit_learnt(tables, before, document, frames, progress)
    except BaseException:
        if not tables.finished:
            tables.drop()
        raise


def commit_learnt(
    tables: MapTables,
    before: MapState,
    document: Mapping[str, Any],
    frames_version: int,
    progress: Progress,
    *,
    learns: bool = True,
) -> MapState:
    """Learns from the frames of a new version, and commits it.

    Args:
        tables: Of the map.
        before: The version before, or what stands for it in a new map.
        document: Of the new version, without what is learnt.
        frames_version: Version of the table of frames.
        progress: Told of the learning.
        learns: Whether the descriptor is learnt again.
    """
    tables.require_alone(frames_version, sum(one["frames"] for one in document["drives"]))
    wanted = ["place", "position", "sure", "features", "looks", "between"]
    table = tables.frames(MapState(0, "", document, {}, frames_version), wanted)
    number = {one["name"]: index for index, one in enumerate(document["drives"])}
    features = as_matrix(table["features"])
    frames = MapFrames(
        features=features,
        drives=np.array([number[name] for name in table["drive"].to_pylist()], np.int64),
        places=np.asarray(table["place"]),
        positions=np.asarray(table["position"]),
        sure=np.asarray(table["sure"]),
        between=np.asarray(table["between"]),
        learns=[bool(one["learns"]) for one in document["drives"]],
    )
    kept: dict[str, NDArray[Any]] = {
        key: array for key, array in before.arrays.items() if not key.startswith("condition.")
    }
    new = dict(document)
    if learns or not before.version:
        prior = shipped_prior(str(document["method_name"]), document["settings"])
        learnt = shown(
            progress,
            "learning from the drives",
            lambda: learn(frames, light_of(before.arrays), int(document["dimensions"]), prior),
        )
        kept |= {
            "weight": learnt.projection.weight.astype(np.float32),
            "bias": learnt.projection.bias.astype(np.float32),
            **learnt.held_out.to_arrays(),
        }
        new |= {"calibration": learnt.calibration.to_dict(), "learnt": learnt.known}
    projection = Projection(kept["weight"].astype(np.float64), kept["bias"].astype(np.float64))
    model = ConditionModel.fit(
        as_matrix(table["looks"]), [document["drives"][drive]["condition"] for drive in frames.drives]
    )
    kept |= {f"condition.{key}": array for key, array in model.to_arrays().items() if key != "conditions"}
    new["known_conditions"] = list(model.conditions)
    descriptors = tables.write_descriptors(projection.apply(features))
    made = MapState.new(before.version + 1, new, kept, frames_version, descriptors)
    tables.commit(made)
    return made


def drive_entry(name: str, condition: str, placement: Placement, *, learns: bool) -> dict[str, Any]:
    """What a map's document says of a drive; an empty condition is the name."""
    return {
        "name": name,
        "condition": condition or name,
        "frames": len(placement.places),
        "sure": int(placement.sure.sum()),
        "how": placement.how,
        "learns": learns,
        "agreement": placement.agreement,
    }


def drive_rows(name: str, described: DescribedDrive, placement: Placement) -> dict[str, Any]:
    """The columns of a drive's frames for `MapTables.add_frames`."""
    count = len(described)
    return {
        "drive": [name] * count,
        "number": np.arange(count),
        "stem": list(described.stems),
        "place": placement.places,
        "position": placement.positions,
        "sure": placement.sure,
        "between": placement.between,
        "x": described.poses[:, 0].copy(),
        "y": described.poses[:, 1].copy(),
        "heading": described.poses[:, 2].copy(),
        "seconds": described.seconds,
        "features": described.features,
        "looks": described.looks,
        "thumbnail": list(described.thumbnails),
    }


def with_poses(described: DescribedDrive, file: str | os.PathLike[str] | None) -> DescribedDrive:
    """A drive with the poses of a CSV file in place of its own; None: as it is.

    Raises:
        ConfigError: The file names no frame of the drive.
    """
    if file is None:
        return described
    named = read_named_poses(Path(file))
    unknown = (np.nan,) * 3
    poses = np.array([named.get(stem, unknown) for stem in described.stems], float)
    if np.isnan(poses).all():
        raise ConfigError(
            f"`poses` {readable(file)} names no frame of the drive; its stems must be those of the frames"
        )
    return replace(described, poses=poses)


def require_free(tables: MapTables) -> None:
    """Raises a MapError where a map, or something else, stands already."""
    if tables.finished:
        raise MapError(
            f"a map stands at {readable(tables.address)} already; add the drive with `everplace map add`, or name "
            "another place"
        )
    if tables.others:
        raise MapError(
            f"{readable(tables.address)} holds {readable(tables.others[0])}, which is of no map; name an empty or a "
            "new directory"
        )


@contextlib.contextmanager
def one_writer(address: str | os.PathLike[str]) -> Iterator[None]:
    """One writer at a time; at an object store's address, where nothing can be locked, `MapTables` tells them apart."""
    path = os.fspath(address)
    if "://" in path:
        yield
        return
    made = not Path(path).exists()
    try:
        with locked(Path(path), "the map "):
            yield
    except BaseException:
        if made:
            with contextlib.suppress(OSError):
                Path(path).rmdir()  # where no map came of it
        raise
