"""Nodes as processes that begin where their imports end: forked from a server that has done those once.

Most of a node's start is the same for each: rclpy, numpy, compiled kernels. With hundreds of starts in the tests that
is minutes. The server begins with the first node, which waits until what is preloaded has been imported and compiled.
Every node still is a process of its own, with a ``main()`` that reads its command line, and gets, obeys and dies of
real signals; that ``python -m`` starts it too is for ``test_operating.py``.
"""

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

PRELOADED = "tests.ros.preloaded"
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload([PRELOADED])


class Forked(_SERVER.Process):
    """A running ``main()`` of a module, which returns the exit status; to be treated like a ``subprocess.Popen``.

    ``arguments`` are those of the command line, without the program's name. The file ``log`` gets stdout and stderr.
    """

    def __init__(self, module: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        super().__init__(target=_run, args=(module, list(arguments), dict(environment), str(log)))
        self.start()

    @property
    def returncode(self) -> int | None:
        """The exit status, negative of a signal; None: it still runs."""
        return self.exitcode

    def poll(self) -> int | None:
        return self.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self.join(timeout)
        if self.exitcode is None:
            raise subprocess.TimeoutExpired(self.name, timeout or 0.0)
        return self.exitcode

    def send_signal(self, number: int) -> None:
        """Nothing happens if it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)


def _run(module: str, arguments: list[str], environment: dict[str, str], log: str) -> None:
    with open(os.devnull, "rb") as nothing, open(log, "wb") as output:
        os.dup2(nothing.fileno(), 0)
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    for name in os.environ.keys() - environment.keys():
        del os.environ[name]
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    sys.exit(import_module(module).main())
