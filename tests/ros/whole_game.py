"""Whole games over the simulated robot in lock-step: a map whose games end as wished, and what was published.

What a game must publish is in ``test_whole_game.py``.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_of
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, LIGHT_RING_SHOWN
from pacman_env.world.maps.occupancy import OccupancyMap
from tests.ros.session import Recorded, Session

GOALS = topics.NAVIGATE_TO_POSE.statuses
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_STATUS, topics.GAME_RESULT),
    *(topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
    *(topics.GAME_LIGHT, topics.GAME_SOUND, topics.REMOVE_PELLET, topics.CMD_VEL, topics.CLYDE_POSE),
    *(LIGHT_RING_SHOWN, AUDIO_SHOWN, GOALS, topics.ODOMETRY, topics.DIAGNOSTICS),
)
NUMBERS = (topics.SCORE, topics.ROUND, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED, topics.PELLETS_SPAWNED)

# The map, in pixels of 0.05 m; pellets lie where columns and rows are multiples of 40 and 13 pixels are free.
# Clyde needs 11 pixels, the robot 8. From left to right: a closet with the home pose and the first pellet, from
# which a doorway, too narrow for Clyde, leads to the other pellets; and a cage without a door.
_RESOLUTION_M = 0.05
_SIZE = 260, 110
_FREE = (  # columns from and to, rows from and to
    (30, 46, 34, 46),  # the closet, with a pellet
    (47, 74, 35, 45),  # the rest of it; robot and Clyde do not get past one another
    (75, 83, 36, 44),  # the doorway
    (84, 166, 34, 46),  # two pellets, one after the other
    (154, 166, 34, 86),  # and around the corner another: no two are equally far
    (236, 252, 54, 70),  # the cage
)
PELLETS = 4
_HOME = 37, 40  # so that a robot that stops on the way home, 0.30 m before it, is at the closet's pellet
CAGE, CLOSET = (244, 62), (69, 40)  # where Clyde is put: it never gets out, and there is no way past it
SETTINGS = ("localization.sigma_xy_m=0.01", "localization.sigma_yaw_rad=0.02")  # the closet is narrow


def _at(column: int, row: int) -> tuple[float, float]:
    """A pixel's place, m."""
    return column * _RESOLUTION_M, (_SIZE[1] - row) * _RESOLUTION_M


HOME = f"{_at(*_HOME)[0]},{_at(*_HOME)[1]},0.0"


def closet() -> OccupancyMap:
    """The map."""
    pixels = np.zeros(_SIZE[::-1], np.uint8)
    for left, right, top, bottom in _FREE:
        pixels[top : bottom + 1, left : right + 1] = 254
    return OccupancyMap.from_pixels("closet", pixels, _RESOLUTION_M, (0.0, 0.0, 0.0))


@dataclass
class Recording:
    """One game from the call of ``game/start`` on: messages in the order of publication, at simulated times, s."""

    records: list[Recorded]
    before: dict[str, Any]  # the latched numbers, by topic, and the goals known

    def on(self, *wanted: topics.Topic) -> list[Recorded]:
        """The messages of topics, in order."""
        names = {topic.name for topic in wanted}
        return [one for one in self.records if one.topic in names]

    def values(self, topic: topics.Topic) -> list[Any]:
        """As ``on``, the ``data`` alone."""
        return [one.value for one in self.on(topic)]

    @cached_property
    def states(self) -> list[tuple[str, float, float]]:
        """Each state with its begin and end, s."""
        records = self.on(topics.GAME_STATE)
        ends = [*(one.at for one in records[1:]), math.inf]
        return [(one.value, one.at, end) for one, end in zip(records, ends, strict=True)]

    def states_at(self, at: float) -> set[str]:
        """The states of an instant: two where one state ends."""
        return {word for word, begin, end in self.states if begin <= at <= end}

    @cached_property
    def goals(self) -> dict[bytes, tuple[float, int]]:
        """Nav2's goals of this game: when each was first published, s, and its last status."""
        goals: dict[bytes, tuple[float, int]] = {}
        for one in self.on(GOALS):
            for goal in one.message.status_list:
                key = bytes(goal.goal_info.goal_id.uuid)
                goals[key] = goals.get(key, (one.at, 0))[0], goal.status
        return {key: goal for key, goal in goals.items() if key not in self.before[GOALS.name]}


def _resting(game: Session) -> bool:
    """Nothing shines, sounds or moves."""
    ring, audio = (json.loads(game.last(topic).data) if game.last(topic) else {} for topic in _SHOWN)
    velocity = game.last(topics.ODOMETRY).twist.twist
    still = abs(velocity.linear.x) + abs(velocity.angular.z) < 0.01
    return not ring.get("override_system") and not audio.get("playing") and still


_SHOWN = LIGHT_RING_SHOWN, AUDIO_SHOWN


def play(game: Session, clyde: tuple[int, int]) -> Recording:
    """One game from the menu to the menu, with Clyde put on a pixel before."""
    game.record(*RECORDED)
    game.wait_for(lambda: game.last(topics.CLYDE_POSE) and game.last(topics.ODOMETRY), what="Clyde and the robot")
    point = PointStamped(header=Header(frame_id="map"))
    point.point.x, point.point.y = place = _at(*clyde)
    game.publish(topics.CLICKED_POINT, point)
    game.wait_for(lambda: math.dist(pose_of(game.last(topics.CLYDE_POSE))[:2], place) < 0.1, what="Clyde to be placed")
    before: dict[str, Any] = {topic.name: game.last(topic).data for topic in NUMBERS}
    goals = game.last(GOALS)
    known = [] if goals is None else goals.status_list
    before[GOALS.name] = {bytes(goal.goal_info.goal_id.uuid) for goal in known}
    begin = len(game.records)
    assert game.call(topics.START_GAME).success
    for state in ("running", "menu"):
        game.wait_for(lambda state=state: game.last(topics.GAME_STATE).data == state, 400.0, f"state {state}")
    game.wait_for(lambda: _resting(game), what="the robot to rest")
    game.wait_for(lambda: game.last(topics.PELLETS_SPAWNED).data == PELLETS, what="the pellets to be back")
    game.advance(2.0)  # what comes now must not come
    return Recording(game.records[begin:], before)


def save(folder: Path) -> Path:
    """The map as files in a folder; the YAML."""
    return closet().save(folder / "closet.yaml")
