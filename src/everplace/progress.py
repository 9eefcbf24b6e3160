"""Progress that long work reports, without knowing who shows it.

Library functions take a `Progress` and call `progress(iterable, "what", total)`; the command line passes one that
draws bars on stderr, everyone else gets `quiet`, which does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

__all__ = ["Progress", "quiet", "shown"]

T = TypeVar("T")


class Progress(Protocol):
    """Wraps an iterable and shows how far it has come."""

    def __call__(self, items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        """Yields the items unchanged.

        Args:
            items: What is worked through.
            what: A few words for the person who waits ("decoding winter").
            total: The number of items, if known and `items` has no length.
        """
        ...


def quiet(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:  # noqa: ARG001
    """The `Progress` that shows nothing."""
    yield from items


def shown(progress: Progress, what: str, work: Callable[[], T]) -> T:
    """Does work that cannot say how far it has come, under a bar that only shows that it goes on.

    Args:
        progress: Shows it.
        what: A few words for the person who waits.
        work: What takes more than two seconds.
    """

    def once() -> Iterator[T]:
        yield work()

    (done,) = progress(once(), what)
    return done
