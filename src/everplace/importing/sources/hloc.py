"""hloc's files: a list of image pairs, and HDF5 files of features or descriptors as lists of images.

The format is that of Sarlin et al., "From Coarse to Fine: Robust Hierarchical Localization at Large Scale",
CVPR 2019: a line `query reference` a pair, names are paths of images; an HDF5 file has one group an image, its
path as name. An HDF5 file written by `everplace describe` does as well.
"""

from __future__ import annotations

from pathlib import Path

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_data_set
from everplace.importing.containers.file_trees import TreePath, by_stem, read_frames
from everplace.importing.containers.hdf5_names import read_image_names
from everplace.importing.containers.text_rows import read_rows
from everplace.importing.foreign_route import ForeignRoute, ForeignTraverse, ScaledOptions
from everplace.route.truth import TruthPair

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "hloc: a text file of image pairs as the truth, HDF5 or text files as lists of images"

_QUERIES, _DATABASE, _IMAGES = "queries", "database", "images"
_HDF5 = (".h5", ".hdf5")


class Options(ScaledOptions):
    """Options of the kind; files are looked for from the source's directory."""

    pairs: str = "pairs.txt"
    """Text file with a line `query reference` for each pair that shows the same place."""
    images: str = "."
    """Directory of the images."""
    queries: str = ""
    """List of all queries, HDF5 or text; without it those are queries that a pair names first."""
    database: str = ""
    """List of all database images, HDF5 or text; without it those are in it that a pair names second."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a directory of images with a file of pairs, the directory above it, or an archive of it.

    The traverses are `queries` and `database`. Where an image is on both sides (pairs within one set, as of
    covisibility) there is one traverse, `images`. A stem is the image's path with `-` for `/`.

    Raises:
        RouteError: A file is missing or damaged, names an image outside the directory, or the pairs name an image
            that the list of all does not.
    """
    place, notes = find_data_set(source, lambda place: (place / options.pairs).is_file(), options.pairs)
    root = place / options.images
    pairs_file = place / options.pairs
    pairs = _read_pairs(pairs_file)
    if not pairs:
        raise RouteError(f"{readable(pairs_file)} names no pair; give hloc's file of pairs with `pairs=FILE`")
    queries = _side(place, options.queries, [query for query, _ in pairs], pairs_file)
    database = _side(place, options.database, [image for _, image in pairs], pairs_file)
    together = not set(queries).isdisjoint(database)
    sides = {_IMAGES: [*queries, *database]} if together else {_QUERIES: queries, _DATABASE: database}
    listed = {side: by_stem(root, names) for side, names in sides.items()}
    first, *rest = listed
    second = rest[0] if rest else first
    notes.append(f"The pairs of {options.pairs} are taken for the truth; if a retrieval made them, they are none.")
    if together:
        notes.append("Queries and database share images, so they are one traverse.")
    stems = {side: {name: stem for stem, name in found.items()} for side, found in listed.items()}
    listing = f"{readable(pairs_file)} or a list of images"
    return ForeignRoute(
        traverses=(
            ForeignTraverse(side, read_frames(root, found, listing), count=len(found)) for side, found in listed.items()
        ),
        truth=(TruthPair(first, stems[first][query], second, stems[second][image]) for query, image in pairs),
        notes=tuple(notes),
        truth_from=f"the pairs of {readable(options.pairs)}",
    )


def _read_pairs(path: TreePath) -> list[tuple[str, str]]:
    pairs = []
    for row in read_rows(path):
        if len(row) < 2:
            raise row.wrong("holds one name where a query and a reference must be; correct it")
        pairs.append((row.inside(0), row.inside(1)))
    return list(dict.fromkeys(pairs))


def _side(place: TreePath, listing: str, named: list[str], pairs_file: TreePath) -> list[str]:
    """Returns the images of one side, each once: all of a list, or those that the pairs name."""
    if not listing:
        return list(dict.fromkeys(named))
    path = place / listing
    names = _read_hdf5(path) if listing.lower().endswith(_HDF5) else [row.inside(0) for row in read_rows(path)]
    known = dict.fromkeys(names)
    for name in named:
        if name not in known:
            raise RouteError(
                f"{readable(pairs_file)} names {name!r}, which {readable(path)} does not; correct one of them"
            )
    return list(known)


def _read_hdf5(path: TreePath) -> list[str]:
    """Returns the names of the images in a file of features or descriptors."""
    names = read_image_names(path)
    for name in names:
        if not name or name.startswith("/") or ".." in name.split("/") or "\0" in name:
            raise RouteError(f"{readable(path)} names the image {name[:200]!r}, which is not inside the data set")
    if not names:
        raise RouteError(f"{readable(path)} names no image; give a file of features or descriptors")
    return names
