"""Log of the server: at most one entry of each kind per minute, with redacted tokens."""

import logging
import time
import traceback
from collections.abc import Callable, Iterable

EVERY_S = 60.0


class Log:
    def __init__(
        self, write: Callable[[str], None], tokens: Iterable[str] = (), clock: Callable[[], float] = time.monotonic
    ):
        self._write, self._tokens, self._clock = write, tuple(tokens), clock
        self._last: dict[str, tuple[float, int]] = {}  # by kind: time (s) of the last line, entries omitted since

    def add(self, kind: str, text: str) -> None:
        """Write one line, unless there was a line of its kind within the last minute."""
        now = self._clock()
        last_s, more = self._last.get(kind, (-EVERY_S, 0))
        if now - last_s < EVERY_S:
            self._last[kind] = last_s, more + 1
            return
        self._last[kind] = now, 0
        self._write(self._redacted(" ".join(text.split()) + (f" (and {more} more)" if more else "")))

    def error(self, what: str, error: BaseException) -> None:
        """Log an unexpected error with the place where it was raised."""
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].name}, line {frames[-1].lineno})" if frames else ""
        self.add(f"{what} {type(error).__name__}", f"{what}: {type(error).__name__}: {error}{where}")

    def redact(self, record: logging.LogRecord) -> bool:
        record.msg = self._redacted(logging.Formatter().format(record))  # with the traceback
        record.args, record.exc_info, record.exc_text = (), None, None
        return True

    def _redacted(self, text: str) -> str:
        for token in self._tokens:
            text = text.replace(token, "...")
        return text
