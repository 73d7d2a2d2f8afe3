"""Whole games in lock-step: the same seed is the same game, whatever happens beside it."""

from __future__ import annotations

import random
import time
from pathlib import Path

from pacman_env.ros import topics
from pacman_env.ros.lock_step.transcript import Transcript
from tests.map_parts import part_of_map
from tests.ros import session

SHOWS = ("show.start_s=1.0", "show.death_s=1.0")


def played(folder: Path, seed: int, is_slow: bool = False) -> tuple[int, str, list[str]]:
    """Play one game; return how many messages were handled, their hash, and the states.

    On a slow machine each step takes some real time, now more, now less.
    """
    folder.mkdir()
    ground = part_of_map("house", 3.0).save(folder / "ground.yaml")
    with session.game(folder, ground, seed=seed, settings=SHOWS) as game:
        game.record(topics.GAME_STATE)
        transcript = Transcript(game.game)
        assert game.call(topics.START_GAME).success
        game.forget()

        def is_over() -> bool:
            time.sleep(0.004 * random.random() if is_slow else 0.0)
            return "menu" in game.values(topics.GAME_STATE)

        game.wait_for(is_over, 900, "the end of the game")
        return transcript.messages, transcript.hexdigest(), game.values(topics.GAME_STATE)


def test_same_seed_is_same_game_message_for_message(domain: int, tmp_path: Path) -> None:
    first, other = played(tmp_path / "idle", 3), played(tmp_path / "other", 4)
    again = played(tmp_path / "slow", 3, is_slow=True)
    assert first == again
    assert first[2][-2:] == ["returning_home", "menu"]
    assert first[1] != other[1]
