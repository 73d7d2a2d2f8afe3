"""Run tasks on a Ray cluster, on this machine or others. No other module imports Ray."""

import importlib
import itertools
import logging
import re
import socket
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any, NamedTuple

from pacman_env import __version__
from pacman_env.engine.cache_folder import package_hash
from pacman_env.plugins import PluginError

from .base import Done, Executor, Homes, Losses, Result, Task, TaskFailed, plain
from .progress import LOG, Progress
from .queue import Queue

_LOOPBACK = "127.0.0.1"
_ANSWER_S = 5.0  # limit for the answer of a cluster
_POLL_S = 1.0  # interval of checking the tasks' times and the cluster's size
_EMPTY_S = 60.0  # a cluster may be without machines for this time


class RayCluster(Executor):
    """Runs tasks on the cluster at ``address``, as printed by ``ray start``; None: a local cluster on the loopback.

    A cluster runs as many tasks at once as it has CPUs, including CPUs that join later. Every worker must have this
    package in the same version with the same sources; the first one that differs ends the run with an error.
    """

    remote = True

    def __init__(self, address: str | None = None, workers: int | None = None, limit_s: float | None = None) -> None:
        import ray

        if ray.is_initialized():
            raise ValueError("--ray: this process is connected to a cluster already")
        if address is not None:
            _check_that_it_answers(address)
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        try:
            if address is None:
                # without "local", Ray would connect to a cluster that is already running on this machine
                own: dict[str, Any] = {"include_dashboard": False, "_node_ip_address": _LOOPBACK}
                own["_system_config"] = {"worker_niceness": 0}  # normal priority; Ray's default is 15
                ray.init("local", num_cpus=workers, **own, **quiet)
            else:
                ray.init(address=address, **quiet)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise ConnectionError(f"--ray {address or ''}: {error}") from None
        self._ray, self._actors = ray, dict[int, Any]()
        self._empty_s = 0.0 if address is None else _EMPTY_S  # no machine can join a local cluster
        self._had_some_s = monotonic()
        self._known, self._metrics = self._machines(), _Metrics()
        super().__init__(max(1, sum(self._known.values())), limit_s)
        # This class handles lost workers and errors of tasks itself.
        self._kind = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Worker)
        self._numbers = itertools.count()
        self._fit: set[int] = set()  # workers that have finished a task

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        ray, name = self._ray, f"{function.__module__}:{function.__qualname__}"
        waiting, losses = Queue(len(tasks), homes, self._owners), Losses(self.progress, self.most_losses)
        running: dict[Any, _Running] = {}
        looked = monotonic()
        try:
            while waiting or running:
                if monotonic() - looked > _POLL_S:
                    self._look()
                    looked = monotonic()
                self._dismiss_unanswered(waiting, running)
                for worker in self._idle(waiting, running):
                    number = waiting.take(worker, self.workers)
                    if number is not None:
                        reference = self._actors[worker].run.remote(name, tasks[number], __version__, package_hash())
                        running[reference] = _Running(worker, number, monotonic())
                self.progress.waiting = len(waiting)
                for reference in ray.wait(list(running), timeout=_POLL_S)[0]:
                    worker, number, _ = running.pop(reference)
                    try:
                        outcome = ray.get(reference)
                    except ray.exceptions.RayTaskError as error:  # the worker failed: task errors are outcomes
                        raise TaskFailed(_cannot_run(str(error))) from None
                    except ray.exceptions.RayError as error:
                        self._dismiss(worker, waiting)
                        yield from losses.note(number, waiting, "its worker was lost", f": {_line(error)}")
                        continue
                    self._fit.add(worker)
                    if outcome.unfit:
                        raise TaskFailed(outcome.unfit)
                    yield Done(number, outcome.value, outcome.error)
                for reference, (worker, number, began) in list(running.items()):
                    if self.limit_s is not None and monotonic() - began > self.limit_s:
                        del running[reference]
                        self._dismiss(worker, waiting)
                        yield Done(number, error=TaskFailed(f"task {number}: more than {self.limit_s} s"))
        finally:  # without calls that need the cluster, which may be gone
            self._metrics.publish(self.progress, self.workers)
            for one in running.values():
                self._dismiss(one.worker, waiting)

    def _idle(self, waiting: Queue, running: Mapping[Any, "_Running"]) -> Iterator[int]:
        """Yield workers without a task, and new ones, up to the number of CPUs, for tasks that these do not take."""
        if waiting:
            yield from self._actors.keys() - {one.worker for one in running.values()}
        while waiting.free and len(self._actors) < self.workers:
            worker = next(self._numbers)
            self._actors[worker] = self._kind.remote()
            yield worker

    def _dismiss_unanswered(self, waiting: Queue, running: dict[Any, "_Running"]) -> None:
        """Dismiss workers that have never answered if CPUs were lost, because they may be on the lost machine."""
        for reference, (worker, number, _) in list(running.items())[::-1]:
            if worker not in self._fit and len(self._actors) > self.workers:
                del running[reference]
                self._dismiss(worker, waiting)
                waiting.put_back(number)

    def _dismiss(self, worker: int, waiting: Queue) -> None:
        self._ray.kill(self._actors.pop(worker))
        self._fit.discard(worker)
        waiting.lose(worker)

    def _look(self) -> None:
        """Update the list of machines and publish the counts; raises ConnectionError if no machine is left."""
        machines = self._machines()
        workers = max(1, sum(machines.values()))
        for name in machines.keys() - self._known.keys():
            LOG.info("machine %s joined: %d workers", name, workers)
        for name in self._known.keys() - machines.keys():
            LOG.warning("machine %s was lost: %d workers", name, workers)
        self._known, self.workers = machines, workers
        if machines:
            self._had_some_s = monotonic()
        elif monotonic() - self._had_some_s > self._empty_s:
            raise ConnectionError("--ray: no machine of the cluster is left")
        self._metrics.publish(self.progress, workers)

    def _machines(self) -> dict[str, int]:
        """Return the number of CPUs by machine."""
        alive = (node for node in self._ray.nodes() if node["Alive"])
        return {
            _name(node["NodeManagerHostname"], node["NodeID"]): int(node["Resources"].get("CPU", 0)) for node in alive
        }

    def close(self) -> None:
        self._ray.shutdown()


