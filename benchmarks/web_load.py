"""What the operator's page costs: ``python -m benchmarks.web_load``.

The simulator plays round after round behind the page's server, first without viewers, then with many of them in another
process, at 20 frames a second, one of them reading nothing. Measured are the server's time on the processor, the
process's memory, how old the frames are when the viewers have them, and how long the game's ticks are.
"""

import argparse
import asyncio
import contextlib
import multiprocessing
import os
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from multiprocessing.synchronize import Event
from typing import Any
from unittest import mock

import numpy as np
import psutil

from benchmarks.harness import benchmark, count, log

#: Promised of the server, of a core, and of frames, ms.
SERVER_PERCENT, LATENCY_MS = 30.0, 150.0
PATIENCE_S = 300.0  # the first round compiles
WARM_S = 3.0  # before anything counts
GAME_THREAD = "game"
MOST_FRAMES = 1 << 20
FRAME = re.compile(r'\{"kind":"frame",.*?"number":(\d+)')


def measure(viewers: int, seconds: float, alone_s: float, game_map: str) -> dict[str, Any]:
    """All figures, of the game for ``alone_s`` without viewers and for ``seconds`` with them."""
    from pacman_env.web.played_round import PlayedRound
    from pacman_env.web.rules import Rules
    from pacman_env.web.server import Limits, WebServer
    from pacman_env.web.simulated import SimulatedGame

    made_s = np.full(MOST_FRAMES, np.nan)  # by number; of one size, as memory is measured
    steps_ms: list[float] = []
    step = PlayedRound.step

    def timed_step(played: PlayedRound, *arguments: Any, **options: Any) -> Any:
        began = time.perf_counter()
        try:
            return step(played, *arguments, **options)
        finally:
            steps_ms.append(1e3 * (time.perf_counter() - began))

    class WatchedGame(SimulatedGame):
        last = -1

        def frame(self) -> Any:
            made = super().frame()
            if made is not None and made.number != self.last:
                self.last, made_s[made.number % MOST_FRAMES] = made.number, time.monotonic()
            return made

    with (
        mock.patch.object(PlayedRound, "step", timed_step),
        contextlib.closing(WatchedGame(Rules(map=game_map, policy="ppo"), seed=1)) as game,
        WebServer(game, limits=Limits(viewers=viewers)) as server,
        _played(game),
    ):
        log(f"the game alone, for {alone_s:g} s")
        time.sleep(WARM_S)
        alone = _during(alone_s, steps_ms)
        log(f"with {viewers} viewers, for {seconds:g} s")
        context = multiprocessing.get_context("spawn")
        connected, ended, received = context.Event(), context.Event(), context.SimpleQueue()
        process = context.Process(target=_watch, args=(server.port, viewers, connected, ended, received), daemon=True)
        process.start()
        try:
            if not connected.wait(60.0):
                raise ValueError("the viewers cannot connect")
            time.sleep(WARM_S)
            began_s = time.monotonic()
            watched = _during(seconds, steps_ms)
            ended_s = time.monotonic()
            ended.set()
            frames = received.get()
        finally:
            process.kill()
            process.join()
    ages_ms = [1e3 * (at_s - made_s[number % MOST_FRAMES]) for number, at_s in frames if began_s <= at_s <= ended_s]
    if not ages_ms:
        raise ValueError("the viewers received no frame")
    return {
        "viewers": viewers,
        "seconds": seconds,
        "frames_per_s": len(ages_ms) / (viewers - 1) / seconds,
        "server_percent": watched["others_percent"],
        "game_percent": {"without": alone["game_percent"], "with": watched["game_percent"]},
        "memory_mb": {"without": alone["memory_mb"], "with": watched["memory_mb"]},
        "latency_ms": _spread(ages_ms),
        "tick_ms": {"without": alone["tick_ms"], "with": watched["tick_ms"]},
    }


@contextlib.contextmanager
def _played(game: Any) -> Iterator[None]:
    """Round after round, Start pressed each time; the first runs."""
    from pacman_env.web.messages import Start

    done, runs = threading.Event(), threading.Event()

    def press() -> None:
        while not done.wait(0.25):
            frame = game.frame()
            if frame is not None and frame.state == "menu":
                game.handle("benchmark", Start())
            elif frame is not None and frame.state == "running":
                runs.set()

    presser = threading.Thread(target=press, name=f"{GAME_THREAD}-start")
    presser.start()
    try:
        if not runs.wait(PATIENCE_S):
            raise ValueError(f"no round in {PATIENCE_S:g} s: {game.news(0)[-1:]}")
        yield
    finally:
        done.set()
        presser.join()


