"""Node ``pacman_game``: a whole game in one process, with the nodes of lights, sounds and motions.

``robot_game.py`` plays; this module has the parameters, services and timers, the operator's stop and the saved game. A
game that was killed starts again with every point, and stays stopped if it was stopped.
"""

import os
import secrets
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from pacman_env.config import MAX_SPEED_MPS
from pacman_env.game.ghosts import POLICY
from pacman_env.game.round import Action
from pacman_env.policies.registry import behaviours_of
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.discovery import domain_of
from pacman_env.ros.game_nodes import ORIGINAL, OURS, SELECTORS
from pacman_env.ros.heartbeat import HEART, LONG_S, watcher_address
from pacman_env.ros.message_conversion import number_of
from pacman_env.ros.node import parameter
from pacman_env.ros.nodes.audio_node import AudioNode
from pacman_env.ros.nodes.game_event_mapper import GameEventMapper
from pacman_env.ros.nodes.game_light_node import GameLightNode
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.pacman_game.ghosts import GameGhosts
from pacman_env.ros.pacman_game.robot_game import RobotGame
from pacman_env.ros.pacman_game.state_file import StateFile
from pacman_env.ros.process import run
from pacman_env.ros.selector.asked_policy import AskedPolicy
from pacman_env.ros.selector.diagnostics import Diagnostics, selector_condition
from pacman_env.ros.selector.goal_selector import GoalSelector, Report, declare_home
from pacman_env.ros.selector.navigation_client import LOST_GOALS_S
from pacman_env.ros.selector.policy_child import Answer
from pacman_env.ros.selector.policy_process import PolicyProcess, fork_spare
from pacman_env.ros.selector.pose_topics import declare_limits

NAME = "pacman_game"
_TICK_S = 0.05  # of the referee
_REPEAT_S = 1.0  # between repetitions of the pellets' markers, as in the original, and of the saved game
_STARTED = "a round begins: the robot drives home first"
_RESET = "the game is reset: it is in the menu"


