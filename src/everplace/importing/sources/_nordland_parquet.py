"""Nordland as Parquet files with an image, a season and a number in each row, such as `fansel/nordland`."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from everplace.errors import MissingExtraError, RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.images.formats import image_ending
from everplace.importing.foreign_route import Encoded, ForeignFrame
from everplace.importing.sources._nordland_names import Copy, olid_stem, season_of
from everplace.route.natural_order import natural_sorted

__all__ = ["open_parquet"]

_BATCH = 16  # full frames have up to 2 MB each
_LABEL_BATCH = 2**16
_NUMBERS = ("frame_id", "frame", "number", "index", "id")
_SECTION = re.compile("(train|test)_section([0-9]{1,6})")
# The order of the class labels in fansel/nordland, for files that have lost their names.
_SEASONS = ("fall", "spring", "summer", "winter")


class _Columns(NamedTuple):
    """Which columns hold what, and what their numbers mean."""

    image: str
    season: str
    number: str
    section: str
    seasons: Sequence[str]
    sections: Sequence[str]

    @property
    def labels(self) -> list[str]:
        """All but the image."""
        return [name for name in (self.season, self.number, self.section) if name]


def open_parquet(source: Path, files: Sequence[Path], split: str) -> Copy:
    """Opens a copy in Parquet files, whose rows may come in any order; the labels of all are read, but no image.

    Args:
        source: What the user named.
        files: The files.
        split: train, test or both.

    Raises:
        RouteError: A file is damaged, lacks a column, has a label that is none, or a frame comes twice.
        MissingExtraError: pyarrow is not installed.
    """
    # The row group of each frame tells where to look for its image.
    where: dict[str, dict[str, tuple[Path, int]]] = {}
    for path in files:
        for group, rows in _labels(path):
            for season, stem in rows:
                if split != "both" and stem.startswith(("train-", "test-")) and not stem.startswith(split):
                    continue
                frames = where.setdefault(season, {})
                if stem in frames:
                    raise RouteError(
                        f"{readable(path)} holds the frame {stem} of {season}, which {readable(frames[stem][0])} "
                        "holds as well; give the files of one copy"
                    )
                frames[stem] = (path, group)
    if not where:
        raise RouteError(f"{readable(source)} holds no frame of the split that was asked for")

    def read(season: str, stems: Sequence[str]) -> Iterator[ForeignFrame]:
        groups: dict[tuple[Path, int], set[str]] = {}
        for stem in stems:
            groups.setdefault(where[season][stem], set()).add(stem)
        for (path, group), wanted in groups.items():
            yield from _group_frames(path, group, season, wanted)

    return Copy({season: natural_sorted(frames) for season, frames in where.items()}, read)


def _group_frames(path: Path, group: int, season: str, wanted: set[str]) -> Iterator[ForeignFrame]:
    """Reads the wanted frames of a row group, some rows at a time."""
    with _opened(path) as file:
        columns = _columns(path, file)
        names = [columns.image, *columns.labels]
        for batch in file.iter_batches(_BATCH, row_groups=[group], columns=names):
            for row in batch.to_pylist():
                frame_season, stem = _label(path, row, columns)
                if frame_season == season and stem in wanted:
                    wanted.remove(stem)
                    yield ForeignFrame(stem, _image(path, row[columns.image], stem))
    if wanted:
        raise RouteError(f"{readable(path)} no longer holds the frame {min(wanted)}; import it again")


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Opens a Parquet file and turns what breaks inside into one sentence."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("reading Parquet files", "parquet") from error
    refuse_pointer(path, RouteError)
    try:
        with pyarrow.parquet.ParquetFile(path, pre_buffer=False) as file:
            yield file
    except (pyarrow.ArrowException, OSError, ValueError, TypeError, KeyError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise RouteError(f"{readable(path)} is damaged or no Parquet file ({reason}); fetch it again") from error


def _labels(path: Path) -> Iterator[tuple[int, list[tuple[str, str]]]]:
    """Yields batches of rows as season and stem, each with its row group."""
    with _opened(path) as file:
        columns = _columns(path, file)
        for group in range(file.num_row_groups):
            for batch in file.iter_batches(_LABEL_BATCH, row_groups=[group], columns=columns.labels):
                yield group, [_label(path, row, columns) for row in batch.to_pylist()]


def _columns(path: Path, file: Any) -> _Columns:
    """Finds the columns by their names and kinds."""
    schema = file.schema_arrow
    names = list(schema.names)
    image = [field.name for field in schema if str(field.type).startswith(("struct<", "binary", "large_binary"))]
    number = [name for name in _NUMBERS if name in names]
    if not image or "season" not in names or not number:
        raise RouteError(
            f"{readable(path)} has the columns {', '.join(map(readable, names))}; it must have an image, a season and "
            f"a {' or '.join(_NUMBERS)}"
        )
    labels = _class_names(schema.metadata or {})
    return _Columns(
        image="image" if "image" in image else image[0],
        season="season",
        number=number[0],
        section="section" if "section" in names else "",
        seasons=labels.get("season") or _SEASONS,
        sections=labels.get("section", ()),
    )


def _class_names(metadata: dict[bytes, bytes]) -> dict[str, list[str]]:
    """Returns what the numbers of label columns mean, where the file says so, as those of Hugging Face do."""
    try:
        features = json.loads(metadata.get(b"huggingface", b"{}"))["info"]["features"]
        return {name: [str(label) for label in kind["names"]] for name, kind in features.items() if "names" in kind}
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


def _label(path: Path, row: dict[str, Any], columns: _Columns) -> tuple[str, str]:
    """Returns the season and the stem of a row."""
    season = season_of(_text(path, row[columns.season], columns.seasons, "season"))
    number = row[columns.number]
    if not season or not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise RouteError(
            f"{readable(path)} holds a row of season {row[columns.season]!a} and {columns.number} {number!a}, which is "
            "no frame; fetch it again"
        )
    if not columns.section:
        return season, f"{number:05d}"
    section = _text(path, row[columns.section], columns.sections, "section")
    match = _SECTION.fullmatch(section)
    if match is None:
        raise RouteError(f"{readable(path)} holds a row of section {section!a}, which is none of the Olid partition")
    return season, olid_stem(match[1], int(match[2]), number)


def _text(path: Path, value: Any, names: Sequence[str], what: str) -> str:
    """Returns a label as text."""
    if isinstance(value, int) and not isinstance(value, bool):
        if 0 <= value < len(names):
            return names[value]
        raise RouteError(f"{readable(path)} does not say what {what} {value} is; take a copy with its labels")
    return str(value)


def _image(path: Path, value: Any, stem: str) -> Encoded:
    data = value.get("bytes") if isinstance(value, dict) else value
    if not isinstance(data, bytes) or not data:
        raise RouteError(f"{readable(path)} holds no image for the frame {stem}; take a copy with the images in it")
    ending = image_ending(data)
    if not ending:
        raise RouteError(f"{readable(path)} holds an image of no known format for the frame {stem}; fetch it again")
    return Encoded(data, ending)
