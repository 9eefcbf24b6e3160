"""Nordland: one railway journey in four seasons, in the forms in which it circulates.

| form | what lies there |
|---|---|
| `seasons` | directories or archives `<season>` with `images-00001.png` (OpenSeqSLAM, 64×32; the full frames) |
| `olid` | `{train,test}/<season>_images_<split>/section<k>/<n>.png` |
| `at` | `{database,queries}/@0@<north>@@@@@<n>@@@@@@@@.jpg` |
| `parquet` | `*.parquet` with an image, a season and a number in each row |
| `video` | one video a season |

The same stem in two seasons is the same place in each of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.importing.containers.archive_tree import archives_in, open_trees, unread_note
from everplace.importing.containers.file_trees import TreePath, files_below, read_frames
from everplace.importing.containers.video_frames import VIDEO_ENDINGS
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute, ForeignTraverse, SourceOptions
from everplace.importing.frame_pixels import parse_size, resized
from everplace.importing.sources._nordland_names import (
    SEASONS,
    Copy,
    Named,
    at_frame,
    olid_frame,
    read_list,
    season_frame,
)
from everplace.importing.sources._nordland_presets import PRESETS, choose_frames, paper_protocol
from everplace.route.natural_order import natural_sorted

__all__ = ["EXTRAS", "SUMMARY", "Options", "read"]

SUMMARY = "Nordland: a railway journey in four seasons"

EXTRAS = {"pyarrow": "parquet", "av": "video"}
"""Which extra brings the package that a form needs."""

_LISTS = ("nordland_imageNames.txt", "cleanImageNames.txt")
_LICENCE = (
    "Nordland was filmed by the Norwegian Broadcasting Corporation (NRK); licence claims differ between copies, so "
    "treat it as non-commercial."
)


class Options(SourceOptions):
    """Options of the kind."""

    form: Literal["", "seasons", "olid", "at", "parquet", "video"] = ""
    """seasons, olid, at, parquet or video; by default what lies there decides."""
    seasons: tuple[Literal["spring", "summer", "fall", "winter"], ...] = ()
    """Which seasons to take, such as summer,winter; by default all."""
    preset: Literal["", "27592", "2760", "olid", "paper"] = ""
    """A published protocol: 27592, 2760, olid or paper; sets frames and tolerance."""
    list: tuple[Path, ...] = ()
    """Files that list the frames to take, by file name; several where each season has its own."""
    unfiltered: bool = False
    """Let tunnels and stops take part in preset paper, for want of a list that leaves them out."""
    split: Literal["both", "train", "test"] = "both"
    """The part of the Olid partition: train, test or both."""
    size: Annotated[tuple[int, int] | None, BeforeValidator(parse_size)] = None
    """Resize while reading, such as 64x32 (width × height); by default as stored."""
    database: Literal["spring", "summer", "fall", "winter"] = "summer"
    """The season of `database/` in the `@`-naming."""
    queries: Literal["spring", "summer", "fall", "winter"] = "winter"
    """The season of `queries/` in the `@`-naming."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a copy of Nordland.

    Raises:
        RouteError: It is not in a known form, is damaged, or lacks frames that a list or preset names.
        ConfigError: Two options do not go together.
        MissingExtraError: The form needs a package that is not installed.
    """
    if options.preset == "olid" and options.split == "train":
        raise ConfigError("preset olid is about the test split; leave out `split=train`")
    if options.unfiltered and (options.preset != "paper" or options.list):
        raise ConfigError("unfiltered=true is for preset paper without a list; leave it out")
    copy = _open(source, options)
    preset = PRESETS.get(options.preset)
    stems = {season: copy.stems[season] for season in _seasons(options) if season in copy.stems}
    absent = set(options.seasons).difference(stems)
    if absent or not stems:
        raise RouteError(
            f"{readable(source)} holds {', '.join(copy.stems)}, but not {min(absent or _seasons(options))}; "
            "choose others with `seasons`"
        )
    wants_list = preset is not None and preset.wants_list and not options.unfiltered
    lists = options.list or (_find_list(source) if wants_list else ())
    stems = _listed(stems, lists, source)
    protocol = "" if preset is None else preset.protocol
    if options.preset == "paper":
        protocol = paper_protocol(stems, bool(lists), options.unfiltered)
    if options.preset:
        stems = choose_frames(options.preset, stems)
    notes = [*copy.notes, _LICENCE]
    if options.unfiltered:
        notes.insert(0, "No list was used: tunnels and stops take part.")
    if lists and not options.list:
        notes.insert(0, f"The list {readable(lists[0])} was used.")
    return ForeignRoute(
        traverses=(
            ForeignTraverse(season, resized(copy.read(season, names), options.size), count=len(names))
            for season, names in stems.items()
        ),
        tolerance=copy.tolerance if preset is None else preset.tolerance,
        notes=tuple(notes) if preset is None else (preset.note, *notes),
        protocol=protocol,
        truth_from="the data set's frame numbers, which are in step over the seasons",
    )


def _seasons(options: Options) -> tuple[str, ...]:
    if options.preset == "2760":
        return ("summer", "winter")
    return tuple(season for season in SEASONS if season in (options.seasons or SEASONS))


def _open(source: Path, options: Options) -> Copy:
    """Opens the copy in the form that was chosen or lies there."""
    from everplace.importing.sources._nordland_parquet import open_parquet
    from everplace.importing.sources._nordland_video import open_videos

    split = "test" if options.preset == "olid" else options.split
    for form, endings in (("parquet", (".parquet",)), ("video", tuple(sorted(VIDEO_ENDINGS)))):
        if options.form not in ("", form):
            continue
        files = _files(source, endings)
        if files:
            return open_videos(files) if form == "video" else open_parquet(source, files, split)
        if options.form:
            raise RouteError(f"{readable(source)} holds no file that ends in {' or '.join(endings)}; check the path")
    with contextlib.suppress(RouteError):  # what is wrong with the directory alone, the archives may mend
        unpacked = _open_images(source, open_trees(source, archives=False), options)
        if _is_complete(unpacked, options):
            unpacked.notes += tuple(unread_note(source / name for name in archives_in(source)))
            return unpacked
    return _open_images(source, open_trees(source), options)


def _files(source: Path, endings: tuple[str, ...]) -> list[Path]:
    """Returns the files of these endings: the source itself, or those in it and one directory below."""
    if source.is_dir():
        return [source / name for name in files_below(source, lambda name: name.lower().endswith(endings), 1)]
    return [source] if source.name.lower().endswith(endings) else []


def _open_images(source: Path, trees: Sequence[TreePath], options: Options) -> Copy:
    """Opens a copy that consists of image files, in directories or archives."""
    parse = _parser(source, trees, options.form)
    where: dict[str, dict[str, tuple[TreePath, str]]] = {}
    nowhere: list[str] = []
    furthest = Named("", "0")
    at = {"database": options.database, "queries": options.queries}
    split = "test" if options.preset == "olid" else options.split
    for tree in trees:
        label = _label(tree.source)
        for name in tree.images:
            frame = parse(f"{label}/{name}")
            if frame is None or not frame.season:
                nowhere.append(name)
                continue
            if frame.split and split not in ("both", frame.split):
                continue
            season = at.get(frame.season, frame.season)
            frames = where.setdefault(season, {})
            if frame.stem in frames:
                before, other = frames[frame.stem]
                raise RouteError(
                    f"{readable(before / other)} and {readable(tree / name)} are the same frame of {season} twice; "
                    "keep one of them"
                )
            frames[frame.stem] = (tree, name)
            furthest = max(furthest, frame, key=lambda frame: frame.north)
    if not where:
        raise RouteError(f"{readable(source)} holds no frame of the split that was asked for")

    def read(season: str, stems: Sequence[str]) -> Iterator[ForeignFrame]:
        wanted: dict[TreePath, dict[str, str]] = {}
        for stem in stems:
            tree, name = where[season][stem]
            wanted.setdefault(tree, {})[stem] = name
        for tree, names in wanted.items():
            yield from read_frames(tree, names)

    # The metres of a copy with `@` in its names are made up so that frames within the tolerance are within 25 m.
    tolerance = int(25.0 * int(furthest.stem) / furthest.north) if furthest.north else None
    stems = {season: natural_sorted(frames) for season, frames in where.items()}
    return Copy(stems, read, tolerance, _left_out(nowhere))


def _is_complete(copy: Copy, options: Options) -> bool:
    """Says whether a copy has frames of all seasons that are wanted, and of both splits if it has splits."""
    split = options.split
    parts = ({stem.partition("-")[0] for stem in copy.stems.get(season, ())} for season in _seasons(options))
    return all(part and (split != "both" or part not in ({"test"}, {"train"})) for part in parts)


def _parser(source: Path, trees: Sequence[TreePath], form: str) -> Callable[[str], Named | None]:
    """Returns what reads the names of this form."""
    parsers: dict[str, Callable[[str], Named | None]] = {"olid": olid_frame, "at": at_frame, "seasons": season_frame}
    for name in [form] if form else parsers:
        parse = parsers[name]
        for tree in trees:
            label = _label(tree.source)
            if any((frame := parse(f"{label}/{name}")) is not None and frame.season for name in tree.images):
                return parse
    what = f"form {form}" if form else "known form"
    raise RouteError(
        f"{readable(source)} holds images, but Nordland in no {what}: no directory or archive is named after a season; "
        "see everplace data list"
    )


def _label(path: Path) -> str:
    """What the name of a tree adds to the names in it: it may be the only one to tell the season."""
    return path.absolute().name.split(".")[0]


def _left_out(names: Sequence[str]) -> tuple[str, ...]:
    if not names:
        return ()
    return (f"{len(names)} images were left out that are no frames of a season, the first is {names[0]!a}.",)


def _find_list(source: Path) -> tuple[Path, ...]:
    """Returns the list that comes with a copy, if it does."""
    places = (source, source / "dataset_imageNames", source.absolute().parent / "dataset_imageNames")
    return next(((place / name,) for place in places for name in _LISTS if (place / name).is_file()), ())


def _listed(stems: dict[str, list[str]], lists: Sequence[Path], source: Path) -> dict[str, list[str]]:
    """Returns the frames that the lists name, by name."""
    if not lists:
        return stems
    wanted: dict[str, dict[str, None]] = {season: {} for season in stems}
    for path in lists:
        for frame in read_list(path):
            for season in [frame.season] if frame.season else stems:
                if season in wanted:
                    wanted[season][frame.stem] = None
    for season, names in wanted.items():
        if not names:
            raise RouteError(
                f"no list names a frame of {season}; add its list to `list`, or choose others with `seasons`"
            )
        missing = set(names).difference(stems[season])
        if missing:
            raise RouteError(
                f"{season} in {readable(source)} lacks {len(missing)} of the {len(names)} frames that the list names, "
                f"the first is {natural_sorted(missing)[0]!a}; take the list that belongs to this copy"
            )
    return {season: natural_sorted(names) for season, names in wanted.items()}
