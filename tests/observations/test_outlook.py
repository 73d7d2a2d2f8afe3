"""What becomes of the robot on its way to each candidate, against the coarse model played by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pacman_env.game.behaviour_belief import BELIEVED
from pacman_env.levels import coarse_map
from pacman_env.levels.assets import map_assets
from pacman_env.levels.level import COARSE_MAP, Level
from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from pacman_env.observations.situation import HOLD, Situation
from tests.sim.coarse_games import at_once, config_of, first_situation, slowly

SPEED = 0.3


def sure(situation: Situation, *names: str) -> Situation:
    """The situations with the belief that the ghosts do this."""
    belief = np.zeros_like(situation.belief)
    for k, name in enumerate(names):
        belief[:, k, BELIEVED.index(name)] = 1.0
    return replace(situation, belief=belief)


def columns(situation: Situation) -> dict[str, np.ndarray]:
    candidates, whole = planner_features(situation, SPEED)
    found = {name: candidates[:, :, k] for k, name in enumerate(CANDIDATE_FEATURES)}
    return found | {name: whole[:, k] for k, name in enumerate(GLOBAL_FEATURES)}


def beside(situation: Situation, i: int, apart_m: float) -> Situation:
    """The first ghost of situation ``i`` is so far to the right of the robot."""
    ghosts = situation.ghosts.copy()
    ghosts[i, 0, :2] = situation.robot[i, :2] + (apart_m, 0.0)
    return replace(situation, ghosts=ghosts, clyde=ghosts[:, 0, :2])


def test_outlook_is_empty_without_hunters() -> None:
    situation = first_situation(config_of("wander"), 6)
    seen = columns(sure(situation, "wander"))
    for name in CANDIDATE_FEATURES:
        if name.startswith("hunted"):
            assert (seen[name] == 0).all()
    assert (seen["coming"] == 0).all()


def test_nearer_chaser_ends_more_paths() -> None:
    situation = sure(first_situation(config_of("chase"), 6), "chase")
    caught = [columns(beside(situation, 0, apart_m))["hunted_caught"][0].sum() for apart_m in (0.5, 6.0)]
    assert caught[0] > caught[1]


def test_catching_chaser_leaves_no_lead() -> None:
    seen = columns(sure(first_situation(config_of("chase", **{"clyde.speed_mps": 0.8}), 12), "chase"))
    caught = seen["hunted_caught"] > 0
    assert caught.any()
    assert (seen["hunted_lead"][caught] == 0).all()
    assert (seen["hunted_ways_on"][caught] == 0).all()
    assert (seen["hunted_lead"][(seen["hunted"] > 0) & ~caught] > 0).all()


def test_standing_ghost_catches_nobody_far_away() -> None:
    situation = sure(first_situation(config_of("chase"), 6), "chase")
    ghosts = situation.ghosts.copy()
    ghosts[:, 0, 4] = 0.0
    far = np.hypot(*(situation.ghosts[:, 0, :2] - situation.robot[:, :2]).T) > 2.0
    assert far.any()
    seen = columns(replace(situation, ghosts=ghosts))
    hold = (situation.kind == HOLD) & far[:, None]
    assert (seen["hunted_caught"][hold] == 0).all()


def test_order_of_ghosts_does_not_matter() -> None:
    ghosts = ("chase", "wander")
    situation = sure(first_situation(config_of(*ghosts), 6), *ghosts)
    turned = replace(situation, ghosts=situation.ghosts[:, ::-1], belief=situation.belief[:, ::-1])
    one, other = columns(situation), columns(turned)
    for name in GLOBAL_FEATURES:
        if name.startswith("ghost_"):
            np.testing.assert_allclose(one[name], other[name], atol=1e-6)


def test_threads_share_the_table_of_a_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second table would replace the first, whose memory is freed while a kernel reads it."""
    config = config_of("chase")
    level = Level.of(replace(map_assets("loop", config)), config)  # of a map that nothing has been made of

    def address() -> int:
        coarse_map.add_coarse_map(level)
        return int(level.arrays["later"][COARSE_MAP])

    monkeypatch.setattr(coarse_map, "coarse_map", slowly(coarse_map.coarse_map))
    first, second = at_once(address)
    assert first == second
