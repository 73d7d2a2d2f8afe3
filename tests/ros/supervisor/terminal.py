"""A command on a terminal of 80 columns, for tests."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Callable

COLUMNS = 80
PATIENCE_S = 120.0  # for whole rounds on a busy machine


class Terminal:
    """A command on a terminal of its own: what it shows, line after line, and keys."""

    def __init__(self, command: list[str]) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, COLUMNS, 0, 0))
        environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # as a shell does it
        )
        os.close(slave)
        self._shown = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        try:
            while block := os.read(self._master, 65536):
                self._shown += block
        except OSError:
            pass  # the other end is closed

    @property
    def lines(self) -> list[str]:
        """Everything shown, also what was written over."""
        return [line for line in re.split(r"\r\n|\r\x1b\[K|\n|\r", self._shown.decode()) if line.strip()]

    @property
    def too_long(self) -> list[str]:
        """Lines that do not fit, but for those with the path of a log, and the middleware's own."""
        others = ("/logs", "RTPS_")
        return [line for line in self.lines if len(line) >= COLUMNS and not any(word in line for word in others)]

    def press(self, key: str) -> None:
        os.write(self._master, key.encode())

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            shown = "\n".join(self.lines[-20:])
            assert self.process.poll() is None, f"ended while waiting for {what}:\n{shown}"
            assert time.monotonic() < end, f"waited for {what}:\n{shown}"
            time.sleep(0.05)

    def shows(self, pattern: str, since: int = 0) -> bool:
        return any(re.search(pattern, line) for line in self.lines[since:])

    def end(self) -> int:
        status = self.process.wait(PATIENCE_S)
        self._reader.join(5.0)
        return status
