"""Two robots in one ROS domain, each with a game of its own in its own namespace, in real time."""

import contextlib
import json
import signal
import time
from collections.abc import Callable
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS, SIMULATOR, GameSetup, module_of
from pacman_env.ros.supervisor.status_line import StatusLine
from tests.ros.system import System

PATIENCE_S = 400.0
SETTINGS = ("show.start_s=0.5", "clyde.speed_mps=0.02", "execution.death_radius_m=0.001")  # no round is lost
PELLETS = 2  # of each, before it is compared


class Robot:
    """A robot by the system's clock, its game, and what is published in its namespace."""

    def __init__(self, system: System, namespace: str) -> None:
        extra: dict[str, Any] = {GAME: {"state_file": str(system.folder / f"{namespace}.json")}}
        setup = GameSetup("house", "nearest", namespace, settings=SETTINGS, extra=extra)
        base = [module_of(SIMULATOR), "--ros-args", "-r", f"__ns:=/{namespace}", "-p", "map_yaml:=house"]
        commands = {SIMULATOR: [*base, "-p", f"settings:={json.dumps(SETTINGS)}"]}
        commands[GAME] = setup.command(GAME)
        self.processes = {name: system.fork(f"{namespace}-{name}", *command) for name, command in commands.items()}
        self.line = StatusLine(namespace, sim=False)
        self._start, self._answer = topics.START_GAME.client(self.line), None
        self.collected: set[str] = set()
        self.removed: set[int] = set()
        topics.GAME_STATUS.subscription(self.line, lambda message: self.collected.add(message.data))
        self.commands: list[str] = []
        topics.GAME_COMMAND.subscription(self.line, lambda message: self.commands.append(message.data))
        topics.REMOVE_PELLET.subscription(self.line, lambda message: self.removed.add(message.data))

    def started(self) -> bool:
        """Start the game, again after a refusal; return True if it was accepted."""
        if self._answer is None and self._start.service_is_ready():
            self._answer = self._start.call_async(topics.START_GAME.type.Request())
        if self._answer is None or not self._answer.done():
            return False
        accepted = self._answer.result().success
        self._answer = self._answer if accepted else None
        return accepted

    @property
    def score(self) -> int:
        return int(self.line.facts()["score"] or 0)


def test_two_games_in_one_domain_stay_apart(system: System, domain: int) -> None:
    with contextlib.ExitStack() as closed:
        robots = [Robot(system, name) for name in ("robot_1", "robot_2")]
        for robot in robots:
            closed.enter_context(contextlib.closing(robot.line))

        def wait(condition: Callable[[], object], what: str) -> None:
            end_s = time.monotonic() + PATIENCE_S
            while not condition():
                assert time.monotonic() < end_s, f"{what}: {[robot.line.facts() for robot in robots]}"
                for robot in robots:
                    robot.line.spin(0.02)

        wait(lambda: all(robot.line.ready and robot.line.state == "menu" for robot in robots), "both in the menu")
        first, second = robots
        wait(first.started, "the first one's start")
        wait(lambda: first.line.state == "running" and first.score >= PELLETS, "the first one's pellets")
        assert (second.line.state, second.score, second.collected, second.removed) == ("menu", 0, set(), set())

        wait(second.started, "the second one's start")
        wait(lambda: second.score >= PELLETS, "the second one's pellets")
        for robot in robots:
            wait(lambda robot=robot: robot.score == len(pellets(robot)), "a score of what was collected")
            assert robot.removed <= pellets(robot)
        assert {SIMULATOR, GAME, *LISTENERS} == set(first.line.game.nodes)
        first.commands.clear()
        first.processes[GAME].send(signal.SIGINT)
        wait(lambda: "disable" in first.commands, "the last command of the first one's referee")
        assert first.processes[GAME].wait() == 0
        before = second.score
        wait(lambda: second.score > before, "the second one's game goes on")
        assert GAME in second.line.game.nodes


def pellets(robot: Robot) -> set[int]:
    return {int(word.partition(":")[2]) for word in robot.collected if word.startswith("pellet_collected:")}
