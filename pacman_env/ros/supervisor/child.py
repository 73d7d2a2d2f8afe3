"""One node's module as a process that is asked to end when its parent is gone: no node outlives ``ros up``.

Started as ``python -m pacman_env.ros.supervisor.child PARENT_PID MODULE ARGUMENTS...``."""

import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def end_with_parent() -> None:
    """Have this process asked to end when the one that started it has ended; on Linux only."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def main() -> None:
    parent, module = int(sys.argv[1]), sys.argv[2]
    end_with_parent()
    if os.getppid() != parent:  # gone before the signal was set
        sys.exit(1)
    sys.argv = sys.argv[2:]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
