"""One task after the other, and several in threads."""

import pickle
from collections.abc import Iterator

import pytest

from pacman_env.executors.base import Executor, InProcess, InThreads, TaskFailed, plain
from tests.executors.contract import ExecutorContract
from tests.executors.functions import Odd


class TestInProcess(ExecutorContract):
    @pytest.fixture
    def executor(self) -> Executor:
        return InProcess()


class TestInThreads(ExecutorContract):
    @pytest.fixture
    def executor(self) -> Iterator[Executor]:
        with InThreads(2) as made:
            yield made


@pytest.mark.parametrize(
    ("error", "kind", "text"),
    [
        (KeyError("there"), KeyError, "'there'"),
        (UnicodeError("no text"), UnicodeError, "no text"),
        (
            FileNotFoundError(2, "No such file", "there"),
            TaskFailed,
            "FileNotFoundError: [Errno 2] No such file: 'there'",
        ),
        (Odd("a word", "home"), TaskFailed, "Odd: a word at home"),
        (TypeError(lambda: 0), TaskFailed, "TypeError: <function"),
        (ValueError(lambda: 0), ValueError, "lambda"),
    ],
)
def test_plain_error_keeps_its_text_when_pickled(error: Exception, kind: type[Exception], text: str) -> None:
    again = pickle.loads(pickle.dumps(plain(error)))
    assert type(again) is kind
    assert text in str(again)
