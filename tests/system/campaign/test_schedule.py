from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.pellets import generate_pellets
from pacman_env.policies.registry import policy_names
from pacman_env.ros.simulated_robot.sim_faults import Faults
from pacman_env.sim.maps.assets import map_assets
from tests.system.campaign.schedule import (
    ARENAS,
    DRAWN_FAULTS,
    EVERY_NODE,
    FREEZE,
    GAMES_PER_SYSTEM,
    INTERFERENCES,
    KILL,
    LEASE_S,
    LOSS,
    NODES,
    OUTAGES,
    POLICIES,
    STATES,
    arena_of,
    part_of_map,
    schedule,
)

seeds = st.integers(0, 2**40)


@given(seeds)
def test_a_game_belongs_to_its_seed_and_every_step_can_happen(seed: int) -> None:
    game = schedule(seed)
    assert game == schedule(seed)
    assert game.policy in POLICIES
    assert 0.0 < game.clyde_speed_mps <= 0.4
    faults = Faults()
    for step in game.steps:
        assert step.state in STATES
        assert step.after_s >= 0.0
        if step.words:
            faults.apply(step.words)
            assert step.kind in faults
            assert step.lasts_s > 0.0
        elif step.kind in OUTAGES:
            assert step.node in NODES or (step.kind, step.node) == (LOSS, EVERY_NODE)
            assert 1.0 <= step.lasts_s <= 60.0 or (step.kind, step.lasts_s) == (KILL, 0.0)
            assert 0 < step.percent <= 100
        else:
            assert step.kind in INTERFERENCES
            assert not (step.kind.startswith("start") and step.state == "menu")
    assert len(faults.now) == sum(bool(step.words) for step in game.steps)


@given(seeds)
def test_games_of_one_system_share_their_ground(seed: int) -> None:
    first = seed - seed % GAMES_PER_SYSTEM
    assert arena_of(seed) == arena_of(first) == arena_of(first + GAMES_PER_SYSTEM - 1)


def test_two_hundred_games_meet_every_fault_every_interference_and_every_ground() -> None:
    games = [schedule(seed) for seed in range(200)]
    met = [step for game in games for step in game.steps]
    assert {step.kind for step in met} == {*DRAWN_FAULTS, *INTERFERENCES, *OUTAGES}
    for kind in (*DRAWN_FAULTS, *OUTAGES):
        assert {step.state for step in met if step.kind == kind} == set(STATES)
    assert {game.policy for game in games} == set(POLICIES) <= set(policy_names())
    assert {arena_of(seed) for seed in range(400)} == set(ARENAS)
    assert any(not game.steps for game in games)
    outages = {kind: [step for step in met if step.kind == kind] for kind in OUTAGES}
    assert all({step.node for step in steps} >= set(NODES) for steps in outages.values())
    for kind in (FREEZE, LOSS):
        assert 0.3 < np.mean([step.lasts_s > LEASE_S for step in outages[kind]]) < 0.7
    assert {step.percent for step in outages[LOSS]} == {30, 60, 100}
    assert any(
        one.words and other.words and (one.state, one.after_s) == (other.state, other.after_s)
        for game in games
        for one, other in zip(game.steps, game.steps[1:], strict=False)
    )


@pytest.mark.parametrize("arena", sorted(set(ARENAS)))
def test_every_pellet_of_an_arena_can_be_reached(arena: tuple[str, float]) -> None:
    config = make_config("robot")
    part = part_of_map(*arena)
    pellets = generate_pellets(part, config.pellets)
    assert 3 <= map_assets(part, config).pellets == len(pellets.ids)
    if math.isfinite(arena[1]):
        assert (np.abs(pellets.position) <= arena[1]).all()
