"""Work beside the event loop, of which there is never too much."""

from __future__ import annotations

import asyncio
import threading
from functools import partial

import pytest

from everplace.serve.refusal import RefusedError
from everplace.serve.work_queue import WorkQueue


def test_what_finds_no_place_is_refused_at_once() -> None:
    async def story() -> None:
        queue, gate = WorkQueue("test", waiting=2, workers=1), threading.Event()
        held = [asyncio.ensure_future(queue.run(gate.wait)) for _ in range(3)]
        await asyncio.sleep(0)
        assert queue.under_way == 3
        with pytest.raises(RefusedError) as refused:
            await queue.run(lambda: None)
        assert (refused.value.status, refused.value.headers) == (503, {"Retry-After": "1"})
        gate.set()
        assert await asyncio.gather(*held) == [True] * 3
        assert await queue.run(lambda: "again") == "again"
        assert queue.under_way == 0
        queue.close()

    asyncio.run(story())


def test_an_error_is_that_of_who_asked() -> None:
    async def story() -> None:
        queue = WorkQueue("test", waiting=2, workers=1)
        with pytest.raises(ZeroDivisionError):
            await queue.run(lambda: 1 // 0)
        assert (queue.under_way, await queue.run(lambda: 1)) == (0, 1)
        queue.close()

    asyncio.run(story())


def test_who_gives_up_leaves_no_hole() -> None:
    async def story() -> None:
        queue, gate = WorkQueue("test", waiting=0, workers=1), threading.Event()
        waiting = asyncio.ensure_future(queue.run(gate.wait))
        await asyncio.sleep(0)
        waiting.cancel()
        await asyncio.sleep(0.05)
        assert queue.under_way == 1  # it still runs
        gate.set()
        while queue.under_way:
            await asyncio.sleep(0.01)
        queue.close()

    asyncio.run(story())


def test_the_event_loop_goes_on_meanwhile() -> None:
    async def story() -> None:
        queue, gate = WorkQueue("test", waiting=0, workers=1), threading.Event()
        waiting = asyncio.ensure_future(queue.run(lambda: gate.wait(20)))
        await asyncio.sleep(0.01)
        gate.set()  # which nobody could, if the loop waited
        assert await waiting
        queue.close()

    asyncio.run(story())


def test_closing_drops_what_waits() -> None:
    async def story() -> None:
        queue, gate, ran = WorkQueue("test", waiting=3, workers=1), threading.Event(), []
        running = asyncio.ensure_future(queue.run(gate.wait))
        dropped = asyncio.ensure_future(queue.run(lambda: ran.append(1)))
        await asyncio.sleep(0.05)
        threading.Timer(0.1, gate.set).start()
        queue.close()
        assert await running
        with pytest.raises(asyncio.CancelledError):
            await dropped
        assert ran == []

    asyncio.run(story())


def test_who_waits_for_a_turn_takes_no_thread_and_turns_come_in_order() -> None:
    async def story() -> None:
        queue, gate, order = WorkQueue("test", waiting=8, workers=2), threading.Event(), []
        turn = asyncio.Lock()

        def numbered(number: int) -> None:
            gate.wait(20)
            order.append(number)

        held = [asyncio.ensure_future(queue.run(partial(numbered, number), turn)) for number in range(5)]
        await asyncio.sleep(0.05)
        assert await asyncio.wait_for(queue.run(lambda: "another"), 5) == "another"
        assert queue.under_way == 5
        held[2].cancel()  # whose work is done all the same
        gate.set()
        await asyncio.gather(*held, return_exceptions=True)
        assert order == [0, 1, 2, 3, 4]
        assert not turn.locked()
        queue.close()

    asyncio.run(story())
