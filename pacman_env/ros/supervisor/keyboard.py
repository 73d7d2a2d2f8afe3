"""Keys that are pressed on a terminal, one at a time and without Return."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from typing import Any, TextIO

if sys.platform != "win32":
    import termios
    import tty


class Keyboard:
    """Reads keys while it is entered, if there is a terminal to read from.

    Args:
        source: where keys come from, standard input by default.
    """

    def __init__(self, source: TextIO | None = None) -> None:
        self._source = sys.stdin if source is None else source
        self._before: Any = None

    @property
    def there(self) -> bool:
        """Whether keys can be read."""
        return self._before is not None

    def __enter__(self) -> Keyboard:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # no terminal, or none that is ours
            if self._source.isatty() and os.tcgetpgrp(self._source.fileno()) == os.getpgrp():
                self._before = termios.tcgetattr(self._source)
                tty.setcbreak(self._source)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._before is not None:
            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(self._source, termios.TCSADRAIN, self._before)
            self._before = None

    def pressed(self) -> str:
        """The keys since the last call, in lower case; empty: none."""
        if not self.there:
            return ""
        with contextlib.suppress(OSError, ValueError):
            if select.select([self._source], [], [], 0.0)[0]:
                return os.read(self._source.fileno(), 100).decode(errors="ignore").lower()
        return ""
