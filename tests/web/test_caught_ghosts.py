"""Frames tell of frightened and caught ghosts: in a round, in its score, and in every frame of its recording."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from msgspec import UNSET

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.web import page_messages as m
from pacman_env.web.caught_ghosts import CaughtGhosts
from pacman_env.web.orders import Orders
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import Choices, Rules
from pacman_env.web.simulated import SimulatedGame
from tests.waiting import wait_for
from tests.web.pages import decode_all

#: Every pellet frightens ghosts, which hardly move then: the robot catches those on its way.
SETTINGS: dict[str, Any] = {
    "power.pellets": 99,
    "power.speed_factor": 0.05,
    "power.return_s": 3.0,
    "time_limit_s": 120.0,
}
RULES = Rules(policy="nearest", second="nearest", map="loop", ghosts=("wander", "wander"), settings=SETTINGS)


def places_on_the_way(pellets: Any, home: Any) -> list[list[float]]:
    """Return two of the pellets that a robot at home collects first."""
    places = np.array(pellets)
    return places[np.argsort(np.hypot(*(places - home).T))[3:5]].tolist()


@pytest.fixture(scope="module")
def played() -> PlayedRound:
    config, source, ghosts = Choices().prepare(RULES, 0.05)
    played = PlayedRound(config, source, ghosts, ("nearest", "nearest"), 3)
    places, pellets = played.assets.goal_xy, played.assets.pellets
    for ghost, (x, y) in enumerate(places_on_the_way(*np.split(places[: pellets + 1], [pellets]))):
        played.place_ghost(ghost, x, y)
    for _ in range(240):
        played.step(Orders())
    return played


def test_eyes_leave_place_of_catch_for_spawn_place(played: PlayedRound) -> None:
    frames: list[Any] = played.snapshots
    catches = [
        (before, now, k)
        for before, now in pairwise(frames)
        for k in np.flatnonzero(now.away_s > before.away_s).tolist()
    ]
    assert catches
    for before, now, ghost in catches:
        assert np.hypot(*(now.ghosts[ghost] - before.ghosts[ghost])) < 1.0
        assert before.ghosts[ghost].tolist() in now.points[:, :2].tolist()
        back = next(one for one in frames[now.number :] if one.away_s[ghost] == 0)
        assert back.time_s - now.time_s == pytest.approx(3.0, abs=0.6)
        assert back.harmless_s[ghost] == 0 or len(frames[now.number].points)
    assert frames[-1].ghosts_caught == len(catches)


def test_points_double_until_next_power_pellet() -> None:
    caught, places, until_s = CaughtGhosts(5.0, 20), np.zeros((3, 2)), np.full((3, 2), (30.0, 0.0))
    caught.update(places, until_s, 10.0, 2)
    until_s[0] = until_s[2] = 16.0
    fields = caught.update(places, until_s, 11.0, 2)
    assert (caught.new, fields["points"][:, 2].tolist()) == ([0, 2], [20, 40])
    assert fields["away_s"].tolist() == [5.0, 0.0, 5.0]
    until_s[1] = 17.0
    assert caught.update(places, until_s, 12.0, 1)["points"][:, 2].tolist() == [20, 20, 40]
    assert not len(caught.update(places, until_s, 15.0, 1)["points"])


def test_score_of_page_equals_score_of_simulator() -> None:
    game = SimulatedGame(RULES, seed=3, speed=50)
    try:
        game.handle("Ann", m.ClydeSpeed(mps=0.05))
        facts = game.scene().facts
        for ghost, (x, y) in enumerate(places_on_the_way(facts["pellets"], facts["home"][:2])):
            game.handle("Ann", m.PlaceClyde(x=x, y=y, ghost=ghost))
        played = game._match.require_round()
        game.handle("Ann", m.Start())
        wait_for(lambda: game.handle("Ann", m.Stories()))
        story = game.handle("Ann", m.Stories())[0]
        result = next(one["words"] for one in game.news(0) if "Score: " in one.get("words", ""))
        assert int(result.rpartition(" ")[2]) == played.batch.games["score"][0]
        events = [one["event"] for one in game.news(0) if "event" in one]
        assert events.count("power pellet") == story["collected"]
        assert sum(events.count(f"{name} caught") for name in GHOST_NAMES) == story["ghosts_caught"] > 0
        frames: list[Any] = decode_all(game.story(story["story"]) or b"")
        assert max(len(frame.points) for frame in frames) > 0
        assert game.scene().facts["power"]["pellets"] == list(range(len(game.scene().facts["pellets"])))
    finally:
        game.close()


def test_game_without_power_pellets_sends_no_fields_of_them() -> None:
    config, source, ghosts = Choices().prepare(Rules(policy="nearest", second="nearest", map="loop"), None)
    frame = PlayedRound(config, source, ghosts, ("nearest", "nearest"), 3).snapshots[0]
    assert frame.harmless_s is frame.away_s is frame.points is frame.ghosts_caught is UNSET
    assert b"harmless" not in frame.encode().encode()
