"""What the operator's page costs: ``python -m benchmarks.web_load``.

The simulator plays round after round behind the page's server, first without viewers, then with many of them in another
process, at 20 frames a second, one of them reading nothing. Measured are the server's time on the processor, the
process's memory, how old the frames are when the viewers have them, and how long the game takes for its ticks.
"""

from __future__ import annotations

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
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing.connection import Connection
from typing import Any
from unittest import mock

import numpy as np
import psutil

from benchmarks.harness import benchmark_parser, run_benchmark
from pacman_env.cli.command import whole_number

#: Promised of the server, of a core, and of frames, ms.
SERVER_PERCENT, LATENCY_MS = 30.0, 150.0
PATIENCE_S = 300.0  # the first round compiles
WARM_S = 3.0  # before anything counts
GAME_THREAD = "game"
MOST_FRAMES = 1 << 20
FRAME = re.compile(r'\{"kind":"frame",.*?"number":(\d+)')


def measure(viewers: int, seconds: float, alone_s: float, game_map: str, say: Callable[[str], None]) -> dict[str, Any]:
    """All figures.

    Args:
        viewers: one of them reads nothing.
        seconds: how long they look.
        alone_s: how long the game plays without them before.
        game_map: a YAML file or the name of a shipped map.
        say: told what is going on.

    Raises:
        ValueError: a map that cannot be played, or viewers that see nothing.
        ModuleNotFoundError: the extra ``web`` is absent.
    """
    from pacman_env.web.played_round import PlayedRound
    from pacman_env.web.rules import Rules
    from pacman_env.web.server import Limits, WebServer
    from pacman_env.web.simulated import SimulatedGame

    made_s = np.full(MOST_FRAMES, np.nan)  # by number; of one size, as memory is looked at
    steps_ms: list[float] = []
    step = PlayedRound.step

    def timed_step(played: PlayedRound, *arguments: Any, **options: Any) -> Any:
        began = time.perf_counter()
        try:
            return step(played, *arguments, **options)
        finally:
            steps_ms.append(1e3 * (time.perf_counter() - began))

    class WatchedGame(SimulatedGame):
        """Remembers when each frame was made."""

        last = -1

        def frame(self) -> Any:
            made = super().frame()
            if made is not None:
                place = made.number % MOST_FRAMES
                if made.number != self.last:
                    self.last, made_s[place] = made.number, time.monotonic()
            return made

    with (
        mock.patch.object(PlayedRound, "step", timed_step),
        contextlib.closing(WatchedGame(Rules(map=game_map, policy="ppo"), seed=1)) as game,
        WebServer(game, limits=Limits(viewers=viewers)) as server,
        _played(game),
    ):
        say(f"the game alone, for {alone_s:g} s")
        time.sleep(WARM_S)
        alone = _during(alone_s, steps_ms)
        say(f"with {viewers} viewers, for {seconds:g} s")
        with _looking(server.port, viewers) as results:
            time.sleep(WARM_S)
            began_s = time.monotonic()
            watched = _during(seconds, steps_ms)
            ended_s = time.monotonic()
            seen = results()
    ages_ms = [1e3 * (at_s - made_s[number % MOST_FRAMES]) for number, at_s in seen if began_s <= at_s <= ended_s]
    if not ages_ms:
        raise ValueError("the viewers saw no frame")
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
    """Round after round, as somebody who presses Start each time; the first runs."""
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
    memory = _memory_mb()
    before, began_s, first = _thread_times(), time.monotonic(), len(steps_ms)
    time.sleep(seconds)
    lasted_s = time.monotonic() - began_s
    spent = {name: after - before.get(name, 0.0) for name, after in _thread_times().items()}
    game_s = sum(s for (_, name), s in spent.items() if name.startswith(GAME_THREAD))
    return {
        "game_percent": 100.0 * game_s / lasted_s,
        "others_percent": 100.0 * (sum(spent.values()) - game_s) / lasted_s,
        "tick_ms": _spread(steps_ms[first:]),
        "memory_mb": {"begin": memory, "end": _memory_mb()},
    }


def _thread_times() -> dict[tuple[int, str], float]:
    """Seconds on the processor by thread; those without a name here are the game's libraries'."""
    names = {thread.native_id: thread.name for thread in threading.enumerate()}
    return {
        (thread.id, names.get(thread.id, GAME_THREAD)): thread.user_time + thread.system_time
        for thread in psutil.Process().threads()
    }


def _memory_mb() -> float:
    return float(psutil.Process().memory_info().rss) / 1e6


def _spread(values: Sequence[float]) -> dict[str, float]:
    if not values:
        return {"p50": float("nan"), "p99": float("nan"), "longest": float("nan")}
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "longest": float(np.max(values)),
    }


# The viewers, in a process of their own


