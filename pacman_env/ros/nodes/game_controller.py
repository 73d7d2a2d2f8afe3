"""Node ``game_controller``: the referee of the game (Algorithm 5).

All that it decides is decided by ``game/round.py``; here its inputs come in as messages and services, and its actions
go out. What an event looks and sounds like is the event mapper's business.

He alone knows how a game stands, so he keeps it in a file: killed and started again, he goes on with it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from platformdirs import user_state_path
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pacman_env.config import MAX_SPEED_MPS, ClydeConfig
from pacman_env.game.execution import round_complete
from pacman_env.game.round import Action, RoundController

from .. import topics
from ..messages import number_of, pellets_of, word_of
from ..node import GameNode, parameter, run
from .state_file import Memory

NAME = "game_controller"
_TICK_S = 0.05
_KEEP_S = 1.0  # of wall time: what is remembered is never older
_PUBLISHED = {
    "command": topics.GAME_COMMAND,
    "event": topics.GAME_EVENT,
    "state": topics.GAME_STATE,
    "result": topics.GAME_RESULT,
    "score": topics.SCORE,
    "round": topics.ROUND,
    "spawned": topics.PELLETS_SPAWNED,
    "collected": topics.PELLETS_COLLECTED,
    "clyde_speed": topics.CLYDE_SPEED,
    "remove": topics.REMOVE_PELLET,
}
_CALLED = {"reset_pellets": topics.RESET_PELLETS, "reset_clyde": topics.RESET_CLYDE}


class GameController(GameNode):
    """The state machine of a game, with a clock and a voice."""

    def __init__(self) -> None:
        super().__init__(NAME)
        clyde = ClydeConfig()
        self.game = RoundController(
            clyde=ClydeConfig(
                speed_mps=parameter(self, "clyde_speed_mps", clyde.speed_mps, "in round 1, m/s", 0.0, MAX_SPEED_MPS),
                speed_step_mps=parameter(
                    self, "clyde_speed_step_mps", clyde.speed_step_mps, "faster in each round, m/s", 0.0, MAX_SPEED_MPS
                ),
            ),
            start_show_s=parameter(self, "start_show_s", RoundController.start_show_s, "before a round, s", 0.0, 60.0),
            death_show_s=parameter(self, "death_show_s", RoundController.death_show_s, "after a death, s", 0.0, 60.0),
            home_retries=parameter(
                self, "home_retries", RoundController.home_retries, "more tries to get home", 0, 1000
            ),
            home_retry_s=parameter(
                self, "home_retry_s", RoundController.home_retry_s, "between two of them, s", 0.0, 600.0
            ),
        )
        round_complete(0, 0)  # compiled now, not while a pellet waits for its answer
        self._voices = {kind: topic.publisher(self) for kind, topic in _PUBLISHED.items()}
        self._resets = {kind: service.client(self) for kind, service in _CALLED.items()}
        self._due: set[str] = set()  # services to call as soon as they are there
        self._memory = self._open_memory()
        self._remembered = self._recall()  # a game to go on with, at the first tick: then there is a clock
        self.listen(topics.GAME_STATUS, self._hear_status, "bad status")
        self.listen(topics.PELLET_MARKERS, self._hear_pellets, "bad pellets")
        self.listen(topics.BASE_CLYDE_SPEED, self._hear_speed, "bad speed")
        topics.START_GAME.server(self, lambda request, response: self._answer(self.game.start(self.now_s()), response))
        topics.RESET_GAME.server(self, lambda request, response: self._answer(self.game.reset(self.now_s()), response))
        self.create_timer(_TICK_S, self._tick)
        self.create_timer(_KEEP_S, self._keep, clock=Clock(clock_type=ClockType.STEADY_TIME))
        if self._remembered is None:
            self._do(self.game.announce())

    def _open_memory(self) -> Memory:
        text = "file that a game is kept in, to go on with after a crash; auto: in the user's state folder; empty: none"
        where = parameter(self, "memory", "auto", text)
        lasts_s = parameter(self, "memory_s", 60.0, "after this time a game is not gone on with, s", 0.0, 86400.0)
        domain = os.environ.get("ROS_DOMAIN_ID") or "0"
        namespace = self.get_namespace()
        name = f"{namespace.strip('/').replace('/', '-') or 'root'}-{domain}.json"
        path = user_state_path("pacman_env") / name if where == "auto" else Path(where) if where else None
        simulated = bool(self.get_parameter("use_sim_time").value)
        return Memory(path, lasts_s, {"namespace": namespace, "domain": domain, "simulated": simulated})

    def _recall(self) -> Any:
        """The game to go on with, None: none."""
        try:
            remembered = self._memory.recall()
            if remembered is not None:
                RoundController().restore(remembered, 0.0)
        except (ValueError, TypeError, OSError) as error:
            self.get_logger().warning(f"{self._memory.path} is left alone: {error}; nothing is remembered")
            self._memory.path = None
            return None
        return remembered

    def _keep(self) -> None:
        """Remember the game as it is now; in the menu there is none."""
        if self._remembered is not None:
            return
        if self.game.state == "menu":
            self._memory.forget()
            return
        try:
            self._memory.keep(self.game.snapshot(self.now_s()))
        except OSError as error:
            self.once.warning("no memory", f"{self._memory.path}: {error.strerror}: a game is lost with this node")

    def _do(self, actions: Sequence[Action]) -> None:
        """Carry out actions in their order; calls that cannot be made yet are made by the timer."""
        if any(action.kind != "ignored" for action in actions):
            self._keep()  # first: what was said and not remembered would be said again
        for action in actions:
            if action.kind == "ignored":
                self.once.warning(f"ignored in state {self.game.state}", str(action.value))
            elif action.kind in _CALLED:
                self._due.add(action.kind)
            else:
                self._voices[action.kind].publish(_PUBLISHED[action.kind].type(data=action.value))
        self._call_services()

    def _call_services(self) -> None:
        for kind in sorted(self._due):
            client = self._resets[kind]
            if self.game.state == "running":  # too late: the round is on
                self.once.warning(kind, f"{_CALLED[kind].name}: nobody there, the round goes on without")
            elif client.service_is_ready():
                answer = client.call_async(_CALLED[kind].type.Request())
                answer.add_done_callback(lambda answer, kind=kind: self._hear_answer(answer, kind))
            else:
                continue
            self._due.discard(kind)

    def _hear_answer(self, answer: Any, kind: str) -> None:
        problem = answer.exception() or (None if answer.result().success else answer.result().message)
        if problem is not None:
            self.once.warning(f"{kind} failed", f"{_CALLED[kind].name}: {problem}")

    def _answer(self, actions: Sequence[Action], response: Any) -> Any:
        """Carry out what a service caused, and say how it went."""
        refused = [str(action.value) for action in actions if action.kind == "ignored"]
        self._do(actions)
        response.success = not refused
        response.message = refused[0] if refused else f"the game is in state {self.game.state!r}"
        return response

    def _tick(self) -> None:
        if self._remembered is not None:
            remembered, self._remembered = self._remembered, None
            self._do(self.game.restore(remembered, self.now_s()))
            self.get_logger().info(f"goes on in state {self.game.state!r}, score {self.game.score}")
        self._do(self.game.tick(self.now_s()))

    def _hear_status(self, message: Any) -> None:
        self._do(self.game.status(word_of(message), self.now_s()))

    def _hear_pellets(self, message: Any) -> None:
        self._do(self.game.pellets_left(pellets_of(message)))

    def _hear_speed(self, message: Any) -> None:
        self._do(self.game.base_clyde_speed(number_of(message, 0.0, MAX_SPEED_MPS)))

    def farewell(self) -> Iterable[Any]:
        """Without a referee nobody drives, shakes or shines."""
        self._do([Action("command", "disable"), Action("event", "reset"), Action("state", "menu")])
        self._memory.forget()
        return ()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node; the exit status."""
    return run(GameController, NAME, argv)


if __name__ == "__main__":
    sys.exit(main())
