"""The original's referee: counts every report, waits for as many as he ever saw pellets, or for ``game_complete``."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from std_msgs.msg import Float32, Int32, String
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from tests.ros.original.common import EVENTS, LATCHED, answer, now_s, run

START_SHOW_S, DEATH_SHOW_S = 8.0, 5.0
BASE_MPS, STEP_MPS = 0.25, 0.05
TYPES = {"game_state": String, "game_command": String, "game_result": String}


class GameController(Node):
    def __init__(self) -> None:
        super().__init__("game_controller")
        self.state, self.score, self.round = "menu", 0, 1
        self.spawned = self.collected = 0
        self.base_mps = BASE_MPS
        self.after_home = "start"
        self.due_s: float | None = None
        numbers = ("game/pellets_spawned", "game/pellets_collected", "game/score", "game/round")
        types = {**TYPES, **dict.fromkeys(numbers, Int32), "clyde/speed": Float32}
        self.voices = {name: self.create_publisher(type, name, LATCHED) for name, type in types.items()}
        self.types = types
        self.events = self.create_publisher(String, "game_event", EVENTS)
        self.resets = [self.create_client(Trigger, name) for name in ("reset_pellets", "reset_clyde")]
        self.create_subscription(String, "game_status", self.hear_status, EVENTS)
        self.create_subscription(MarkerArray, "pellet_markers", self.hear_pellets, EVENTS)
        self.create_subscription(Float32, "game/base_clyde_speed", self.hear_speed, LATCHED)
        self.create_service(Trigger, "game/start", self.start)
        self.create_service(Trigger, "game/reset", self.reset)
        self.create_timer(0.1, self.tick)
        self.say("clyde/speed", self.speed)
        self.say_numbers()
        self.enter("menu")

    @property
    def speed(self) -> float:
        return self.base_mps + (self.round - 1) * STEP_MPS

    def say(self, name: str, value: Any) -> None:
        self.voices[name].publish(self.types[name](data=value))

    def say_numbers(self) -> None:
        self.say("game/pellets_collected", self.collected)
        self.say("game/score", self.score)
        self.say("game/round", self.round)

    def event(self, word: str) -> None:
        self.events.publish(String(data=word))

    def command(self, word: str) -> None:
        self.say("game_command", word)

    def enter(self, state: str) -> None:
        self.state = state
        self.say("game_state", state)

    def start(self, request: Any, response: Any) -> Any:
        if self.state != "menu":
            return answer(response, False, f"state is {self.state}")
        self.say("game_result", "")
        self.reset_round()
        self.enter("menu")
        self.go_home("start")
        return answer(response, True, "game started")

    def reset(self, request: Any, response: Any) -> Any:
        self.score, self.round = 0, 1
        self.say("game_result", "")
        self.reset_round()
        self.say("clyde/speed", self.speed)
        self.enter("menu")
        return answer(response, True, "game reset")

    def reset_round(self) -> None:
        """What is said in a burst to listeners of depth 1, who may hear but the last."""
        self.due_s = None
        self.spawned = self.collected = 0
        self.command("disable")
        self.command("reset_round")
        self.event("reset")
        for client in self.resets:
            if client.service_is_ready():
                client.call_async(Trigger.Request())
        self.say_numbers()

    def go_home(self, then: str) -> None:
        self.after_home = then
        self.command("return_home")
        self.enter("returning_home")

    def hear_speed(self, message: Any) -> None:
        self.base_mps = message.data
        if self.state == "menu":
            self.say("clyde/speed", self.speed)

    def hear_pellets(self, message: Any) -> None:
        """The most that was ever seen in a round counts, be it stale."""
        count = sum(marker.ns == "pellets" and marker.action == Marker.ADD for marker in message.markers)
        if count > self.spawned:
            self.spawned = count
            self.say("game/pellets_spawned", count)

    def hear_status(self, message: Any) -> None:
        word = message.data
        if word.startswith("pellet_collected") and self.state == "running":
            self.collected += 1
            self.score += 1
            self.say("game/pellets_collected", self.collected)
            self.say("game/score", self.score)
            self.event("pellet")
            if self.collected >= self.spawned > 0:
                self.complete()
        elif word == "game_complete" and self.state == "running":
            self.complete()
        elif word == "death_detected" and self.state == "running":
            self.command("disable")
            self.say("game_result", f"Death - Score: {self.score}")
            self.enter("dying")
            self.due_s = now_s(self) + DEATH_SHOW_S
        elif word in ("home_reached", "home_failed") and self.state == "returning_home":
            self.home(word)

    def complete(self) -> None:
        self.command("disable")
        self.event("win")
        self.say("game_result", f"Complete - Score: {self.score}")
        self.command("return_home")
        self.enter("complete")
        self.go_home("next_round")

    def home(self, word: str) -> None:
        if word == "home_reached" and self.after_home == "start":
            self.event("start theatrical")
            self.enter("starting")
            self.due_s = now_s(self) + START_SHOW_S
            return
        if word == "home_failed":  # in the menu, wherever the robot is
            self.say("game_result", "home_failed")
        if self.after_home == "next_round":
            self.round += 1
        elif self.after_home == "game_over":
            self.score, self.round = 0, 1
        self.reset_round()
        self.say("clyde/speed", self.speed)
        self.enter("menu")

    def tick(self) -> None:
        if self.due_s is None or now_s(self) < self.due_s:
            return
        self.due_s = None
        if self.state == "starting":
            self.say("clyde/speed", self.speed)
            self.command("enable")
            self.enter("running")
        elif self.state == "dying":
            self.go_home("game_over")


def main() -> int:
    return run(GameController)
