"""A game that is killed and started again continues, with every point; times are simulated.

One whole game on a part of a map. Real processes are killed in ``tests/ros/test_kills.py``.
"""

import math
from collections.abc import Iterator

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS
from pacman_env.ros.message_conversion import pose_of
from tests.map_parts import part_of_map
from tests.ros import session

RESTART_S = 3.0
SETTINGS = ("clyde.speed_mps=0.02", "show.start_s=4", "show.death_s=5", "power.pellets=1")
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND, topics.HARMLESS_GHOSTS),
    *(topics.PELLETS_COLLECTED, topics.GAME_COMMAND, topics.GAME_STATUS, topics.AMCL_POSE, topics.CLYDE_POSE),
)
POINTS = 4  # of the power pellet, beside one as for every pellet


class Game(session.Session):
    """All nodes but the operator, which is the test."""

    def reach(self, state: str) -> None:
        self.wait_for(lambda: self.value(topics.GAME_STATE) == state, 300.0, f"state {state}")

    def collect(self, pellets: int) -> None:
        self.wait_for(lambda: self.value(topics.PELLETS_COLLECTED) >= pellets, 300.0, f"{pellets} pellets")

    def away_m(self) -> float:
        """How far from home the robot believes to be."""
        return math.hypot(*pose_of(self.latest(topics.AMCL_POSE))[:2])

    def play_to_the_end(self, score: int) -> None:
        """The round is completed; every pellet of it counts."""
        self.wait_for(lambda: self.value(topics.GAME_RESULT), 300.0, "the end")
        assert self.value(topics.GAME_RESULT) == f"Complete - Score: {score}"
        assert self.value(topics.SCORE) == score

    def kill_game(self) -> None:
        """Kill the game with its listeners, as one process, and start it again."""
        for name in (GAME, *LISTENERS):
            self.kill(name)
        self.advance(RESTART_S)
        for name in (GAME, *LISTENERS):
            self.start(name)


@pytest.fixture(scope="module")
def game(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("game")
    ground = part_of_map("loop", 3.0).save(folder / "ground.yaml")
    with session.game(folder, ground, "clyde_aware", seed=3, session=Game, settings=SETTINGS) as game:
        game.record(*RECORDED)
        yield game
        assert game.errors() == []


@pytest.fixture
def pellets(game: Game) -> int:
    """The pellets of a new game's first round, of which nothing is collected yet."""
    assert game.call(topics.RESET_GAME).success
    game.reach("menu")
    game.advance(2.0)  # the robot stands
    game.clear()
    assert game.call(topics.START_GAME).success
    game.reach("running")
    return int(game.node(GAME).game.referee.spawned)


def test_killed_game_collects_nothing_twice(game: Game, pellets: int) -> None:
    game.collect(1)
    commands = len(game.values(topics.GAME_COMMAND))
    clyde = pose_of(game.latest(topics.CLYDE_POSE))[:2]
    game.kill_game()
    assert math.dist(pose_of(game.latest(topics.CLYDE_POSE))[:2], clyde) < 0.3
    game.play_to_the_end(pellets + POINTS)
    reports = [word for word in game.values(topics.GAME_STATUS) if word.startswith("pellet_collected")]
    assert len(reports) == len(set(reports)) == pellets
    assert "reset_round" not in game.values(topics.GAME_COMMAND)[commands : commands + 2]


def test_killed_game_keeps_ghosts_harmless(game: Game, pellets: int) -> None:
    ghosts = lambda: game.node(GAME).ghosts  # noqa: E731
    game.wait_for(lambda: ghosts().harmless.any(), what="the power pellet")
    until_s = float(ghosts().harmless[0, 0])
    game.kill_game()
    game.advance(1.0)
    assert ghosts().harmless[0, 0] == pytest.approx(until_s, abs=RESTART_S + 1.0)


def test_killed_game_brings_robot_home(game: Game, pellets: int) -> None:
    game.play_to_the_end(pellets + POINTS)
    assert game.away_m() > 1.0
    game.kill_game()  # it was not told where home is
    game.reach("menu")
    assert (game.value(topics.SCORE), game.value(topics.ROUND)) == (pellets + POINTS, 2)
    assert game.away_m() < 0.6
