"""Image files below a directory, unpacked or in an archive, and the stems that they get in a route."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TypeVar

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.importing.containers.file_trees import is_image_name
from everplace.importing.containers.tree_path import TreePath
from everplace.importing.foreign_route import Content
from everplace.route.natural_order import natural_key

__all__ = ["by_stem", "image_names", "read_files", "stem_of"]

_Item = TypeVar("_Item")

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))


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
    names = [name for name in directory.tree.files(directory.inside) if is_image_name(name)]
    if not names:
        raise RouteError(
            f"{readable(directory)} holds no file that ends in {', '.join(_ENDINGS)}; put the images there"
        )
    try:
        "".join(names).encode("utf-8")
    except UnicodeEncodeError as error:
        foreign = min(name for name in names if any("\udc80" <= letter <= "\udcff" for letter in name))
        raise RouteError(f"the name of {readable(directory / foreign)} is not UTF-8; rename it") from error
    return sorted(names, key=lambda name: natural_key(stem_of(name)))


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
    """Reads files, in an order that suits the tree.

    Args:
        directory: Where they are.
        names: What each of them is, by path from there.
        where: The list that names them, for the message; empty: they are known to be there.

    Yields:
        What a file is, and its content.

    Raises:
        RouteError: There is no such file, or it cannot be read.
    """
    items = {(directory / name).inside: item for name, item in names.items()}

    def there() -> Iterator[str]:
        for name in items:
            if where and not directory.tree.is_file(name):
                raise RouteError(
                    f"{readable(TreePath(directory.tree, name))} does not exist, but {where} names it; complete the "
                    "data set or correct the list"
                )
            yield name

    for name, content in directory.tree.read(there()):
        yield items[name], content
