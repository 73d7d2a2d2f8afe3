"""The original's ``game_event_mapper``: a motion lasts as long as it lasts, whoever else drives meanwhile."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from std_msgs.msg import String

from tests.ros.original.common import EVENTS, now_s, run

GHOSTS = ("clyde", "blinky", "pinky", "inky")
#: Event to light, sound and motion.
ANSWERS: dict[str, tuple[str, str | None, str | None]] = {
    "start": ("start", "start", None),
    "start theatrical": ("start", "pacman_theme", "spin"),
    "pellet": ("pellet", "pellet", None),
    "power pellet": ("power pellet", "power pellet", None),
    "death": ("game over", "death", "shake"),
    "game over": ("game over", "death", "shake"),
    "win": ("win", "win", None),
    "reset": ("off", None, "stop"),
    **{f"{ghost} caught": (f"{ghost} caught", "ghost", None) for ghost in GHOSTS},
    **{f"{ghost} killed": (f"{ghost} killed", "death", "shake") for ghost in GHOSTS},
}
SPIN_S, SHAKE_S, TURN_RADPS, PERIOD_S, SWING_S = 8.0, 5.0, 1.5, 0.1, 0.25


class GameEventMapper(Node):
    def __init__(self) -> None:
        super().__init__("game_event_mapper")
        self.motion: str | None = None
        self.since_s = 0.0
        self.light = self.create_publisher(String, "game_light", EVENTS)
        self.sound = self.create_publisher(String, "game_sound", EVENTS)
        self.velocity = self.create_publisher(TwistStamped, "cmd_vel", EVENTS)
        self.create_subscription(String, "game_event", self.hear, EVENTS)
        self.create_timer(PERIOD_S, self.move)

    def hear(self, message: Any) -> None:
        if message.data not in ANSWERS:
            return
        light, sound, motion = ANSWERS[message.data]
        self.light.publish(String(data=light))
        if sound is not None:
            self.sound.publish(String(data=sound))
        if motion == "stop":
            self.motion = None
            self.turn(0.0)
        elif motion is not None:
            self.motion, self.since_s = motion, now_s(self)

    def move(self) -> None:
        passed_s = now_s(self) - self.since_s
        if self.motion is not None and passed_s >= (SPIN_S if self.motion == "spin" else SHAKE_S):
            self.motion = None
            self.turn(0.0)
        elif self.motion == "spin":
            self.turn(TURN_RADPS)
        elif self.motion == "shake":
            self.turn(TURN_RADPS * (-1) ** int(passed_s / SWING_S))

    def turn(self, radps: float) -> None:
        twist = TwistStamped()
        twist.header.frame_id, twist.header.stamp = "base_link", self.get_clock().now().to_msg()
        twist.twist.angular.z = radps
        self.velocity.publish(twist)


def main() -> int:
    return run(GameEventMapper)
