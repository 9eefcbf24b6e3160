"""What LanceDB raises, as one sentence that names the map."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator

from everplace.errors import MapError, StorageError
from everplace.files import readable

__all__ = ["reading", "reason", "storing"]

_OWN_NAME = re.compile(r"^lance error: (LanceError\(\w+\): )?")
_STORE_ANSWER = re.compile(r"<Message>([^<]+)</Message>")
_OWN_SOURCE = re.compile(r", \S+\.rs:[0-9:]+$")


def reason(error: Exception) -> str:
    """Why LanceDB failed, without what its core says about itself."""
    if (answer := _STORE_ANSWER.search(str(error))) is not None:
        return answer[1]
    line = (str(error) or type(error).__name__).splitlines()[0]
    return _OWN_SOURCE.sub("", _OWN_NAME.sub("", line))[:200]


@contextlib.contextmanager
def reading(address: str) -> Iterator[None]:
    """Turns what LanceDB raises while reading into a MapError."""
    try:
        yield
    except Exception as error:  # LanceDB raises what its core gives
        raise MapError(f"the map {readable(address)} is damaged ({reason(error)}); restore a copy") from None


@contextlib.contextmanager
def storing(address: str) -> Iterator[None]:
    """Turns what LanceDB raises while writing into a StorageError."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        raise StorageError(
            f"cannot write the map {readable(address)}: {reason(error)}; free space or check the permissions"
        ) from error
