"""What the server writes to the log: each kind of thing once a minute, and never a token."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable

EVERY_S = 60.0


class Said:
    """Tells what happened, however often it happens, once a minute.

    Args:
        say: writes one line.
        hidden: words that must not be in it: the tokens.
        clock: s.
    """

    def __init__(
        self, say: Callable[[str], None], hidden: Iterable[str] = (), clock: Callable[[], float] = time.monotonic
    ):
        self._say = say
        self._hidden = tuple(hidden)
        self._clock = clock
        self._last: dict[str, tuple[float, int]] = {}

    def __call__(self, kind: str, words: str) -> None:
        """Say ``words``, unless something of its kind was said within a minute."""
        now = self._clock()
        last_s, more = self._last.get(kind, (-EVERY_S, 0))
        if now - last_s < EVERY_S:
            self._last[kind] = last_s, more + 1
            return
        self._last[kind] = now, 0
        self._say(self.without_tokens(" ".join(words.split()) + (f" (and {more} more)" if more else "")))

    def error(self, what: str, error: BaseException) -> None:
        """One line about an error that nobody expected, and where it came from."""
        place = error.__traceback__
        while place is not None and place.tb_next is not None:
            place = place.tb_next
        where = "" if place is None else f" ({place.tb_frame.f_code.co_name}, line {place.tb_lineno})"
        self(f"{what} {type(error).__name__}", f"{what}: {type(error).__name__}: {error}{where}")

    def without_tokens(self, words: str) -> str:
        """The same words, each token as ``...``."""
        for token in self._hidden:
            words = words.replace(token, "...")
        return words


class WithoutTokens(logging.Filter):
    """Takes the tokens out of what a library logs, at any level."""

    def __init__(self, said: Said):
        super().__init__()
        self._said = said

    def filter(self, record: logging.LogRecord) -> bool:
        """The record, with its words put together and the tokens taken out."""
        record.msg, record.args = self._said.without_tokens(record.getMessage()), ()
        if record.exc_info:
            text = logging.Formatter().formatException(record.exc_info)
            record.exc_info, record.exc_text = None, self._said.without_tokens(text)
        return True
