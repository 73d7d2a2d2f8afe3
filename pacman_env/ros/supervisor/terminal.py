"""Terminal of an operator: a status line that is overwritten, and keys that need no Return."""

import contextlib
import os
import select
import shutil
import termios
import textwrap
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from typing import TextIO

LINE_S = 0.5  # between two updates of the line
_CLEAR = "\r\x1b[K"


class LineWriter:
    """Writer of a status line: overwritten on a terminal, elsewhere printed whenever more than its times changes."""

    def __init__(self, out: TextIO) -> None:
        self._out, self._is_terminal = out, out.isatty()
        self._last, self._due_s = "", 0.0
        self._awaited, self._since_s = "", 0.0

    def print(self, text: str, whole: bool = False) -> None:
        """Print a permanent line, wrapped on a terminal unless ``whole`` (for commands that a person may copy)."""
        text = text if whole or not self._is_terminal else wrapped(text, 2)
        print(f"{_CLEAR if self._is_terminal else ''}{text}", file=self._out, flush=True)
        self._due_s = 0.0

    def show(self, line: Callable[[bool], str], at_once: bool = False) -> None:
        """Show the status line: ``line(True)`` contains the times, ``line(False)`` does not."""
        if time.monotonic() < self._due_s and not at_once:
            return
        self._due_s = time.monotonic() + LINE_S
        if self._is_terminal:
            self._out.write(_CLEAR + line(True))
            self._out.flush()
        elif line(False) != self._last:
            self._last = line(False)
            print(line(True), file=self._out, flush=True)

    def wait(self, what: str, at_once: bool = False) -> None:
        if what != self._awaited:
            self._awaited, self._since_s = what, time.monotonic()
        wait_time = f"{time.monotonic() - self._since_s:.0f} s"
        self.show(lambda with_time: fitted([what, wait_time] if with_time else [what]), at_once)


def fitted(parts: Sequence[str], width: int | None = None) -> str:
    """Join the first parts, as many as fit in ``width`` characters (None: the terminal's width)."""
    width = shutil.get_terminal_size().columns - 1 if width is None else width
    line = parts[0]
    for part in parts[1:]:
        if len(line) + 2 + len(part) <= width:
            line += f"  {part}"
    return line if len(line) <= width else f"{line[: max(width - 1, 0)]}…"


def wrapped(text: str, indent: int = 0) -> str:
    """Wrap text between words to the terminal's width and indent all lines but the first. Paths stay whole."""
    width = shutil.get_terminal_size().columns - 1
    indented = " " * indent
    return "\n".join(
        textwrap.wrap(text, width, subsequent_indent=indented, break_on_hyphens=False, break_long_words=False)
    )


@contextlib.contextmanager
def keyboard(source: TextIO) -> Iterator[Callable[[], str] | None]:
    """Yield a function that returns the keys pressed since its last call, in lower case; None without keyboard."""
    settings = None
    with contextlib.suppress(OSError, ValueError, AttributeError):  # no terminal, or one of another process group
        if source.isatty() and os.tcgetpgrp(source.fileno()) == os.getpgrp():
            settings = termios.tcgetattr(source)
            tty.setcbreak(source)
    if settings is None:
        yield None
        return

    def pressed() -> str:
        with contextlib.suppress(OSError, ValueError):
            if select.select([source], [], [], 0.0)[0]:
                return os.read(source.fileno(), 100).decode(errors="ignore").lower()
        return ""

    try:
        yield pressed
    finally:
        with contextlib.suppress(OSError, termios.error):
            termios.tcsetattr(source, termios.TCSADRAIN, settings)
