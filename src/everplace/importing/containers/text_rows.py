"""Text files of other people's tools, line by line: fields, numbers, and messages that name file and line."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath

from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import is_pointer, pointer_sentence
from everplace.importing.containers.file_trees import TreePath

__all__ = ["TextRow", "read_rows"]

_WHOLE = re.compile(r"[+-]?[0-9]{1,19}")
_MOST_CHARACTERS = 1 << 16


@dataclass(frozen=True, slots=True)
class TextRow:
    """One line; reading one of its fields as a number says where it stands if it is none.

    Attributes:
        path: The file.
        number: The line, from 1.
        fields: What stands in it.
    """

    path: TreePath
    number: int
    fields: list[str]

    def __len__(self) -> int:
        """Returns the number of fields."""
        return len(self.fields)

    def wrong(self, what: str) -> RouteError:
        """Returns an error that names the file and the line."""
        return RouteError(f"{readable(self.path)}, line {self.number} {what}")

    def text(self, index: int) -> str:
        """Reads a field.

        Raises:
            RouteError: It is missing.
        """
        if index >= len(self.fields):
            raise self.wrong(f"has {len(self.fields)} fields, but must have {index + 1} or more; correct it")
        return self.fields[index]

    def floats(self, start: int, stop: int) -> list[float]:
        """Reads finite numbers.

        Raises:
            RouteError: A field is missing or is no finite number.
        """
        return [self._float(index) for index in range(start, stop)]

    def whole(self, index: int, what: str) -> int:
        """Reads a whole number of at most 19 digits, written with or without `.0`.

        Raises:
            RouteError: The field is missing or is none.
        """
        text = self.text(index)
        plain = text[:-2] if text.endswith(".0") else text
        if not _WHOLE.fullmatch(plain):
            raise self.wrong(f"holds {text[:40]!r} where {what} must be, a whole number; correct it")
        return int(plain)

    def inside(self, index: int) -> str:
        """Reads the name of a file that lies inside a directory.

        Returns:
            The name with `/`, without `./`.

        Raises:
            RouteError: The name is empty, absolute or leads outside.
        """
        text = self.text(index)
        name = PurePosixPath(text)
        if not name.parts or name.is_absolute() or ".." in name.parts or "\0" in text:
            raise self.wrong(f"names the file {text[:200]!r}, which is not inside the data set; correct it")
        return str(name)

    def _float(self, index: int) -> float:
        text = self.text(index)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.wrong(f"holds {text[:40]!r} where a number must be; correct it")
        return value


def read_rows(path: TreePath, separator: str | None = None) -> Iterator[TextRow]:
    """Reads the lines of a UTF-8 text file; empty lines and those that begin with `#` are passed over.

    Args:
        path: The file.
        separator: What stands between two fields, with spaces around it or not; None: white space.

    Raises:
        RouteError: The file is missing, cannot be read, is no UTF-8 text or has an endless line.
    """
    try:
        with path.open() as data, io.TextIOWrapper(data, encoding="utf-8-sig") as file:
            for number, line in enumerate(iter(lambda: file.readline(_MOST_CHARACTERS), ""), start=1):
                if len(line) == _MOST_CHARACTERS:
                    raise RouteError(
                        f"{readable(path)}, line {number} has more than {_MOST_CHARACTERS} characters, so it is no "
                        "such text file; export it again"
                    )
                if number == 1 and is_pointer(line.encode()):
                    raise RouteError(pointer_sentence(readable(path)))
                text = line.strip()
                if text and not text.startswith("#"):
                    fields = text.split(separator)
                    yield TextRow(path, number, [field.strip() for field in fields] if separator else fields)
    except UnicodeDecodeError as error:
        raise RouteError(f"{readable(path)} is not a UTF-8 text file ({error}); export it again") from error