@contextlib.contextmanager
def _looking(port: int, viewers: int) -> Iterator[Callable[[], list[tuple[int, float]]]]:
    """Viewers; the function ends them and returns the frames that they have had: number and time."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_look, args=(port, viewers, theirs), daemon=True)
    process.start()
    try:
        if not ours.poll(60.0) or ours.recv() != "here":
            raise ValueError("the viewers do not come in")

        def results() -> list[tuple[int, float]]:
            ours.send("enough")
            numbers, times = ours.recv()
            return list(zip(numbers.tolist(), times.tolist(), strict=True))

        yield results
    finally:
        process.kill()
        process.join()
        for end in (ours, theirs):
            end.close()


def _look(port: int, viewers: int, pipe: Connection) -> None:
    """All viewers, in this process, until the pipe says that it is enough."""
    numbers: list[int] = []
    times: list[float] = []
    asyncio.run(_look_together(port, viewers, pipe, numbers, times))
    pipe.send((np.array(numbers, np.int64), np.array(times)))


async def _look_together(port: int, viewers: int, pipe: Connection, numbers: list[int], times: list[float]) -> None:
    from websockets.asyncio.client import connect

    here = asyncio.Semaphore(0)

    async def see() -> None:
        async with connect(f"ws://127.0.0.1:{port}/ws", compression=None, max_size=None, max_queue=None) as socket_:
            here.release()
            while True:
                message = await socket_.recv(decode=True)
                if number := FRAME.match(message):
                    numbers.append(int(number[1]))
                    times.append(time.monotonic())

    looking = [asyncio.create_task(see()) for _ in range(viewers - 1)]
    deaf = threading.Thread(target=_read_nothing, args=(port,), daemon=True)
    deaf.start()
    for _ in looking:
        await here.acquire()
    pipe.send("here")
    await asyncio.to_thread(pipe.recv)
    for task in looking:
        task.cancel()
    await asyncio.gather(*looking, return_exceptions=True)


def _read_nothing(port: int) -> None:
    """Comes in, reads nothing, and comes again when it is sent away."""
    lines: tuple[str, ...] = (
        "GET /ws HTTP/1.1",
        f"host: 127.0.0.1:{port}",
        "upgrade: websocket",
        "connection: upgrade",
    )
    lines += ("sec-websocket-version: 13", f"sec-websocket-key: {'A' * 22}==", "", "")
    with contextlib.suppress(ConnectionRefusedError):
        while True:
            with socket.socket() as there:
                there.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                there.connect(("127.0.0.1", port))
                there.sendall("\r\n".join(lines).encode())
                with contextlib.suppress(OSError):
                    while True:
                        time.sleep(0.5)
                        there.sendall(b"\x8a\x80" + os.urandom(4))  # a pong that nobody asked for: fails at the end


def report(figures: dict[str, Any]) -> str:
    """The figures as lines, with what is promised."""
    ages, tick, game = figures["latency_ms"], figures["tick_ms"], figures["game_percent"]
    memory, alone = figures["memory_mb"]["with"], figures["memory_mb"]["without"]
    lines = (
        (
            f"{figures['viewers']} viewers, one of them reading nothing, for {figures['seconds']:g} s:",
            f"{figures['frames_per_s']:.1f} frames a second each",
        ),
        (
            f"server: {figures['server_percent']:.1f} % of a core (promised: below {SERVER_PERCENT:g});",
            f"the game beside it: {game['with']:.1f} %, without viewers {game['without']:.1f} %",
        ),
        (
            f"memory of both: {memory['begin']:.1f} MB at the beginning, {memory['end']:.1f} MB at the end;",
            f"without viewers {alone['begin']:.1f} and {alone['end']:.1f} MB",
        ),
        (
            f"a frame's way to a viewer: median {ages['p50']:.1f} ms, 99 % within {ages['p99']:.1f} ms",
            f"(promised: {LATENCY_MS:g}), longest {ages['longest']:.1f} ms",
        ),
        (
            f"a tick of the game: median {tick['with']['p50']:.2f} ms, 99 % within {tick['with']['p99']:.2f} ms;",
            f"without viewers {tick['without']['p50']:.2f} and {tick['without']['p99']:.2f} ms",
        ),
    )
    return "\n".join(" ".join(words) for words in lines)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    viewers, seconds = (4, 2) if arguments.quick else (arguments.viewers, arguments.seconds)
    alone_s = max(1.0, min(30.0, seconds / 2))
    figures = measure(viewers, seconds, alone_s, arguments.map, partial(print, file=sys.stderr))
    print(report(figures))
    return figures


def main(argv: Sequence[str] | None = None) -> int:
    parser = benchmark_parser("web_load", __doc__)
    parser.add_argument("--viewers", type=whole_number(2), default=50, metavar="N", help="at once (%(default)s)")
    parser.add_argument("--seconds", type=whole_number(1), default=600, metavar="S", help="they look (%(default)s)")
    parser.add_argument("--quick", action="store_true", help="a few viewers for a few seconds: does it work at all?")
    return run_benchmark(parser, argv, run, "web")


if __name__ == "__main__":
    sys.exit(main())
