"""The goal selector's game: everything around the node, Nav2 among it, answers as the test says."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection
from functools import cache
from typing import TYPE_CHECKING, Any

from pacman_env.config import make_config
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.message_conversion import markers_of, pose_message, uncertain_pose_message
from tests.ros import scripted_nav2
from tests.ros.scripted_nav2 import Goal, ScriptedNav2

if TYPE_CHECKING:
    from tests.ros.session import Session

FAR_AWAY = (50.0, 50.0)
TICK_S = 0.1  # quicker than on a robot
QUICK = [f"execution.tick_s={TICK_S}", f"execution.check_period_s={TICK_S}"]


@cache
def house() -> MapAssets:
    return map_assets("house", make_config("robot"))


def pellet(slot: int) -> tuple[float, float]:
    x, y = house().goal_xy[slot].tolist()
    return x, y


def slot_of(place: tuple[float, float]) -> int:
    """The candidate that a goal led to."""
    apart = [math.dist(place, goal) for goal in house().goal_xy.tolist()]
    assert min(apart) < 1e-6
    return apart.index(min(apart))


def number_of_slot(slot: int) -> int:
    return int(house().pellet_ids[slot])


def number_at(goal: Goal) -> int:
    """The pellet that a goal led to."""
    return number_of_slot(slot_of((goal.x, goal.y)))


class Game:
    """The rest of the game, played by the test in a session without further nodes; ``script`` is Nav2's."""

    def __init__(self, session: Session, *script: str) -> None:
        self.session = session
        session.record(topics.GAME_STATUS, topics.GAME_EVENT, topics.REMOVE_PELLET)
        session.record(topics.CMD_VEL, topics.DIAGNOSTICS, topics.SCORES)
        self.nav2 = self.start_nav2(*script)
        self.left = {int(n): pellet(slot) for slot, n in enumerate(house().pellet_ids)}
        self.power: Collection[int] = ()  # the power pellets
        self.pose = tuple(house().grid.home.tolist())
        self.seen_at: tuple[float, float] | None = None  # where Clyde is published, until it is None
        session.observer.create_timer(1.0, self._show_clyde)

    # Nodes

    def start(self, **parameters: Any) -> None:
        """Start the node, and wait until it decides."""
        self.session.clear()
        own = {"policy": "nearest", "settings": QUICK, "map_yaml": "house", "diagnostics_rate": 10.0, **parameters}
        self.session.start(SELECTOR, **own)
        self.session.wait_for(lambda: self.session.messages(topics.DIAGNOSTICS), what="the goal selector")

    def start_nav2(self, *script: str) -> ScriptedNav2:
        self.nav2 = self.session.start(scripted_nav2.NAME, lambda **options: ScriptedNav2(*script, **options))
        return self.nav2

    def end_nav2(self) -> None:
        self.session.kill(scripted_nav2.NAME)

    def let_in(self) -> None:
        self.session.within(self.nav2.let_in)

    def abort(self, goal: Goal, error: int = 208) -> None:
        self.session.within(lambda: self.nav2.abort(goal, error))

    # What the others publish

    def say(self, topic: topics.Topic, message: Any) -> None:
        self.session.publish(topic, message)

    def stand(self, x: float, y: float, heading: float = 0.0) -> None:
        self.say(topics.AMCL_POSE, uncertain_pose_message(x, y, heading, self.session.stamp()))

    def clyde(self, x: float, y: float) -> None:
        """Publish Clyde's pose from now on."""
        self.seen_at = (x, y) if math.isfinite(x) else self.seen_at
        self.say(topics.CLYDE_POSE, pose_message(x, y, 0.0, self.session.stamp()))

    def _show_clyde(self) -> None:
        if self.seen_at is not None:
            self.clyde(*self.seen_at)

    def pellets(self, *gone: int) -> None:
        for number in gone:
            self.left.pop(number, None)
        self.say(topics.PELLET_MARKERS, markers_of(self.left, self.session.stamp(), power=self.power))

    def begin(self) -> None:
        """A round runs: robot at home, Clyde far away."""
        self.stand(*self.pose)
        self.clyde(*FAR_AWAY)
        self.pellets()
        self.say(topics.GAME_STATE, "running")
        self.say(topics.GAME_COMMAND, "enable")

    # What the node does

    def goal(self, number: int) -> Goal:
        """The so-manieth goal, from 1, once it was asked for."""
        self.session.wait_for(lambda: len(self.nav2.goals) >= number, what=f"goal {number}")
        return self.nav2.goals[number - 1]

    def running_goal(self, number: int) -> Goal:
        goal = self.goal(number)
        self.session.wait_for(lambda: goal.running, what=f"goal {number} to run")
        return goal

    def statuses(self) -> list[str]:
        return self.session.values(topics.GAME_STATUS)

    def status(self, word: str) -> None:
        self.session.wait_for(lambda: word in self.statuses(), what=f"status {word}")

    def condition(
        self, holds: Callable[[dict[str, Any]], Any] = lambda condition: True, what: str = "the condition"
    ) -> dict[str, Any]:
        """The first diagnostics from now on of which something holds."""
        seen = len(self.session.values(topics.DIAGNOSTICS))

        def found() -> dict[str, Any] | None:
            latest = [json.loads(text) for text in self.session.values(topics.DIAGNOSTICS)[seen:]]
            return next((one for one in latest if holds(one)), None)

        condition = self.session.wait_for(found, what=what)
        assert condition is not None
        return condition

    def stops(self) -> int:
        """How many zero velocities were published."""
        twists = [message.twist for message in self.session.messages(topics.CMD_VEL)]
        return sum(twist.linear.x == 0.0 and twist.angular.z == 0.0 for twist in twists)