class PacmanGame(ConfiguredNode):
    """The node; ``ask`` makes the process of the policies."""

    def __init__(self, ask: Callable[..., PolicyProcess] = PolicyProcess, **options: Any) -> None:
        super().__init__(NAME, with_map=True, **options)
        self._selects = parameter(self, "selector", OURS, f"who sends goals: one of {', '.join(SELECTORS)}")
        if self._selects not in SELECTORS:
            raise ValueError(f"parameter selector = {self._selects!r}: must be one of {', '.join(SELECTORS)}")
        seed = parameter(self, "seed", -1, "random seed of the ghosts; -1: a new one at each start", -1, 2**31 - 1)
        home, limits = declare_home(self), declare_limits(self)
        text = "largest age of a saved game that is resumed, s"
        max_age_s = parameter(self, "state_file_max_age_s", 60.0, text, 0.0, 86400.0)
        self._file = StateFile.of_node(self, "file of the saved game, to resume after a crash", max_age_s)
        behaviours, ours = behaviours_of(self.config.clyde.ghosts), self._selects == OURS
        self._policy: AskedPolicy | None = None  # of the robot, and of ghosts
        if ours or POLICY in behaviours:
            self._policy = AskedPolicy(self, ask, self._on_answer, lambda: self.game.referee.state, ours)
        config = self.config.with_fields(**{"clyde.ghosts": behaviours})
        self.ghosts = GameGhosts(self, config, secrets.randbelow(2**31) if seed < 0 else seed, self._policy)
        select: Callable[[Report], GoalSelector] | None = None
        if self._policy is not None and ours:
            select = partial(GoalSelector, self, config, self._policy, home=home, limits=limits)
        self.game = RobotGame(self, config, self.ghosts, select, self._save)
        self._saved = self._load()  # a game to resume at the first tick, when the clock runs
        self._operator = OperatorStop(self, self._on_stop)
        if self._saved is not None and self._saved.get("stopped"):
            self._operator.request(True, str(self._saved["stopped"])[:100], insists=False)
        self.listen(topics.AMCL_POSE, self._on_amcl, "bad robot pose")
        self.listen(topics.CLICKED_POINT, self.ghosts.on_click, "bad click")
        self.listen(topics.BASE_CLYDE_SPEED, self._on_speed, "bad speed")
        topics.START_GAME.server(self, partial(self._serve, self._start, _STARTED))
        topics.RESET_GAME.server(self, partial(self._serve, self._reset, _RESET))
        self._diagnostics = Diagnostics(self, self._condition)
        if self._policy is not None:
            self._policy.process.wait()
        self.create_timer(_TICK_S, self._tick)
        self.create_timer(config.clyde.update_period_s, self.game.move_ghosts)
        self.create_timer(_REPEAT_S, self._repeat)
        self._add_selector()
        self.game.show_pellets()
        if self._saved is None:
            self.game.perform(self.game.referee.announce())
        self.get_logger().info(f"{self.game.referee.spawned} pellets on {self.map.name}, seed {seed}")

    def _add_selector(self) -> None:
        selector = self.game.selector
        if selector is not None:
            topics.CONTINUE.server(self, selector.on_continue)
            selector.activate(True)
            self.create_timer(self.config.execution.tick_s, partial(self.game.decide, selector))
            self.create_timer(LOST_GOALS_S, selector.nav2.end_without_results)

    # The saved game

    def _load(self) -> Any:
        try:
            saved = self._file.load()
            return saved if isinstance(saved, dict) else None
        except (ValueError, OSError) as error:
            self.get_logger().warning(f"{self._file.path} is left alone: {error}; nothing is saved")
            self._file.path = None
            return None

    def _save(self) -> None:
        """Save the game; remove the file if the game is in the menu without a result and not stopped."""
        who = self._operator.who if self._operator.stopped else ""
        referee = self.game.referee
        try:
            if self._saved is not None:
                self._file.save({**self._saved, "stopped": who})
            elif not who and referee.state == "menu" and not referee.result:
                self._file.remove()
            else:
                self._file.save({"stopped": who, **self.game.snapshot()})
        except OSError as error:
            self.once.warning("no state file", f"{self._file.path}: {error.strerror}: a game is lost with this node")

    def _resume(self) -> None:
        """Continue the saved game, or begin another one if it does not fit."""
        try:
            self.game.restore(self._saved)  # until it is complete, the file keeps the saved game
        except (ValueError, TypeError, LookupError) as error:
            self.get_logger().warning(f"{self._file.path}: the saved game is given up: {error}")
            self._saved = None
            self.game.perform(self.game.referee.reset(self.now_s()))
            return
        self._saved = None
        self._save()
        referee = self.game.referee
        self.get_logger().info(f"resumes in state {referee.state!r}, score {referee.score}")

    # Requests

    def _on_stop(self, stopped: bool, who: str) -> None:
        self.game.stop(stopped, who)
        self._save()  # before other nodes learn that this one obeys

    def _start(self) -> list[Action]:
        if self._saved is not None:
            return [Action("ignored", "start: a saved game is about to be resumed")]
        if self.game.referee.state == "menu" and (reason := self._missing()):
            # Otherwise the robot would move as soon as it can, at a time that no person has chosen.
            return [Action("ignored", f"start: {reason}")]
        return self.game.referee.start(self.now_s())

    def _missing(self) -> str:
        """Return the reason why no round can begin, or ""."""
        if self.game.selector is not None:
            return self.game.selector.missing
        publishers = self.count_publishers(self.resolve_topic_name(topics.GAME_STATUS.name))
        is_missing = self._selects == ORIGINAL and not publishers
        return "no goal selector yet: nothing publishes game_status" if is_missing else ""

    def _reset(self) -> list[Action]:
        self._saved = None
        return self.game.referee.reset(self.now_s())

    def _serve(self, act: Callable[[], list[Action]], done: str, request: Any, response: Any) -> Any:
        actions = act()
        refused = [str(action.value) for action in actions if action.kind == "ignored"]
        self.game.perform(actions)
        response.success = not refused
        response.message = refused[0] if refused else done
        return response

    def _on_amcl(self, message: Any) -> None:
        self.ghosts.on_robot(message)
        if self.game.selector is not None:
            self.game.selector.pose.believed.latched(message)

    def _on_speed(self, message: Any) -> None:
        self.game.perform(self.game.referee.base_clyde_speed(number_of(message, 0.0, MAX_SPEED_MPS)))

    # Time

    def _tick(self) -> None:
        if self._saved is not None:
            self._resume()
        self.game.perform(self.game.referee.tick(self.now_s()))

    def _repeat(self) -> None:
        self.game.show_pellets()
        self._save()  # a file without events would soon be too old, and its times wrong

    def _on_answer(self, answer: Answer) -> None:
        if self.game.selector is not None:
            self.game.selector.on_answer(answer)
        self.ghosts.on_answer(answer)

    def _condition(self) -> dict[str, Any]:
        selector, referee = self.game.selector, self.game.referee
        condition = {"selector": self._selects, "stopped": self._operator.stopped, "state": referee.state}
        if selector is not None:
            condition |= selector_condition(selector, self.now_s())
        return condition | {"shadow": False}

    def last_messages(self) -> Iterable[Any]:
        """Stop robot and lights at the end, and remove the saved game; a game that failed is saved instead."""
        if self._policy is not None:
            self._policy.process.close()
        if self.status is None:  # stopped by a signal
            self._file.remove()
            self.game.close()
        else:
            self._save()
        return () if self.game.selector is None else self.game.selector.close()


def main(argv: Sequence[str] | None = None) -> int:
    if argv is None:  # otherwise this process may have threads already
        fork_spare()
    HEART.beat(LONG_S)
    return run((_game, GameEventMapper, GameLightNode, AudioNode), NAME, argv)


def _game() -> PacmanGame:
    game = PacmanGame()
    HEART.send_to(watcher_address(game.get_namespace(), domain_of(os.environ.get("ROS_DOMAIN_ID", ""))))
    return game


if __name__ == "__main__":
    sys.exit(main())
