"""Threads that do what is given to them, one thing each at a time, and are not waited for at the end."""

from __future__ import annotations

import threading
import time

import pytest

from pacman_env.web.workers import Workers


def test_what_is_done_is_returned_or_raised() -> None:
    workers = Workers(2, "test")
    assert [workers.submit(pow, 2, k).result(5) for k in range(5)] == [1, 2, 4, 8, 16]
    with pytest.raises(ZeroDivisionError):
        workers.submit(lambda: 1 / 0).result(5)
    workers.shutdown()


def test_there_are_no_more_threads_than_may_be_and_none_that_is_not_needed() -> None:
    workers, go_on = Workers(3, "test-many"), threading.Event()
    for _ in range(10):
        workers.submit(int).result(5)
        time.sleep(0.01)  # the thread is free again
    assert [thread.name for thread in threading.enumerate()].count("test-many") == 1
    futures = [workers.submit(go_on.wait, 5) for _ in range(10)]
    assert [thread.name for thread in threading.enumerate()].count("test-many") == 3
    go_on.set()
    assert all(future.result(5) for future in futures)
    workers.shutdown()


def test_after_the_end_nothing_is_begun_and_nothing_waited_for() -> None:
    workers, begun, go_on = Workers(1, "test-end"), threading.Event(), threading.Event()

    def work() -> None:
        begun.set()
        go_on.wait(5)

    running, waiting = workers.submit(work), workers.submit(work)
    assert begun.wait(5)
    workers.shutdown()
    assert waiting.cancelled()
    assert not running.done()
    with pytest.raises(RuntimeError, match="no more"):
        workers.submit(work)
    go_on.set()
    running.result(5)