def _during(seconds: float, steps_ms: list[float]) -> dict[str, Any]:
    """Time on the processor, in percent of a core, and the ticks, of a while."""
    process = psutil.Process()
    memory = process.memory_info().rss / 1e6
    before, began_s, first = _thread_times(), time.monotonic(), len(steps_ms)
    time.sleep(seconds)
    lasted_s = time.monotonic() - began_s
    spent = {name: after - before.get(name, 0.0) for name, after in _thread_times().items()}
    game_s = sum(s for (_, name), s in spent.items() if name.startswith(GAME_THREAD))
    return {
        "game_percent": 100.0 * game_s / lasted_s,
        "others_percent": 100.0 * (sum(spent.values()) - game_s) / lasted_s,
        "tick_ms": _spread(steps_ms[first:]),
        "memory_mb": {"begin": memory, "end": process.memory_info().rss / 1e6},
    }


def _thread_times() -> dict[tuple[int, str], float]:
    """Seconds on the processor by thread; those without a name here are the game's libraries'."""
    names = {thread.native_id: thread.name for thread in threading.enumerate()}
    return {
        (thread.id, names.get(thread.id, GAME_THREAD)): thread.user_time + thread.system_time
        for thread in psutil.Process().threads()
    }


def _spread(values: Sequence[float]) -> dict[str, float]:
    p50, p99, longest = np.percentile(values, [50, 99, 100]).tolist() if values else [float("nan")] * 3
    return {"p50": p50, "p99": p99, "longest": longest}


# The viewers, in a process of their own


def _watch(port: int, viewers: int, connected: Event, ended: Event, received: Any) -> None:
    threading.Thread(target=_read_nothing, args=(port,), daemon=True).start()
    received.put(asyncio.run(_watch_together(port, viewers - 1, connected, ended)))


async def _watch_together(port: int, viewers: int, connected: Event, ended: Event) -> list[tuple[int, float]]:
    """Number and time of the frames that all of them receive."""
    from websockets.asyncio.client import ClientConnection, connect

    frames: list[tuple[int, float]] = []

    async def watch(connection: ClientConnection) -> None:
        while True:
            if number := FRAME.match(await connection.recv(decode=True)):
                frames.append((int(number[1]), time.monotonic()))

    async with contextlib.AsyncExitStack() as stack:
        tasks = []
        for _ in range(viewers):
            client = connect(f"ws://127.0.0.1:{port}/ws", compression=None, max_size=None, max_queue=None)
            tasks.append(asyncio.create_task(watch(await stack.enter_async_context(client))))
        connected.set()
        await asyncio.to_thread(ended.wait)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return frames


def _read_nothing(port: int) -> None:
    """Connects, reads nothing, and connects again when the server has closed the connection."""
    lines = ("GET /ws HTTP/1.1", f"host: 127.0.0.1:{port}", "upgrade: websocket", "connection: upgrade")
    request = "\r\n".join((*lines, "sec-websocket-version: 13", f"sec-websocket-key: {'A' * 22}==", "", ""))
    with contextlib.suppress(ConnectionRefusedError):
        while True:
            with socket.socket() as connection:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                connection.connect(("127.0.0.1", port))
                connection.sendall(request.encode())
                with contextlib.suppress(OSError):
                    while True:
                        time.sleep(0.5)
                        # A pong without a ping: fails once the connection is closed.
                        connection.sendall(b"\x8a\x80" + os.urandom(4))


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    viewers, seconds = (4, 2) if arguments.quick else (arguments.viewers, arguments.seconds)
    figures = measure(viewers, seconds, max(1.0, min(30.0, seconds / 2)), arguments.map)
    ages, tick, game = figures["latency_ms"], figures["tick_ms"], figures["game_percent"]
    memory, alone = figures["memory_mb"]["with"], figures["memory_mb"]["without"]
    print(f"{viewers} viewers, one of them reading nothing, for {seconds:g} s: ", end="")
    print(f"{figures['frames_per_s']:.1f} frames a second each")
    print(f"server: {figures['server_percent']:.1f} % of a core (promised: below {SERVER_PERCENT:g}); ", end="")
    print(f"the game beside it: {game['with']:.1f} %, without viewers {game['without']:.1f} %")
    print(f"memory of both: {memory['begin']:.1f} MB at the beginning, {memory['end']:.1f} MB at the end; ", end="")
    print(f"without viewers {alone['begin']:.1f} and {alone['end']:.1f} MB")
    print(f"from a frame to its viewers: median {ages['p50']:.1f} ms, 99 % within {ages['p99']:.1f} ms ", end="")
    print(f"(promised: {LATENCY_MS:g}), longest {ages['longest']:.1f} ms")
    print("a tick of the game: median {p50:.2f} ms, 99 % within {p99:.2f} ms; ".format(**tick["with"]), end="")
    print("without viewers {p50:.2f} and {p99:.2f} ms".format(**tick["without"]))
    return figures


OPTIONS = (
    count("--viewers", 50, "at once (%(default)s)", least=2),
    count("--seconds", 600, "they watch (%(default)s)"),
    ("--quick", {"action": "store_true", "help": "a few viewers for a few seconds: does it work at all?"}),
)
main = benchmark("web_load", __doc__, run, *OPTIONS, extra="web")

if __name__ == "__main__":
    sys.exit(main())
