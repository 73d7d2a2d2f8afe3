"""Publication of the times until which ghosts are harmless and away, which the goal selector alone knows."""

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Float64MultiArray

from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.ros import topics
from pacman_env.ros.node import GameNode


class GhostTimes:
    """Publisher of the times of a node's ghosts; it publishes each change once."""

    def __init__(self, node: GameNode) -> None:
        self._node, self._ghosts = node, len(node.config.clyde.ghosts)
        self._out = topics.HARMLESS_GHOSTS.publisher(node)
        self._published: list[float] = []

    def publish(self, ghosts: NDArray[np.float64]) -> None:
        """Publish the times in the rows of ``Board.ghosts`` if they have changed."""
        times = ghosts[: self._ghosts, HARMLESS_UNTIL:].ravel().tolist()
        if times != self._published:
            self._published = times
            self._out.publish(Float64MultiArray(data=times))

    def destroy(self) -> None:
        self._node.destroy_publisher(self._out)
