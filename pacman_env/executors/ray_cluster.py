"""Tasks on a Ray cluster, whose workers are processes of this machine or of others. Nothing else imports Ray."""

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
from pacman_env.config.validation import located
from pacman_env.engine.cache_folder import package_hash
from pacman_env.plugins import PluginError

from .base import Done, Executor, Keys, Result, Task, TaskFailed, WorkerLosses, plain
from .progress import LOG, Progress
from .queue import StickyQueue

_LOOPBACK = "127.0.0.1"
_ANSWER_S = 5.0  # within which a cluster answers
_POLL_S = 1.0  # between two looks at the size of the cluster
_EMPTY_S = 60.0  # so long a cluster may have no machine


class RayCluster(Executor):
    """``address`` of a cluster, as ``ray start`` prints it; None: one of this machine, on the loopback alone.

    A cluster runs one task per CPU at a time, also on CPUs that join later. Every worker must have this
    package in the same version with the same sources; the first that has not ends the run, and is named.
    """

    remote = True

    def __init__(self, address: str | None = None, workers: int | None = None) -> None:
        import ray

        if ray.is_initialized():
            raise ValueError("--ray: this process is connected to a cluster already")
        if address is not None:
            _check_that_it_answers(address)
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        with located(f"--ray {address or ''}", ConnectionError, (ConnectionError, RuntimeError, ValueError)):
            if address is None:
                # without "local" it would connect to a cluster that someone has started on this machine
                own: dict[str, Any] = {"include_dashboard": False, "_node_ip_address": _LOOPBACK}
                own["_system_config"] = {"worker_niceness": 0}  # like other processes; the default of Ray is 15
                ray.init("local", num_cpus=workers, **own, **quiet)
            else:
                ray.init(address=address, **quiet)
        self._ray, self._actors = ray, dict[int, Any]()
        self._empty_s = 0.0 if address is None else _EMPTY_S  # no machine joins one's own cluster
        self._had_some_s = monotonic()
        self._known, self._metrics = self._machines(), _Metrics()
        super().__init__(max(1, sum(self._known.values())))
        # Lost workers are counted here; an exception of a task is its result.
        self._kind = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Worker)
        self._numbers = itertools.count()
        self._answered: set[int] = set()  # workers that have done a task

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], keys: Keys
    ) -> Generator[Done[Result], None, None]:
        ray, name = self._ray, f"{function.__module__}:{function.__qualname__}"
        waiting, losses = StickyQueue(len(tasks), keys, self._owners), WorkerLosses(self.progress, self.most_losses)
        running: dict[Any, tuple[int, int]] = {}  # the worker and the task
        looked = monotonic()
        try:
            while waiting or running:
                if monotonic() - looked > _POLL_S:
                    self._update_cluster()
                    looked = monotonic()
                self._drop_surplus(waiting, running)
                for worker in self._idle(waiting, running):
                    number = waiting.next_task(worker, self.workers)
                    if number is not None:
                        reference = self._actors[worker].run.remote(name, tasks[number], __version__, package_hash())
                        running[reference] = worker, number
                self.progress.waiting = len(waiting)
                for reference in ray.wait(list(running), timeout=_POLL_S)[0]:
                    worker, number = running.pop(reference)
                    try:
                        outcome = ray.get(reference)
                    except ray.exceptions.RayTaskError as error:  # all that the task raises is an outcome
                        raise TaskFailed(_cannot_run(str(error))) from None
                    except ray.exceptions.RayError as error:
                        self._drop_worker(worker, waiting)
                        reason = " ".join(str(error).split())[:300]
                        yield from losses.note(number, waiting, "its worker was lost", f": {reason}")
                        continue
                    self._answered.add(worker)
                    if outcome.unusable:
                        raise TaskFailed(outcome.unusable)
                    yield Done(number, outcome.value, outcome.error)
        finally:  # without a question to the cluster, which may be gone
            self._metrics.publish(self.progress, self.workers)
            for worker, _ in running.values():
                self._drop_worker(worker, waiting)

    def _idle(self, waiting: StickyQueue, running: Mapping[Any, tuple[int, int]]) -> Iterator[int]:
        """Yield workers without a task, then new ones, up to the number of CPUs, for the tasks of no worker."""
        if waiting:
            yield from self._actors.keys() - {worker for worker, _ in running.values()}
        while waiting.unassigned and len(self._actors) < self.workers:
            worker = next(self._numbers)
            self._actors[worker] = self._kind.remote()
            yield worker

    def _drop_surplus(self, waiting: StickyQueue, running: dict[Any, tuple[int, int]]) -> None:
        """After a loss of CPUs drop workers that never answered: they may wait for a machine that is gone."""
        for reference, (worker, number) in list(running.items())[::-1]:
            if worker not in self._answered and len(self._actors) > self.workers:
                del running[reference]
                self._drop_worker(worker, waiting)
                waiting.retry(number)

    def _drop_worker(self, worker: int, waiting: StickyQueue) -> None:
        self._ray.kill(self._actors.pop(worker))
        self._answered.discard(worker)
        waiting.drop_worker(worker)

    def _update_cluster(self) -> None:
        """Notice machines that come and go, and publish the counts."""
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
        """Return the number of CPUs of each machine by its name."""
        alive = (node for node in self._ray.nodes() if node["Alive"])
        return {
            _name(node["NodeManagerHostname"], node["NodeID"]): int(node["Resources"].get("CPU", 0)) for node in alive
        }

    def close(self) -> None:
        self._ray.shutdown()


