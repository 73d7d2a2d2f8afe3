"""Node ``game_controller``: the referee of the game (Algorithm 5).

``game/round.py`` makes all decisions; this node passes it messages and service calls and performs its actions. Only the
referee knows the state of the game. It saves the state in a file and continues the game after a restart.
"""

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from pacman_env.config import MAX_SPEED_MPS
from pacman_env.game.pending_requests import Removals, Requests
from pacman_env.game.round import Action, RoundController, awaits_pellets

from .. import topics
from ..message_conversion import number_of, pellets_of, power_pellets_of, word_of
from ..node import GameNode, parameter, run
from ..operator_stop import OperatorStop
from ..standstill import STOOD_STILL
from .state_file import StateFile

NAME = "game_controller"
_TICK_S = 0.05
_PELLETS_S = 6.0  # wall time; a longer wait for a round's first pellet is reported
_EARLY = 10_000  # most stored reports before the first tick
_SAVE_S = 1.0  # wall time between two saves
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
_WITH_POWER = {"ghosts_caught": topics.GHOSTS_CAUGHT}
_STARTED = "a round begins: the robot drives home first"
_SERVED_BY = {"reset_pellets": "pellet_manager", "reset_clyde": "clyde_ghost_node"}
_CALLED = {"reset_pellets": topics.RESET_PELLETS, "reset_clyde": topics.RESET_CLYDE}


