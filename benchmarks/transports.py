"""What UDP alone costs beside shared memory: ``python -m benchmarks.transports``.

Two processes on one machine exchange messages, one at a time: the time from publishing to the answer, and what a
message costs on the processor, of both processes. Small ones are as the game's own, large ones as a map.
"""

import argparse
import os
import sys
import time
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.harness import benchmark, count, turns

TRANSPORTS = {"UDP alone": "", "shared memory": "DEFAULT"}  # what the environment asks for; empty: the package's own
SIZES = {"small": 100, "large": 100_000}  # bytes
PATIENCE_S = 120.0
_AGAIN_S = 5.0  # a message without an answer is lost: its reader was not discovered yet


def _node(name: str, domain: int, transports: str) -> Any:
    from pacman_env.ros.discovery import PROFILES, TRANSPORTS, join
    from pacman_env.ros.node import Observer

    for variable in (TRANSPORTS, *PROFILES):
        os.environ.pop(variable, None)
    if transports:
        os.environ[TRANSPORTS] = transports
    return Observer(name, "/transports", join(domain, this_machine=True))


def _answer(domain: int, transports: str) -> None:
    from std_msgs.msg import String

    node = _node("answering", domain, transports)
    publisher = node.create_publisher(String, "answer", 10)
    node.create_subscription(String, "question", publisher.publish, 10)
    while True:
        node.spin(1.0)


def _ask(domain: int, transports: str, size: int, messages: int, results: Any) -> None:
    from std_msgs.msg import String

    node, answered = _node("asking", domain, transports), [0]
    publisher = node.create_publisher(String, "question", 10)

    def receive(message: Any) -> None:
        answered[0] += 1

    node.create_subscription(String, "answer", receive, 10)
    question, took_s = String(data="x" * size), []
    end_s = time.monotonic() + PATIENCE_S
    while not answered[0] and time.monotonic() < end_s:
        publisher.publish(question)
        node.spin_until(lambda: answered[0], 0.2)
    node.spin_until(lambda: False, 0.5)
    began_cpu_s = time.process_time()
    for _ in range(messages):
        had, began_s = answered[0], time.perf_counter()
        publisher.publish(question)
        if node.spin_until(lambda had=had: answered[0] > had, _AGAIN_S):
            took_s.append(time.perf_counter() - began_s)
    results.put((took_s, time.process_time() - began_cpu_s))


def measure(transports: str, size: int, messages: int, domain: int) -> dict[str, float]:
    """RuntimeError where the two processes do not find each other."""
    context = get_context("spawn")
    results = context.Queue()
    answering = context.Process(target=_answer, args=(domain, transports), daemon=True)
    asking = context.Process(target=_ask, args=(domain, transports, size, messages, results), daemon=True)
    answering.start()
    asking.start()
    try:
        took_s, cpu_s = results.get(timeout=PATIENCE_S + _AGAIN_S * messages)
    finally:
        for process in (asking, answering):
            process.terminate()
            process.join()
    if not took_s:
        raise RuntimeError("no message was answered")
    median_ms, p99_ms = 1000.0 * np.percentile(took_s, (50, 99))
    return {"median_ms": float(median_ms), "p99_ms": float(p99_ms), "cpu_ms": 1000.0 * cpu_s / len(took_s)}


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    print(f"{'':<8}{'':<15}  to the answer: median ms  99 % ms  processor ms a message, of the one that asks")
    for size_name, size in SIZES.items():
        rounds = turns(
            arguments.rounds,
            *(
                lambda wanted=wanted, size=size: measure(wanted, size, arguments.messages, arguments.domain_id)
                for wanted in TRANSPORTS.values()
            ),
        )
        for number, name in enumerate(TRANSPORTS):
            found = {key: float(np.median([one[number][key] for one in rounds])) for key in rounds[0][number]}
            figures[f"{size_name}, {name}"] = found
            print(
                f"{size_name:<8}{name:<15}  {found['median_ms']:24.2f}  {found['p99_ms']:7.2f}  {found['cpu_ms']:20.2f}"
            )
    return figures


main = benchmark(
    "transports",
    __doc__,
    run,
    "--domain-id",
    "--rounds",
    count("--messages", 1000, "of a turn (%(default)s)"),
    extra="ros",
)

if __name__ == "__main__":
    sys.exit(main())
