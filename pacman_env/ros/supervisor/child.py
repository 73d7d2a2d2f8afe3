"""Run one node's module as a process that ends when its parent is gone, so that no node outlives ``ros up``.

Started as ``python -m pacman_env.ros.supervisor.child PARENT_PID MODULE ARGUMENTS...``."""

import os
import runpy
import sys

from pacman_env.ros.end_with_parent import end_with_parent


def main() -> None:
    parent, module = int(sys.argv[1]), sys.argv[2]
    end_with_parent()
    if os.getppid() != parent:  # the parent ended before the signal was set
        sys.exit(1)
    sys.argv = sys.argv[2:]
    status: int | None = None
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if not isinstance(end.code, int | None):
            raise
        status = end.code
    # The node has ended; a normal end of the interpreter would take a quarter of its start time.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status or 0)


if __name__ == "__main__":
    main()
