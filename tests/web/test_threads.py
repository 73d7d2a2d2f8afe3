"""Threads that ask the game: one thing each at a time, and no more of them than may be."""

from __future__ import annotations

import asyncio
import threading

import pytest

from pacman_env.web.sessions import in_thread
from tests.waiting import PATIENCE_S


def test_what_is_done_is_returned_or_raised() -> None:
    async def run() -> None:
        limit = asyncio.Semaphore(2)
        assert [await in_thread(limit, pow, 2, k) for k in range(5)] == [1, 2, 4, 8, 16]
        with pytest.raises(ZeroDivisionError):
            await in_thread(limit, lambda: 1 / 0)

    asyncio.run(run())


def test_there_are_no_more_threads_than_may_be_and_none_is_waited_for_at_the_end() -> None:
    go_on, begun = threading.Event(), []

    def work() -> bool:
        begun.append(threading.current_thread())
        return go_on.wait(PATIENCE_S)

    async def run() -> None:
        limit = asyncio.Semaphore(3)
        tasks = [asyncio.create_task(in_thread(limit, work)) for _ in range(10)]
        await until(3)
        await asyncio.sleep(0.1)
        assert len(begun) == 3
        assert all(thread.daemon for thread in begun)
        go_on.set()
        assert all(await asyncio.gather(*tasks))
        go_on.clear()
        asyncio.create_task(in_thread(limit, work))  # noqa: RUF006 - the loop ends before it does
        await until(11)

    async def until(number: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(begun) < number:
                await asyncio.sleep(0.01)

    asyncio.run(run())
    assert len(begun) == 11
    assert begun[-1].is_alive()
    go_on.set()
    begun[-1].join(PATIENCE_S)
