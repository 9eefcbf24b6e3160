"""Work in several threads: how many there may be, and results in order, ahead of their reader."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

__all__ = ["map_ahead", "usable_cores"]

T = TypeVar("T")
R = TypeVar("R")


def map_ahead(function: Callable[[T], R], items: Iterable[T], *, threads: int | None = None) -> Iterator[R]:
    """Applies a function to items in order, some ahead of the reader.

    Args:
        function: Called in several threads at once.
        items: Its arguments.
        threads: How many; None: one for each usable core, at most 8. Two results a thread are held ahead.

    Yields:
        What it returns, in the order of `items`. What it raises is raised when the reader reaches it.
    """
    threads = threads or min(8, usable_cores())
    pool = ThreadPoolExecutor(threads, thread_name_prefix="ahead")
    ahead: deque[Future[R]] = deque()
    try:
        for item in items:
            ahead.append(pool.submit(function, item))
            if len(ahead) > 2 * threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def usable_cores() -> int:
    """Returns the number of cores this process may use (a container's share, where the system tells)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
