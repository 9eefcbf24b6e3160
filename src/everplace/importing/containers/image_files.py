"""Image files below a directory, unpacked or in an archive, and the stems that they get in a route."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TypeVar

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.foreign_route import Content, ForeignFrame
from everplace.route.natural_order import natural_key

__all__ = ["by_stem", "image_names", "read_files", "read_frames", "stem_of"]

_Item = TypeVar("_Item")


def image_names(directory: TreePath) -> list[str]:
    """Lists the images in a directory and its sub-directories; hidden ones are left out, no image is opened.

    Args:
        directory: Where to look. Links to directories are followed, each directory is entered once.

    Returns:
        Paths from `directory` with `/`, in natural order of the stems they get.

    Raises:
        RouteError: The directory does not exist, cannot be listed, holds no image, or a name that is not UTF-8.
    """
    if not directory.is_dir():
        problem = "is not a directory" if directory.is_file() else "does not exist"
        raise RouteError(f"{readable(directory)} {problem}; give the directory of the data set, or its archive")
    if not directory.images:
        raise RouteError(
            f"{readable(directory)} holds no file that ends in {', '.join(sorted(IMAGE_ENDINGS))}; put the images there"
        )
    try:
        "".join(directory.images).encode("utf-8")
    except UnicodeEncodeError as error:
        foreign = min(name for name in directory.images if any("\udc80" <= letter <= "\udcff" for letter in name))
        raise RouteError(f"the name of {readable(directory / foreign)} is not UTF-8; rename it") from error
    return sorted(directory.images, key=lambda name: natural_key(stem_of(name)))


def stem_of(name: str) -> str:
    """Returns the stem of an image in a route: its path without the ending, `night/7.jpg` as `night-7`."""
    folder, slash, last = name.rpartition("/")
    stem = last.rpartition(".")[0] or last
    return (folder + slash + stem).replace("/", "-").lstrip(".") or "-"


def by_stem(directory: TreePath, names: Iterable[str], prefix: str = "") -> dict[str, str]:
    """Returns the names by the stems they get, in the order given.

    Args:
        directory: Where the images are, for the message.
        names: Paths from there.
        prefix: Put before each stem.

    Raises:
        RouteError: Two names get the same stem.
    """
    found: dict[str, str] = {}
    for name in names:
        stem = prefix + stem_of(name)
        if found.setdefault(stem, name) != name:
            raise RouteError(
                f"{found[stem]!r} and {name!r} in {readable(directory)} would both be the frame {stem!r}; keep one of "
                "them, or rename it"
            )
    return found


def read_files(directory: TreePath, names: Mapping[str, _Item], where: str = "") -> Iterator[tuple[_Item, Content]]:
    """Reads files, in an order that suits where they lie.

    Args:
        directory: Where they are.
        names: What each of them is, by path from there.
        where: The list that names them, for the message; empty: they are known to be there.

    Yields:
        What a file is, and its content.

    Raises:
        RouteError: There is no such file, or it cannot be read.
    """

    def there() -> Iterator[str]:
        for name in names:
            if where and not (directory / name).is_file():
                raise RouteError(
                    f"{readable(directory / name)} does not exist, but {where} names it; complete the data set or "
                    "correct the list"
                )
            yield name

    for name, content in directory.read(there()):
        yield names[name], content


def read_frames(directory: TreePath, names: Mapping[str, str], where: str = "") -> Iterator[ForeignFrame]:
    """Reads the frames of which nothing is known but their stems, as `read_files`.

    Args:
        directory: Where they are.
        names: Paths from there, by stem.
        where: The list that names them, for the message; empty: they are known to be there.
    """
    stems = {name: stem for stem, name in names.items()}
    return (ForeignFrame(stem, content) for stem, content in read_files(directory, stems, where))
