"""Work in several threads: how many there may be, how they wait, and results in order, ahead of their reader."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

__all__ = ["map_ahead", "one_torch_thread", "usable_cores", "wait_briefly"]

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


def wait_briefly() -> None:
    """Has the threads of GNU's OpenMP, with which torch computes, wait for each other 50 µs awake and then asleep.

    By default they run on the spot for some 15 ms. Where another process wants the core, the thread that is waited for
    does not get it meanwhile, and what takes half a millisecond alone takes hundreds. A thousand turns are what the
    library itself takes where it knows that threads outnumber cores; it does not know of other processes. (None at
    all, which is `OMP_WAIT_POLICY=passive`, is slower on quiet cores.)

    To be called before torch is imported, which reads the setting once. What the user set stands.
    """
    if "OMP_WAIT_POLICY" not in os.environ:
        os.environ.setdefault("GOMP_SPINCOUNT", "1000")


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Has torch compute in the calling thread alone while it is open, for work too small to be shared out.

    It costs less than a microsecond.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
