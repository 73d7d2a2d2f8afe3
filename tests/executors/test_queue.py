"""Tasks go to the worker that has their key, keys are shared evenly, and every task is handed out once."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from pacman_env.executors.queue import StickyQueue


def handed_out(keys: list[int] | None, count: int, owners: dict, workers: int, lost: frozenset[int] = frozenset()):  # type: ignore[no-untyped-def, type-arg]
    """The worker of each task, in turns; the workers ``lost`` are lost after their first task, which waits again."""
    queue, found = StickyQueue(count, keys, owners), {}
    alive = list(range(workers))
    while len(queue):
        before = len(queue)
        for worker in list(alive):
            number = queue.next_task(worker, len(alive))
            if number is None:
                continue
            if worker in lost and len(alive) > 1:
                alive.remove(worker)
                queue.drop_worker(worker)
                queue.retry(number)
                before += 1
                continue
            assert number not in found
            found[number] = worker
        assert len(queue) < before, "nobody takes what is waiting"
    return found


def test_without_keys_tasks_go_in_their_order() -> None:
    queue = StickyQueue(3, None, {})
    assert [queue.next_task(worker, 2) for worker in (0, 1, 0, 1)] == [0, 1, 2, None]
    queue.retry(1)
    assert len(queue) == 1
    assert queue.next_task(0, 2) == 1


def test_key_stays_with_its_worker_between_runs() -> None:
    owners: dict = {}  # type: ignore[type-arg]
    keys = list(range(7))
    first = handed_out(keys, 7, owners, 3)
    assert max(Counter(first.values()).values()) == 3
    assert handed_out(keys, 7, owners, 3) == first
    fewer = handed_out(keys[:4], 4, owners, 3)
    assert fewer.keys() == {0, 1, 2, 3}
    assert owners.keys() == {0, 1, 2, 3}


def test_new_worker_gets_its_share_of_keys() -> None:
    owners: dict = {}  # type: ignore[type-arg]
    handed_out(list(range(8)), 8, owners, 1)
    assert Counter(handed_out(list(range(8)), 8, owners, 2).values()) == {0: 4, 1: 4}


@given(st.lists(st.integers(0, 5), max_size=20), st.integers(1, 6), st.frozensets(st.integers(0, 5)), st.booleans())
def test_every_task_is_handed_out_once(keys: list[int], workers: int, lost: frozenset[int], with_keys: bool) -> None:
    owners: dict = {}  # type: ignore[type-arg]
    for _ in range(2):
        found = handed_out(keys if with_keys else None, len(keys), owners, workers, lost)
        assert found.keys() == set(range(len(keys)))
