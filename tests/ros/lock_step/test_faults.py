"""Kills, standstills and losses at simulated moments of a whole game."""

from __future__ import annotations

from pathlib import Path

from pacman_env.ros import topics
from pacman_env.ros.lock_step.game import RESTART_S
from tests.map_parts import part_of_map
from tests.ros import session

SHOWS = ("show.start_s=1.0", "show.death_s=1.0")


def test_uncounted_pellet_counts_after_both_nodes_were_killed(domain: int, tmp_path: Path) -> None:
    ground = part_of_map("loop", 3.0).save(tmp_path / "ground.yaml")
    settings = (*SHOWS, "execution.death_radius_m=0.001")  # no round is lost
    with session.game(tmp_path, ground, "nearest", settings=settings) as played:
        game = played.game
        played.record(topics.GAME_STATE, topics.SCORE, topics.REMOVE_PELLET, topics.PELLETS_SPAWNED, topics.GAME_RESULT)

        def removed() -> int:
            return len(set(played.values(topics.REMOVE_PELLET)))

        assert played.call(topics.START_GAME).success
        played.wait_for(removed, 200, "the first pellet")
        spawned = played.values(topics.PELLETS_SPAWNED)[-1]
        while True:  # until a pellet is collected in the three seconds that a referee's start takes
            before = removed()
            game.kill("game_controller")
            while game.member("game_controller") is None and removed() == before:
                played.advance(0.1)
            if removed() > before:
                break
            played.advance(0.7)
        game.kill("goal_selector")
        played.wait_for(lambda: played.values(topics.GAME_RESULT)[-1:] not in ([], [""]), 900, "the end of the round")
        assert played.values(topics.GAME_RESULT)[-1] == f"Complete - Score: {spawned}"


def test_killed_node_is_back_after_restart_time(domain: int, tmp_path: Path) -> None:
    with session.game(tmp_path) as played:
        played.game.kill("audio_node")
        assert played.game.member("audio_node") is None
        played.advance(RESTART_S - 0.1)
        assert played.game.member("audio_node") is None
        played.advance(0.1)
        assert played.game.member("audio_node") is not None