def _check_that_it_answers(address: str) -> None:
    """Raise ConnectionError if no cluster answers at an address; Ray itself would try for minutes."""
    host, colon, port = address.rpartition(":")
    if not colon or not port.isdigit():
        raise ValueError(f"--ray {address}: must be HOST:PORT, as `ray start --head` prints it")
    try:
        socket.create_connection((host, int(port)), _ANSWER_S).close()
    except (OSError, OverflowError) as error:
        raise ConnectionError(f"--ray {address}: no cluster answers there: {error}") from None


class _Metrics:
    """Counts for the cluster's dashboard and Prometheus, such as ``ray_pacman_env_tasks_done_total``."""

    def __init__(self) -> None:
        from ray.util.metrics import Counter, Gauge

        self._done = Counter("pacman_env_tasks_done", "Tasks done.")
        self._lost = Counter("pacman_env_tasks_lost", "Tasks whose worker was lost.")
        self._waiting = Gauge("pacman_env_tasks_waiting", "Tasks that wait for a worker.")
        self._workers = Gauge("pacman_env_workers", "Workers.")
        self._before = Progress()

    def publish(self, now: Progress, workers: int) -> None:
        for counter, more in ((self._done, now.done - self._before.done), (self._lost, now.lost - self._before.lost)):
            if more:
                counter.inc(more)
        self._waiting.set(now.waiting)
        self._workers.set(workers)
        self._before = replace(now)


class _Outcome(NamedTuple):
    value: Any = None
    error: Exception | None = None
    unfit: str = ""  # why this worker cannot run tasks


class _Worker:
    """A worker process on any machine."""

    def run(self, name: str, task: Any, version: str, sources: str) -> _Outcome:
        """Call the function ``module:name`` if version and sources are equal; errors are returned as plain data."""
        if (__version__, package_hash()) != (version, sources):
            found = f"pacman_env {__version__}, sources {package_hash()}"
            return _Outcome(
                unfit=f"{_where()}: {found}; the command has {version}, sources {sources}: install the same"
            )
        module, _, function = name.partition(":")
        try:
            return _Outcome(value=getattr(importlib.import_module(module), function)(task))
        except OSError as error:
            return _Outcome(error=OSError(f"{_where()}: {error}"))
        except (PluginError, ImportError) as error:
            return _Outcome(error=TaskFailed(f"{_where()}: {error}"))
        except Exception as error:
            return _Outcome(error=plain(error))


class _Running(NamedTuple):
    worker: int
    number: int  # of the task
    began_s: float


def _where() -> str:
    import ray

    return f"worker on {_name(socket.gethostname(), ray.get_runtime_context().get_node_id())}"


def _name(host: str, node: str) -> str:
    """Return the name of a machine; the start of the node id (``ray list nodes``) distinguishes nodes on one host."""
    return f"{host} (node {node[:12]})"


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300]


def _cannot_run(traceback: str) -> str:
    """Return one line of Ray's traceback of a worker that could not start."""
    place = re.search(r"ip=([^,)\s]+)", traceback)  # only given in the text
    last = next((line.strip() for line in reversed(traceback.splitlines()) if line.strip()), "")
    return f"worker on {place[1] if place else 'an unknown machine'}: cannot run this package: {last[:300]}"
