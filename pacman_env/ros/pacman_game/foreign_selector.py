"""A foreign goal selector, such as the original's: it hears the game's topics, and reports on its own."""

from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.message_conversion import word_of
from pacman_env.ros.selector.goal_selector import GameSide


class ForeignSelector:
    """Passes the reports of a foreign selector to the game; what the game says is published anyway."""

    def __init__(self, node: ConfiguredNode, game: GameSide, needed: bool) -> None:
        self._node, self._needed = node, needed
        node.listen(topics.GAME_STATUS, lambda message: game.status(word_of(message)), "bad status")
        node.listen(topics.REMOVE_PELLET, lambda message: game.remove(int(message.data)), "bad removal")

    @property
    def missing(self) -> str:
        """Return the reason why no round can begin, or ""."""
        if not self._needed:
            return ""
        there = self._node.count_publishers(self._node.resolve_topic_name(topics.GAME_STATUS.name))
        return "" if there else "no goal selector yet: nothing publishes game_status"

    def on_state(self, word: str) -> None: ...

    def on_command(self, word: str) -> None: ...

    def on_round(self, number: int) -> None: ...

    def on_clyde_speed(self, mps: float) -> None: ...

    def on_pellets(self, left: Any, power: Any) -> None: ...

    def see_ghosts(self, places: Any, stamp_ns: int) -> None: ...

    def stop(self, stopped: bool, who: str) -> None: ...

    def snapshot(self) -> dict[str, Any]:
        return {}

    def restore(self, saved: Any, collected: Any, caught: int) -> None: ...

    def close(self) -> tuple[Any, ...]:
        return ()