def _check_that_it_answers(address: str) -> None:
    """Raise an error at once; Ray itself would try for minutes."""
    host, colon, port = address.rpartition(":")
    if not colon or not port.isdigit():
        raise ValueError(f"--ray {address}: must be HOST:PORT, as `ray start --head` prints it")
    with located(f"--ray {address}: no cluster answers there", ConnectionError, (OSError, OverflowError)):
        socket.create_connection((host, int(port)), _ANSWER_S).close()


class _Metrics:
    """The counts, for the cluster's dashboard and Prometheus: ``ray_pacman_env_tasks_done_total`` and others."""

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
    unusable: str = ""  # why this worker cannot do any task


class _Worker:
    """A process on any of the machines."""

    def run(self, name: str, task: Any, version: str, sources: str) -> _Outcome:
        """Call ``module:name``, if the version and the sources are the command's; exceptions become plain data."""
        if (__version__, package_hash()) != (version, sources):
            found = f"pacman_env {__version__}, sources {package_hash()}"
            return _Outcome(
                unusable=f"{_here()}: {found}; the command has {version}, sources {sources}: install the same"
            )
        module, _, function = name.partition(":")
        try:
            return _Outcome(value=getattr(importlib.import_module(module), function)(task))
        except OSError as error:
            return _Outcome(error=OSError(f"{_here()}: {error}"))
        except (PluginError, ImportError) as error:
            return _Outcome(error=TaskFailed(f"{_here()}: {error}"))
        except Exception as error:
            return _Outcome(error=plain(error))


def _here() -> str:
    import ray

    return f"worker on {_name(socket.gethostname(), ray.get_runtime_context().get_node_id())}"


def _name(host: str, node: str) -> str:
    """Return the name of a machine; the node's number, as in ``ray list nodes``, tells two on one host apart."""
    return f"{host} (node {node[:12]})"


def _cannot_run(traceback: str) -> str:
    """Return one line of Ray's text about a worker that could not start."""
    place = re.search(r"ip=([^,)\s]+)", traceback)  # Ray gives it in the text alone
    last = next((line.strip() for line in reversed(traceback.splitlines()) if line.strip()), "")
    return f"worker on {place[1] if place else 'an unknown machine'}: cannot run this package: {last[:300]}"
