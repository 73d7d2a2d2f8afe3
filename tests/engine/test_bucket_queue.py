from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.engine.bucket_queue import clear, new_queue, pop, push

KEYS = 12
POP, CLEAR = -1, -2
#: A key to push, a pop, or now and then a clearing.
operations = st.lists(
    st.one_of(st.integers(0, KEYS - 1), st.just(POP), st.sampled_from([POP, POP, CLEAR])), max_size=60
)


@settings(max_examples=200)
@given(operations)
def test_smallest_key_then_newest_item_comes_first(program: list[int]) -> None:
    queue = new_queue(KEYS, len(program) + 1)
    clear(queue)
    model: list[tuple[int, int]] = []  # key, minus the time of the push: the smallest is due
    for time, operation in enumerate(program):
        if operation == CLEAR:
            clear(queue)
            model.clear()
        elif operation == POP:
            model.sort()
            assert pop(queue) == (-model.pop(0)[1] if model else -1)
        else:
            assert push(queue, operation, time)
            model.append((operation, -time))
    rest = [pop(queue) for _ in model]
    assert rest == [-time for _, time in sorted(model)]
    assert pop(queue) == -1


def test_full_queue_and_bad_key_are_refused() -> None:
    queue = new_queue(4, 2)
    clear(queue)
    assert not push(queue, 4, 7)
    assert push(queue, 3, 8)
    assert push(queue, 0, 9)
    assert not push(queue, 1, 10)
    assert [pop(queue) for _ in range(3)] == [9, 8, -1]
    assert not push(queue, 0, 11)  # room counts pushes between two clearings
    clear(queue)
    assert push(queue, 0, 12)
    assert pop(queue) == 12


def test_clearing_forgets_items_when_its_counter_wraps() -> None:
    queue = new_queue(4, 4)
    clear(queue)
    push(queue, 2, 5)
    queue[4][0] = 2**31 - 3
    stamps = []
    for item in range(6):
        stamps.append(int(clear(queue)))
        assert pop(queue) == -1
        assert push(queue, 3, item)
        assert push(queue, 1, 10 + item)
        assert [pop(queue) for _ in range(3)] == [10 + item, item, -1]
    assert stamps == [2**31 - 2, 2**31 - 1, 1, 2, 3, 4]
