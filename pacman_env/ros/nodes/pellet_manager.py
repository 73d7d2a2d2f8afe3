"""Node ``pellet_manager``: shows the remaining pellets on the map, removes and restores them."""

import sys
from functools import partial
from typing import Any

from pacman_env.game.pellets import generate_pellets

from .. import topics
from ..message_conversion import markers_of
from ..node import GameNode, run

NAME = "pellet_manager"
_PERIOD_S = 1.0  # as in the original


class PelletManager(GameNode):
    def __init__(self) -> None:
        super().__init__(NAME, with_map=True)
        map, config = self.map, self.config.pellets
        pellets = generate_pellets(map, config)
        self._all = {int(i): (float(x), float(y)) for i, (x, y) in zip(pellets.ids, pellets.position, strict=True)}
        if not self._all:
            self.get_logger().warning(f"{map.name}: no room for a pellet, {config.spacing_m} m apart")
        self._power: set[int] = set()
        if self.config.power.pellets > 0:
            from pacman_env.levels.assets import map_assets  # needs memory, so other games do not import it

            assets = map_assets(map, self.config)  # only pellets that the robot can reach
            power = assets.power_pellets(self.config.power.pellets)[: assets.pellets]
            self._power = set(assets.pellet_ids[power].tolist())
        self._left = dict(self._all)
        self._markers = topics.PELLET_MARKERS.publisher(self)
        topics.REMOVE_PELLET.subscription(self, self._remove)
        topics.RESET_PELLETS.server(self, self._reset)
        self.create_timer(_PERIOD_S, self._show)
        self.get_logger().info(f"{len(self._all)} pellets on {map.name}")

    def _show(self) -> None:
        self._markers.publish(markers_of(self._left, self.get_clock().now().to_msg(), power=self._power))

    def _remove(self, message: Any) -> None:
        if self._left.pop(message.data, None) is not None:
            self._show()
        elif message.data not in self._all:
            self.once.warning("foreign pellet", f"pellet {message.data} is not one of this map's {len(self._all)}")

    def _reset(self, request: Any, response: Any) -> Any:
        self._left = dict(self._all)
        self._show()
        response.success, response.message = True, f"{len(self._left)} pellets"
        return response


main = partial(run, PelletManager, NAME)

if __name__ == "__main__":
    sys.exit(main())
