"""Killing any node at any moment of a game loses no pellet and stops no other node.

The nodes play in lock-step, so the moments are simulated and a failure is repeatable. Processes killed
with SIGKILL are in ``tests/ros/test_killed_processes.py``.
"""

from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, REFEREE, SELECTOR, SIMULATOR
from pacman_env.ros.lock_step.deliveries import NodeFailed
from pacman_env.ros.lock_step.lock_step_game import LockStepGame
from pacman_env.ros.message_conversion import pellets_of, pose_of
from tests.ros import session

SETTINGS = ("clyde.speed_mps=0.02", "clyde.speed_step_mps=0.001", "show.start_s=1", "show.death_s=1")
PAUSE_S, HANG_S = 20.0, 600.0  # simulated: before a kill at most, and until the game goes on again
CLYDE_MOVED = "clyde has moved"
#: Messages that a node publishes after its return because of messages from the other nodes.
EFFECTS = {
    SIMULATOR: (topics.GAME_STATUS.name,),
    "pellet_manager": (topics.PELLET_MARKERS.name, topics.REMOVE_PELLET.name),
    "audio_node": (topics.GAME_SOUND.name, topics.PLAY_NOTES.statuses.name),
    "game_light_node": (topics.GAME_LIGHT.name, topics.LIGHT_RING.name),
    "clyde_ghost_node": (CLYDE_MOVED,),
    "game_event_mapper": (topics.GAME_EVENT.name, topics.GAME_LIGHT.name, topics.GAME_SOUND.name),
    REFEREE: (topics.GAME_STATUS.name, topics.PELLETS_COLLECTED.name),
    SELECTOR: (topics.GAME_STATUS.name, topics.REMOVE_PELLET.name),
}
COUNTED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.GAME_STATUS),
    *(topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND, topics.LIGHT_RING, topics.PLAY_NOTES.statuses),
    *(topics.PELLET_MARKERS, topics.REMOVE_PELLET, topics.CLYDE_POSE),
)


class Watch:
    """Counts messages, and compares the score of every completed round with its pellets."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.state, self.result = "", ""
        self.rounds, self.score, self.spawned = 0, 0, 0
        self.shown: set[int] = set()
        self.removed: set[int] = set()  # in this round
        self.clyde: tuple[float, ...] = ()
        self.wrong_scores: list[str] = []

    def receive(self, topic: topics.Topic, message: Any) -> None:
        self.counts[topic.name] += 1
        if topic == topics.GAME_STATE:
            self.state = message.data
            if message.data == "returning_home":
                self.removed.clear()
        elif topic == topics.PELLETS_SPAWNED:
            self.spawned = message.data or self.spawned
        elif topic == topics.REMOVE_PELLET:
            self.removed.add(message.data)
        elif topic == topics.PELLET_MARKERS:
            self.shown = set(pellets_of(message))
        elif topic == topics.CLYDE_POSE:
            self.counts[CLYDE_MOVED] += pose_of(message) != self.clyde
            self.clyde = pose_of(message)
        elif topic == topics.GAME_RESULT:
            if message.data not in ("", self.result):
                self.end(message.data)
            self.result = message.data

    def end(self, result: str) -> None:
        self.rounds += 1
        before, self.score = self.score, int(result.rpartition(" ")[2])
        if not result.startswith("Complete"):
            self.score = 0
        elif self.score != before + self.spawned:
            self.wrong_scores.append(f"{result}, {before} before and {self.spawned} pellets")

    def missing(self, node: str, before: Counter[str]) -> list[str]:
        """Return the effects of a node's return that were not seen yet; the game itself counts a pellet."""
        wanted = {topics.PELLETS_COLLECTED.name, *EFFECTS[node]}
        lacking = sorted(name for name in wanted if self.counts[name] <= before[name])
        return lacking + ["removed pellets are shown"] * (node == "pellet_manager" and bool(self.shown & self.removed))


@pytest.mark.daily
@pytest.mark.parametrize("seed", [0, 1])
def test_game_continues_after_each_node_is_killed(seed: int, domain: int, tmp_path: Path) -> None:
    watch, rng = Watch(), np.random.default_rng(seed)
    assert set(EFFECTS) == {SIMULATOR, SELECTOR, *GAME}
    with session.game(tmp_path, policy="nearest", seed=seed, settings=SETTINGS) as played:
        game = played.game
        assert isinstance(game, LockStepGame)
        for topic in COUNTED:
            receive = partial(watch.receive, topic)
            game.subscribe(played.observer, partial(topic.subscription, played.observer, receive))

        def advance(until: Any, limit_s: float) -> bool:
            end_s = played.now_s + limit_s
            while not until() and played.now_s < end_s:
                if watch.state == "menu":
                    with suppress(NodeFailed):  # the referee may be away
                        game.call(played.observer, topics.START_GAME, 5.0)
                game.advance(0.5)
            return bool(until())

        for node in rng.permutation(sorted(EFFECTS)).tolist():
            advance(lambda: False, rng.uniform(0.0, PAUSE_S))
            game.kill(node)
            assert advance(lambda node=node: game.member(node) is not None, 180.0), f"{node} does not return"
            before = watch.counts.copy()
            goes_on = advance(lambda node=node, before=before: not watch.missing(node, before), HANG_S)
            assert goes_on, f"{node}: {watch.missing(node, before)}"
        errors = played.errors()
    assert watch.wrong_scores == errors == []
    assert watch.rounds > 0
