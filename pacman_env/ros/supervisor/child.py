"""One node's module as a process that is asked to end when its parent is gone: no node outlives ``ros up``.

Started as ``python -m pacman_env.ros.supervisor.child PARENT_PID MODULE ARGUMENTS...``."""

import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def end_with_parent(number: int = signal.SIGTERM) -> None:
    """Have this process get that signal when the one that started it has ended; on Linux only."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


def main() -> None:
    parent, module = int(sys.argv[1]), sys.argv[2]
    end_with_parent()
    if os.getppid() != parent:  # gone before the signal was set
        sys.exit(1)
    sys.argv = sys.argv[2:]
    status: int | None = None
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if not isinstance(end.code, int | None):
            raise
        status = end.code
    # The node has left; the end of the interpreter would take a quarter of the time of its start.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status or 0)


if __name__ == "__main__":
    main()