class GameController(GameNode):
    def __init__(self) -> None:
        super().__init__(NAME)
        self.game = RoundController(self.config.clyde, self.config.show, self.config.power)
        self._operator = OperatorStop(self)  # before the round's state: a restarting planner gets a stop first
        published = _PUBLISHED | (_WITH_POWER if self.config.power.pellets > 0 else {})
        self._out = {kind: topic.publisher(self) for kind, topic in published.items()}
        self._resets = {kind: service.client(self) for kind, service in _CALLED.items()}
        self._requests, self._removals = Requests(), Removals()  # timed by wall time
        self._waits_s: float | None = None  # start of a round's wait for its pellets, wall time
        self._unresponsive_out = topics.UNRESPONSIVE.publisher(self)
        self._publish_unresponsive({})  # an earlier referee may have published some
        self._met: set[str] = set()  # services that were available at least once
        text = "largest age of a saved game that is resumed, s"
        max_age_s = parameter(self, "state_file_max_age_s", 60.0, text, 0.0, 86400.0)
        self._file = StateFile.of_node(self, "file of the saved game, to resume after a crash", max_age_s)
        self._saved = self._load()  # a game to resume at the first tick, when the clock runs
        self._early: dict[str, None] = {}  # pellets reported before the first tick, in order
        self.listen(topics.GAME_STATUS, self._on_status, "bad status")
        self.listen(topics.PELLET_MARKERS, self._on_pellets, "bad pellets")
        self.listen(topics.BASE_CLYDE_SPEED, self._on_speed, "bad speed")
        topics.START_GAME.server(self, partial(self._serve, self._start, _STARTED))
        topics.RESET_GAME.server(self, partial(self._serve, self._reset, "the game is reset: it is in the menu"))
        self.create_timer(_TICK_S, self._tick)
        self.create_timer(_SAVE_S, self._save, clock=self.surroundings.clock())
        if self._saved is None:
            self._do(self.game.announce())

    def _load(self) -> Any:
        try:
            content = self._file.load()
            if content is not None:
                RoundController().restore(content, 0.0)
        except (ValueError, TypeError, OSError) as error:
            self.get_logger().warning(f"{self._file.path} is left alone: {error}; nothing is saved")
            self._file.path = None
            return None
        return content

    def _save(self) -> None:
        """Save the current game; remove the file if the game is in the menu before its first round."""
        if self._saved is not None:
            return
        if self.game.state == "menu" and not self.game.score and self.game.round == 1:
            self._file.remove()
            return
        try:
            self._file.save(self.game.snapshot(self.now_s()))
        except OSError as error:
            self.once.warning("no state file", f"{self._file.path}: {error.strerror}: a game is lost with this node")

    def _do(self, actions: Sequence[Action]) -> None:
        """Perform actions in order; the timer makes the service calls that are not possible yet."""
        if any(action.kind != "ignored" for action in actions):
            self._save()  # first: after a restart, unsaved actions would be published again
        for action in actions:
            if action.kind == "ignored":
                self.once.warning(f"ignored in state {self.game.state}", str(action.value))
            elif action.kind in _CALLED:
                self._requests.ask(action.kind, self.surroundings.monotonic())
            else:
                out = self._out[action.kind]
                out.publish(out.msg_type(data=action.value))
        self._call_services()

    def _call_services(self) -> None:
        """Call each service until it answers; a frozen node gets the call later or never."""
        for kind in _CALLED:
            if kind in self._requests and self.game.state == "running" and self.game.collected:
                self.once.warning(kind, f"{self._requests.unanswered(kind)}; the round continues without it")
                self._requests.answered(kind)
        for kind in self._requests.due(
            self.surroundings.monotonic(), lambda kind: self._resets[kind].service_is_ready()
        ):
            self._met.add(kind)
            answer = self._resets[kind].call_async(_CALLED[kind].type.Request())
            answer.add_done_callback(partial(self._on_answer, kind))

    def _on_answer(self, kind: str, answer: Any) -> None:
        self._requests.answered(kind)
        problem = answer.exception() or (None if answer.result().success else answer.result().message)
        if problem is not None:
            self.once.warning(f"{kind} failed", f"{_CALLED[kind].name}: {problem}")

    def _report(self) -> None:
        """Publish and log which nodes do not respond to requests, whenever that changes."""
        now = self.surroundings.monotonic()
        reasons = {_SERVED_BY[kind]: words for kind, words in self._requests.overdue(now).items()}
        self._waits_s = None if not awaits_pellets(self.game, self.now_s()) else self._waits_s or now
        self._removals.shown(frozenset(self.game.pellets.still_shown), now)
        if words := self._removals.overdue(now):
            reasons.setdefault("pellet_manager", words)
        if self._waits_s is not None and now - self._waits_s >= _PELLETS_S:
            what = "it shows no pellet" if self.game.pellets.left is not None else f"no {topics.PELLET_MARKERS.name}"
            reasons.setdefault("pellet_manager", f"{what}, so no round begins")
        if reasons.keys() == self._unresponsive.keys():
            return
        for node in reasons.keys() - self._unresponsive.keys():
            self.once.warning(f"{node} does not respond", f"{node} does not respond: {reasons[node]}")
        for node in self._unresponsive.keys() - reasons.keys():
            self.once.over(f"{node} does not respond")
        self._publish_unresponsive(reasons)

    def _publish_unresponsive(self, reasons: dict[str, str]) -> None:
        self._unresponsive = reasons
        self._unresponsive_out.publish(topics.UNRESPONSIVE.type(data=json.dumps(reasons)))

    def _start(self) -> list[Action]:
        if self._saved is not None:
            return [Action("ignored", "start: a saved game is about to be resumed")]
        if self.game.state == "menu" and not self.count_publishers(topics.GAME_STATUS.name):
            # Otherwise the robot would move as soon as a selector appears, at a time that no person has chosen.
            return [Action("ignored", "start: no goal selector yet; it starts when the robot has a pose")]
        return self.game.start(self.now_s())

    def _reset(self) -> list[Action]:
        self._saved = None
        self._early.clear()
        return self.game.reset(self.now_s())

    def _serve(self, act: Callable[[], list[Action]], done: str, request: Any, response: Any) -> Any:
        actions = act()
        refused = [str(action.value) for action in actions if action.kind == "ignored"]
        self._do(actions)
        response.success = not refused
        response.message = refused[0] if refused else done
        return response

    def _tick(self) -> None:
        if self._saved is not None:
            saved, self._saved = self._saved, None
            self._do(self.game.restore(saved, self.now_s()))
            for word in self._early:
                self._do(self.game.status(word, self.now_s()))
            self.get_logger().info(f"resumes in state {self.game.state!r}, score {self.game.score}")
        self._do(self.game.tick(self.now_s()))
        self._report()

    def _on_status(self, message: Any) -> None:
        word = word_of(message)
        if self._saved is not None:  # all other reports are repeated until they are answered
            if word.startswith(("pellet_collected:", "ghost_caught:")) and len(self._early) < _EARLY:
                self._early[word] = None  # the end of the round may be reported right after the pellet
            return
        if word == "game_complete" and "reset_pellets" in self._requests:
            self.once.warning("no pellets yet", "game_complete: the pellets of this round are not restored yet")
            return
        self._do(self.game.status(word, self.now_s()))

    def _on_pellets(self, message: Any) -> None:
        if self._saved is not None:
            return  # the saved game is not resumed yet; the next report comes within a second
        if "reset_pellets" in self._requests and "reset_pellets" in self._met:
            return  # pellets of the previous round; the pellets of this round are not restored yet
        self._do(self.game.pellets_left(pellets_of(message), self.now_s(), power_pellets_of(message)))

    def _on_speed(self, message: Any) -> None:
        self._do(self.game.base_clyde_speed(number_of(message, 0.0, MAX_SPEED_MPS)))

    def last_messages(self) -> Iterable[Any]:
        """Stop the robot and the lights at the end, and remove the saved game.

        If the process ends because it stood still too long, save the game for the restarted referee instead.
        """
        if self.status == STOOD_STILL:
            self._save()
            return ()
        self._do([Action("command", "disable"), Action("event", "reset"), Action("state", "menu")])
        self._file.remove()
        return ()


main = partial(run, GameController, NAME)

if __name__ == "__main__":
    sys.exit(main())
