"""Node ``game_light_node``: shows light words on the Create 3's ring (Algorithm 7).

While nothing is shown, the base controls the ring, so that its own warnings are visible. If an earlier process left
the ring lit, the base gets control back, too.
"""

import sys
from collections.abc import Iterable
from functools import partial
from typing import Any

from irobot_create_msgs.msg import LedColor, LightringLeds
from std_msgs.msg import Header

from pacman_env.game.events import LIGHTS
from pacman_env.game.lights import BLACK, LASTING, LightRing, Ring

from .. import topics
from ..configured_node import ConfiguredNode
from ..message_conversion import word_of
from ..process import run

NAME = "game_light_node"
_PERIOD_S = 0.075  # half of a frame of the light (``FRAME_S``)
_REPEAT_S = 1.0  # between repetitions, for a base that started later
_CLEARINGS = 5  # unlit rings published at the start, one per second, for a base that may not listen yet


class GameLightNode(ConfiguredNode):
    """Node of the light ring; its timer runs only while something is shown."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._lights = LightRing(LIGHTS, self.config.show)
        self._shown: Ring | None = None
        self._shown_s = 0.0
        self._ring = topics.LIGHT_RING.publisher(self)
        self._timer = self.create_timer(_PERIOD_S, self._show)
        self._timer.cancel()
        self._fresh = True  # no state of the game received so far
        self._clearings = _CLEARINGS
        self._clearing_timer = self.create_timer(1.0, self._clear_ring)
        self.listen(topics.GAME_LIGHT, lambda message: self._command(word_of(message, LIGHTS)), "bad light")
        self.listen(topics.GAME_STATE, self._on_state, "bad state")

    def _clear_ring(self) -> None:
        """Switch the ring off: a killed node may have left it lit."""
        self._clearings -= 1
        if self._clearings == 0:
            self._clearing_timer.cancel()
        self._show(again=True)

    def _on_state(self, message: Any) -> None:
        """Continue with the light of the current state after a start in the middle of a game."""
        state = word_of(message, topics.STATE_WORDS)
        if self._fresh and state in LASTING:
            self._command(LASTING[state])
        self._fresh = False

    def _command(self, word: str) -> None:
        self._clearing_timer.cancel()
        self._lights.command(word, self.now_s())
        self._timer.reset()
        self._show(again=True)

    def _show(self, again: bool = False) -> None:
        now = self.now_s()
        ring = self._lights.ring(now)
        if again or ring != self._shown or not 0 <= now - self._shown_s < _REPEAT_S:
            self._publish(ring)
            self._shown, self._shown_s = ring, now
        if ring is None:
            self._timer.cancel()

    def _publish(self, ring: Ring | None) -> None:
        leds = [LedColor(red=red, green=green, blue=blue) for red, green, blue in ring or (BLACK,) * 6]
        header = Header(stamp=self.get_clock().now().to_msg())
        self._ring.publish(LightringLeds(header=header, leds=leds, override_system=ring is not None))

    def last_messages(self) -> Iterable[Any]:
        self._publish(None)
        return ()


main = partial(run, GameLightNode, NAME)

if __name__ == "__main__":
    sys.exit(main())
