"""The fragment protocol of training with up to thousands of workers, simulated: ``python -m benchmarks.protocol``.

Simulated time passes for fragments (some workers are slower, some fragments longer), for restoring games in a worker
that has not played them, for the learner's network link and for its updates; workers are lost and come back. Who plays
what is decided by the executors' own queue (``pacman_env/executors/queue.py``), whose real time is measured.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import math
import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pacman_env.executors.queue import StickyQueue


@dataclass(frozen=True)
class Setting:
    workers: int
    parts: int  # of the games
    updates: int = 10
    fragment_s: float = 0.6  # 1,024 decisions of the headline recipe on one core
    spread: float = 0.2  # deviation of the logarithm of a fragment's time
    slow_workers: float = 0.02  # share that takes three times as long
    restore_s: float = 1.0  # games in a worker that has not played them: levels are prepared, rounds played again
    fragment_bytes: float = 4.3e6
    link_bytes_per_s: float = 1.25e9  # of the learner
    latency_s: float = 0.005  # from the learner to a worker, and back
    update_s: float = 0.0  # of the network, in which workers wait
    loss_per_fragment: float = 0.001
    back_after_s: float = 30.0


class Outcome(NamedTuple):
    seconds: float  # simulated
    played: list[list[int]]  # for each part, the numbers of the fragments that the learner got
    efficiency: float  # share of the workers' time that was needed for what the learner got
    lost: int
    restored: int
    queue_us: float  # real time of the queue per fragment


class _Workers:
    """Which parts each has, as of which fragment; and the workers that are there."""

    def __init__(self, setting: Setting, rng: np.random.Generator) -> None:
        self.there = set(range(setting.workers))
        self.slowness = np.where(rng.random(setting.workers) < setting.slow_workers, 3.0, 1.0)
        self.keeps: list[dict[int, int]] = [{} for _ in range(setting.workers)]


def simulate(setting: Setting, seed: int = 0) -> Outcome:
    """A training of some updates, in each of which every part plays a fragment."""
    rng = np.random.default_rng(seed)
    workers, owners = _Workers(setting, rng), dict[int, int]()
    played: list[list[int]] = [[] for _ in range(setting.parts)]
    now = needed = queue_s = link_free = 0.0
    lost = restored = handed = 0
    order = itertools.count()
    back: list[tuple[float, int]] = []  # when a lost worker is there again
    for update in range(setting.updates):
        queue = StickyQueue(setting.parts, range(setting.parts), owners)  # type: ignore[arg-type]
        events: list[tuple[float, int, int, int, bool]] = []  # time, order, worker, part, whether the worker is lost
        ready, idle = sorted(workers.there), list[int]()
        left = setting.parts
        while left:
            began = time.perf_counter()
            some = len(idle) if not events else queue.unassigned
            asked, idle = [*ready, *idle[:some]], idle[some:]
            chosen = [(worker, queue.next_task(worker, len(workers.there))) for worker in asked]
            queue_s += time.perf_counter() - began
            ready = []
            for worker, part in chosen:
                if part is None:
                    idle.append(worker)
                    continue
                handed += 1
                fragment_s = setting.fragment_s * math.exp(rng.normal(0.0, setting.spread)) * workers.slowness[worker]
                if workers.keeps[worker].get(part) != update:
                    restored += 1
                    fragment_s += setting.restore_s
                fails = bool(rng.random() < setting.loss_per_fragment)
                ends = now + setting.latency_s + fragment_s * (rng.random() if fails else 1.0)
                heapq.heappush(events, (ends, next(order), worker, part, fails))
                needed += 0.0 if fails else fragment_s
            if back and (not events or back[0][0] < events[0][0]):
                now, worker = heapq.heappop(back)
                workers.there.add(worker)
                ready.append(worker)
                continue
            now, _, worker, part, fails = heapq.heappop(events)
            if fails:
                lost += 1
                workers.there.discard(worker)
                workers.keeps[worker].clear()
                queue.drop_worker(worker)
                queue.retry(part)
                heapq.heappush(back, (now + setting.back_after_s, worker))
                continue
            workers.keeps[worker][part] = update + 1
            link_free = max(link_free, now) + setting.fragment_bytes / setting.link_bytes_per_s
            played[part].append(update)
            left -= 1
            ready.append(worker)
        now = max(now, link_free) + setting.latency_s + setting.update_s
    efficiency = needed / (setting.workers * now)
    return Outcome(now, played, efficiency, lost, restored, 1e6 * queue_s / handed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, nargs="+", default=[10, 100, 1_000, 10_000])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("workers  parts  setting                efficiency  lost  restored  seconds an update  queue us a fragment")
    for workers in arguments.workers:
        plain = Setting(workers, 2 * workers)
        settings = {
            "alike, none lost": replace(plain, spread=0.0, slow_workers=0.0, loss_per_fragment=0.0),
            "some slow, 0.1 % lost": plain,
            "1 % lost": replace(plain, loss_per_fragment=0.01),
            "one part a worker": replace(plain, parts=workers),
        }
        for name, setting in settings.items():
            found = simulate(setting, arguments.seed)
            counts = f"{found.efficiency:10.0%} {found.lost:5d} {found.restored:9d}"
            times = f"{found.seconds / setting.updates:18.2f} {found.queue_us:20.1f}"
            print(f"{workers:7d} {setting.parts:6d}  {name:22s} {counts} {times}", flush=True)


if __name__ == "__main__":
    main()
