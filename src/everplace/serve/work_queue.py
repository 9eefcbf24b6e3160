"""Work beside the event loop: a few threads, and a queue of limited length before them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import TypeVar

from everplace.serve.refusal import too_busy
from everplace.threads import usable_cores

__all__ = ["WorkQueue"]

T = TypeVar("T")
_MOST_WORKERS = 4


class WorkQueue:
    """Runs functions in threads; what does not find a place in the queue is refused at once."""

    def __init__(self, name: str, waiting: int, workers: int = 0, prepare: Callable[[], None] | None = None) -> None:
        """Starts no thread yet.

        Args:
            name: Of its threads.
            waiting: Functions that may wait for a thread.
            workers: Threads; 0: one for each usable core, at most 4.
            prepare: Called once in each thread.
        """
        workers = workers or min(_MOST_WORKERS, usable_cores())
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix=name, initializer=prepare)
        self._most = waiting + workers
        self._under_way = 0

    @property
    def under_way(self) -> int:
        """Functions that run or wait."""
        return self._under_way

    async def run(self, work: Callable[[], T], turn: asyncio.Lock | None = None) -> T:
        """Gives what the function returns, or raises what it raises.

        Whoever waits may give up: the function then runs all the same, and counts until it has.

        Args:
            work: The function.
            turn: Held while it runs; who waits for it takes a place in the queue, but no thread.

        Raises:
            RefusedError: Too many functions wait.
        """
        if self._under_way >= self._most:
            raise too_busy()
        self._under_way += 1
        task = asyncio.ensure_future(self._run(work, turn))
        task.add_done_callback(self._done)
        return await asyncio.shield(task)

    async def _run(self, work: Callable[[], T], turn: asyncio.Lock | None) -> T:
        async with turn or nullcontext():
            return await asyncio.get_running_loop().run_in_executor(self._pool, work)

    def close(self) -> None:
        """Drops what waits, and ends when what runs has ended."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _done(self, future: asyncio.Future[T]) -> None:
        self._under_way -= 1
        if not future.cancelled():
            future.exception()  # nobody may be left to ask for it
