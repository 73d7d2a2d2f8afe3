"""Tasks on a Ray cluster, whose workers are processes of this machine or of others. Nothing else imports Ray."""

import contextlib
import logging
import os
import socket
from collections.abc import Callable, Generator, Sequence
from typing import Any

from pacman_env import __version__
from pacman_env.config.validation import located
from pacman_env.engine.cache_folder import package_hash

from .executor import MOST_LOSSES, Done, Executor, Result, Task, TaskFailed, attempt

_ANSWER_S = 5.0  # longest wait until a cluster answers


class RayCluster(Executor):
    """Run tasks on the cluster at ``address`` (as ``ray start`` prints it); None: on a new cluster on this machine.

    Ray does a task again if its worker or machine is lost. Every worker must have the version and the sources of the
    command, and the files that tasks name, at the same paths.
    """

    def __init__(self, address: str | None = None, workers: int | None = None) -> None:
        import ray

        if ray.is_initialized():
            raise ValueError("--ray: this process is connected to a cluster already")
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        if address is not None:
            _check_that_it_answers(address)
            options["address"] = address
        else:  # without "local" Ray would connect to a cluster that runs on this machine
            options |= {"address": "local", "num_cpus": workers, "include_dashboard": False}
            options |= {"_node_ip_address": "127.0.0.1", "_system_config": {"worker_niceness": 0}}  # Ray's default: 15
        with located(f"--ray {address or ''}", ConnectionError, (ConnectionError, RuntimeError, ValueError)):
            ray.init(**options)
        self._ray = ray
        self._task = ray.remote(num_cpus=1, max_retries=MOST_LOSSES)(_attempt)
        super().__init__(max(1, int(ray.cluster_resources().get("CPU", 1))))

    def run(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Generator[Done[Result], None, None]:
        ray, command = self._ray, (__version__, package_hash(), os.getcwd())
        waiting, running = iter(enumerate(tasks)), dict[Any, int]()
        try:
            while True:
                while len(running) < 2 * self.workers and (task := next(waiting, None)) is not None:
                    running[self._task.remote(function, *task, *command)] = task[0]
                if not running:
                    return
                reference = ray.wait(list(running))[0][0]
                number = running.pop(reference)
                try:
                    yield ray.get(reference)
                except ray.exceptions.RayTaskError as error:
                    raise TaskFailed(f"task {number}: cannot be done: {_last_line(error)}") from None
                except ray.exceptions.RayError as error:
                    text = f"task {number}: its worker was lost {MOST_LOSSES + 1} times: {_last_line(error)}"
                    yield Done(number, error=TaskFailed(text))
        finally:
            for reference in running:
                ray.cancel(reference, force=True)

    def close(self) -> None:
        self._ray.shutdown()


def _attempt(function: Callable[[Any], Any], number: int, task: Any, version: str, sources: str, folder: str) -> Any:
    """Do a task on a worker, in the folder where the user ran the command (if the worker has this folder).

    Relative paths then name the same files as for the user. Raises RuntimeError if the worker's version of the package
    differs from ``version``, or the hash of its sources from ``sources``: both are the user's.
    """
    if (__version__, package_hash()) != (version, sources):
        own = f"worker on {socket.gethostname()}: pacman_env {__version__}, sources {package_hash()}"
        raise RuntimeError(f"{own}; the command has {version}, sources {sources}: install the same")
    with contextlib.suppress(OSError):
        os.chdir(folder)
    return attempt(function, number, task)


def _last_line(error: Exception) -> str:
    return next((line.strip() for line in reversed(str(error).splitlines()) if line.strip()), "")[:300]


def _check_that_it_answers(address: str) -> None:
    """Raise ValueError for an invalid address, ConnectionError if no cluster answers; Ray would try for minutes."""
    host, colon, port = address.rpartition(":")
    if not colon or not port.isdigit():
        raise ValueError(f"--ray {address}: must be HOST:PORT, as `ray start --head` prints it")
    with located(f"--ray {address}: no cluster answers there", ConnectionError, (OSError, OverflowError)):
        socket.create_connection((host, int(port)), _ANSWER_S).close()
