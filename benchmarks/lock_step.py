"""Play games of the robot's nodes in lock-step to measure their speed and check that a seed decides them.

One seed is played twice, the second time while other processes keep the cores busy, and another seed once. A hash
covers each message that a node handles, with its simulated time, topic and content.
"""

import argparse
import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.harness import CORES, benchmark, count
from tools.common import table

LIMIT_S = 3600.0  # limit of simulated time for a game


class Game(NamedTuple):
    result: str  # result from the referee
    simulated_s: float
    real_s: float
    core_s: float  # processor time
    messages: int  # messages handled since the start of the first game
    hash: str  # hash of these messages


def play(map_source: str, policy: str, seed: int, games: int) -> list[Game]:
    """Play games in a row with the same nodes; raises RuntimeError if a node fails or a game does not end."""
    from benchmarks.transcript import Transcript
    from pacman_env.ros import topics
    from pacman_env.ros.discovery import stay_on_this_machine
    from pacman_env.ros.game_nodes import REFEREE, GameSetup
    from pacman_env.ros.lock_step.lock_step_game import LockStepGame
    from pacman_env.ros.node import BaseNode

    class Spectator(BaseNode):
        def __init__(self) -> None:
            super().__init__("spectator")
            self.result, self.states = "", [""]
            self.listen(topics.GAME_RESULT, lambda message: setattr(self, "result", message.data), "bad result")
            self.listen(topics.GAME_STATE, lambda message: self.states.append(message.data), "bad state")

    stay_on_this_machine()
    played: list[Game] = []
    with tempfile.TemporaryDirectory() as folder:
        extra: dict[str, Any] = {REFEREE: {"state_file": str(Path(folder) / "game.json")}}
        game = LockStepGame(GameSetup(map_source, policy, sim=True, extra=extra), seed)
        try:
            transcript = Transcript(game)
            spectator = game.join(Spectator)
            for _ in range(games):
                began_s, real_s, core_s = game.wall.now_s, time.perf_counter(), time.process_time()
                answer = game.call(spectator, topics.START_GAME)
                if not answer.success:
                    raise RuntimeError(f"{topics.START_GAME.name}: {answer.message}")
                spectator.states.clear()
                if not game.until(lambda: "menu" in spectator.states, LIMIT_S):
                    raise RuntimeError(f"no end of the game after {LIMIT_S:g} s of simulated time")
                lasted = game.wall.now_s - began_s, time.perf_counter() - real_s, time.process_time() - core_s
                played.append(Game(spectator.result, *lasted, transcript.messages, transcript.hexdigest()))
        finally:
            game.close()
    return played


def show(games: Sequence[Game]) -> None:
    head = ("result", "simulated s", "real s", "times real time", "times time on a core", "messages", "hash")
    rows = []
    for g in games:
        times = [g.simulated_s, g.real_s, g.simulated_s / g.real_s, g.simulated_s / g.core_s]
        rows.append([g.result, *(f"{number:.1f}" for number in times), str(g.messages), g.hash[:12]])
    print(table(head, rows), end="")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Play and print the tables; ``reproducible`` is True if the seed alone decides the games."""
    given = arguments.map, arguments.policy
    show(first := play(*given, arguments.seed, arguments.games))
    print(f"\nthe same seed with {arguments.busy} cores kept busy:")
    with contextlib.ExitStack() as stack:
        for _ in range(arguments.busy):
            process = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            stack.callback(process.kill)  # runs before the context manager waits for the process
        show(busy := play(*given, arguments.seed, arguments.games))
    other = play(*given, arguments.seed + 1, 1)
    same, differs = [g.hash for g in first] == [g.hash for g in busy], other[0].hash != first[0].hash
    print(f"\nthe same seed: {'equal' if same else 'DIFFERENT'}; seed {arguments.seed + 1}: ", end="")
    print("another game" if differs else "THE SAME GAME")
    games = {name: [g._asdict() for g in games] for name, games in (("idle", first), ("busy", busy), ("other", other))}
    return {"policy": arguments.policy, "reproducible": same and differs, **games}


OPTIONS = "--policy", "--seed", count("--games", 10), count("--busy", CORES, "cores, the 2nd time", least=0)
main = benchmark("lock_step", __doc__, run, *OPTIONS, extra="ros", failed=lambda figures: not figures["reproducible"])

if __name__ == "__main__":
    sys.exit(main())
