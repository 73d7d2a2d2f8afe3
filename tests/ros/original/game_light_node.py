"""The original's ``game_light_node``: animations loop until the next word, and the ring is never given back."""

from __future__ import annotations

from typing import Any

from irobot_create_msgs.msg import LedColor, LightringLeds
from rclpy.node import Node
from std_msgs.msg import String

from tests.ros.original.common import EVENTS, run

Colour = tuple[int, int, int]
COLOURS: dict[str, Colour] = {
    "yellow": (255, 180, 0),
    "red": (255, 0, 0),
    "blue": (0, 0, 255),
    "pink": (255, 60, 180),
    "orange": (255, 80, 0),
    "white": (255, 255, 255),
}
BLACK: Colour = (0, 0, 0)
OF_GHOSTS = {"clyde": "orange", "blinky": "red", "pinky": "pink", "inky": "blue"}
#: Word to the colours of the frames, 0.15 s each; two and more are shown for ever.
FRAMES: dict[str, tuple[str, ...]] = {
    "start": ("yellow", "red", "pink", "blue", "orange"),
    "pellet": ("white", "yellow"),
    "power pellet": ("yellow", "white"),
    "pacman": ("yellow", "black"),
    "game over": ("red", "black"),
    "win": ("yellow", "white"),
    "off": ("black",),
    **{name: (name,) for name in COLOURS},
    **{f"{ghost} {what}": (colour, "red") for ghost, colour in OF_GHOSTS.items() for what in ("caught", "killed")},
}
PASSING = ("pellet", "power pellet")  # after them it is Pac-Man's again
FRAME_S, PASSING_FRAMES = 0.15, 4


class GameLightNode(Node):
    def __init__(self) -> None:
        super().__init__("game_light_node")
        self.word, self.frame = "off", 0
        self.ring = self.create_publisher(LightringLeds, "cmd_lightring", EVENTS)
        self.create_subscription(String, "game_light", self.hear, EVENTS)
        self.create_timer(FRAME_S, self.next)

    def hear(self, message: Any) -> None:
        if message.data in FRAMES:
            self.word, self.frame = message.data, 0
            self.show()

    def next(self) -> None:
        if len(FRAMES[self.word]) == 1:
            return
        self.frame += 1
        if self.word in PASSING and self.frame >= PASSING_FRAMES:
            self.word, self.frame = "pacman", 0
        self.show()

    def show(self) -> None:
        frames = FRAMES[self.word]
        red, green, blue = COLOURS.get(frames[self.frame % len(frames)], BLACK)
        leds = [LedColor(red=red, green=green, blue=blue) for _ in range(6)]
        ring = LightringLeds(leds=leds, override_system=True)
        ring.header.stamp = self.get_clock().now().to_msg()
        self.ring.publish(ring)


def main() -> int:
    return run(GameLightNode)
