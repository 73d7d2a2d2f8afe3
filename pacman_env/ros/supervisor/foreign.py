"""Run a foreign command, such as ``ros2 launch``, as one process of a game: ``python -m ... COMMAND ARGUMENTS...``.

The command is ended by Ctrl-C (SIGINT): on SIGTERM ``ros2 launch`` would leave its nodes behind. Processes that it
has started and does not end are killed.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from typing import Any

from .child import end_with_parent
from .processes import BAD_START

END_S = 9.0  # must be shorter than ``processes.PATIENCE_S``
POLL_S = 0.1


def main() -> int:
    signals: list[int] = []

    def ask(number: int, frame: Any) -> None:
        signals.append(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, ask)
    words = sys.argv[1:]
    try:
        process = subprocess.Popen(words, start_new_session=True, preexec_fn=lambda: end_with_parent(signal.SIGINT))
    except OSError as error:
        print(f"{words[0]}: {error.strerror}", file=sys.stderr)
        return BAD_START
    while process.poll() is None and not signals:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(POLL_S)
    _end_group(process)
    status = process.wait()
    return 0 if signals else status if status >= 0 else 128 - status


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """Interrupt all processes of the command, and kill processes that do not end."""
    deadline = time.monotonic() + END_S
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
        while time.monotonic() < deadline:
            process.poll()
            os.killpg(process.pid, 0)
            time.sleep(POLL_S)
        os.killpg(process.pid, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main())
