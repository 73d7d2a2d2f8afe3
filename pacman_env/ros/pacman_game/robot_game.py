"""The game of a robot: referee, pellets, ghosts and goal selector, which call each other; topics only show it.

Our goal selector is called and calls back. A foreign one hears the topics and reports on them.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pacman_env.config import Config
from pacman_env.game.pellets import generate_pellets
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.game.round import Action, RoundController
from pacman_env.levels.assets import map_assets
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.message_conversion import ghost_times_message, markers_of, word_of
from pacman_env.ros.pacman_game.ghosts import GameGhosts
from pacman_env.ros.selector.goal_selector import GoalSelector, Report
from pacman_env.ros.selector.navigation_client import NavigationClient

_TOPICS = {
    "command": topics.GAME_COMMAND,
    "event": topics.GAME_EVENT,
    "state": topics.GAME_STATE,
    "result": topics.GAME_RESULT,
    "score": topics.SCORE,
    "round": topics.ROUND,
    "spawned": topics.PELLETS_SPAWNED,
    "collected": topics.PELLETS_COLLECTED,
    "clyde_speed": topics.CLYDE_SPEED,
}
_WITH_POWER = {"ghosts_caught": topics.GHOSTS_CAUGHT}
_REPORTS = {"status": topics.GAME_STATUS, "remove": topics.REMOVE_PELLET}  # of a goal selector


class RobotGame:
    """The game; ``save`` is called after each event, before it is shown.

    ``select`` makes our goal selector; None: a foreign one plays.
    """

    def __init__(
        self,
        node: ConfiguredNode,
        config: Config,
        ghosts: GameGhosts,
        select: Callable[[Report], GoalSelector] | None,
        save: Callable[[], None],
    ) -> None:
        self._node, self.ghosts, self._save = node, ghosts, save
        assets = map_assets(node.map, config)
        pellets = generate_pellets(node.map, config.pellets)
        self._pellets = {int(i): (float(x), float(y)) for i, (x, y) in zip(pellets.ids, pellets.position, strict=True)}
        power = assets.pellet_ids[assets.power_pellets(config.power.pellets)[: assets.pellets]]  # only within reach
        self.referee = RoundController(config.clyde, config.show, config.power)
        self.referee.lay_out(self._pellets, power.tolist())
        published = _TOPICS | (_WITH_POWER if config.power.pellets > 0 else {}) | (_REPORTS if select else {})
        self._out = {kind: topic.publisher(node) for kind, topic in published.items()}
        self._markers = topics.PELLET_MARKERS.publisher(node)
        self._harmless = topics.HARMLESS_GHOSTS.publisher(node) if config.power.pellets > 0 else None
        self.selector = None if select is None else select(self.report)
        self._jump = ""  # as it was saved last
        if self.selector is None:
            node.listen(topics.GAME_STATUS, lambda message: self.report([("status", word_of(message))]), "bad status")
            node.listen(topics.REMOVE_PELLET, lambda message: self.report([("remove", message.data)]), "bad removal")
            self._foreign = NavigationClient(node, lambda *_: None, lambda *_: None, lambda *_: None)  # sends no goal

    def report(self, reports: Sequence[tuple[str, Any]]) -> None:
        """Take reports of the goal selector, which count and are saved together; others hear them, too."""
        actions: list[Action] = []
        for kind, value in reports:
            if self.selector is not None:  # a foreign one has published it
                actions.append(Action(kind, value))
            if kind == "remove":
                actions += self.referee.remove(value)
            elif kind == "status":
                actions += self.referee.status(value, self._node.now_s())
        self.perform(actions)

    def stop(self, stopped: bool, who: str) -> None:
        """Stop the robot until the release, also if another node sends its goals."""
        if self.selector is None:
            self._foreign.forbid(stopped)
        else:
            self.selector.stop(stopped, who)

    # What the referee does

    def perform(self, actions: Sequence[Action]) -> None:
        """Save the game, then perform the referee's actions in order."""
        if any(action.kind != "ignored" for action in actions):
            self._save()
        for action in actions:
            kind, value = action.kind, action.value
            if kind == "ignored":
                self._node.once.warning(f"ignored in state {self.referee.state}", str(value))
            elif kind == "pellets":
                self.show_pellets()
            elif kind == "reset_clyde":
                self.ghosts.respawn()
            else:
                self._publish(kind, value)
                self._tell(kind, value)

    def _publish(self, kind: str, value: Any) -> None:
        self._out[kind].publish(self._out[kind].msg_type(data=value))

    def _tell(self, kind: str, value: Any) -> None:
        """Tell the ghosts and our goal selector what concerns them."""
        if kind == "state":
            self.ghosts.on_state(value)
        elif kind == "clyde_speed":
            self.ghosts.set_speed(value)
        ours = self.selector
        if ours is None:
            return
        if kind == "command":
            ours.on_command(value)
        elif kind == "state":
            ours.on_state(value)
        elif kind == "round":
            ours.executor.round.begin(value)
        elif kind == "clyde_speed":
            ours.on_clyde_speed(value)

    def show_pellets(self) -> None:
        """Show the remaining pellets, on the map and to those who decide."""
        left = {number: place for number, place in self._pellets.items() if number in self.referee.left}
        power = self.referee.power_pellets
        self._markers.publish(markers_of(left, self._node.get_clock().now().to_msg(), power=power))
        if self.selector is not None:
            self.selector.on_pellets(left, power)
        self.ghosts.set_pellets(left, power)

    # Time

    def move_ghosts(self) -> None:
        self.ghosts.update()
        if self.selector is not None:
            self.selector.see_ghosts(self.ghosts.places, self._node.get_clock().now().nanoseconds)

    def decide(self, selector: GoalSelector) -> None:
        """Let our goal selector decide; the ghosts learn until when they are harmless."""
        selector.tick()
        if self._harmless is not None:
            times = selector.executor.round.ghosts[: len(self.ghosts.places), HARMLESS_UNTIL:]
            if (times != self.ghosts.harmless).any():
                self.ghosts.set_harmless(times.copy())
                self._harmless.publish(ghost_times_message(times - self._node.set_back_s))
                self._save()
        if selector.pose.watch.jump != self._jump:  # it may have been noticed between two ticks
            self._jump = selector.pose.watch.jump
            self._save()

    # Crashes

    def snapshot(self) -> dict[str, Any]:
        """Return everything that ``restore`` needs, as JSON values."""
        return {
            "referee": self.referee.snapshot(self._node.now_s()),
            "selector": self.selector.snapshot() if self.selector else {},
            "ghosts": [list(place) for place in self.ghosts.places],
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Resume the game of an earlier process; raises an exception for something else."""
        actions = self.referee.restore(saved["referee"], self._node.now_s())
        self.ghosts.restore(saved["ghosts"])
        self.perform(actions)
        if self.selector is not None:  # after the commands, which start the clock of a round
            self.selector.restore(saved["selector"], self.referee.taken, self.referee.ghosts_caught)
        self.show_pellets()

    def close(self) -> None:
        """End the game: stop the robot, switch lights off, hide the ghosts."""
        for kind, value in (("command", "disable"), ("event", "reset"), ("state", "menu")):
            self._publish(kind, value)
        self.ghosts.hide()
