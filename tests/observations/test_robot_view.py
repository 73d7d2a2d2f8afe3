import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from pacman_env.config import PelletConfig, make_config
from pacman_env.game.ends import RUNNING
from pacman_env.game.goals import Place
from pacman_env.game.pellets import generate_pellets
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.heuristics.search.search import Search
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView, Seen
from pacman_env.observations.situation import Situation, SituationArrays
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch
from tests.drawn import drawn
from tests.physics_steps import watch
from tests.sim.players import new_batch

#: What a robot measures with other arithmetic than the simulator's.
ROUNDED = ("clyde_velocity", "closing_speed", "ghosts", "fright")


class Robot:
    """Watches a game of the simulator through nothing but what a robot is told."""

    def __init__(self, batch: GameBatch) -> None:
        self.batch = batch
        self.live = RobotView(batch.assets, batch.config, seed=int(batch.games[0]["seed"]))
        self.live.begin()
        self.period_s = batch.config.clyde.update_period_s
        self.updates = {0: batch.obstacles[0].copy()}  # ghosts by the number of their update
        self.seen_updates = -1
        watch(batch, self.watch)

    def watch(self) -> None:
        steps = round(self.period_s / self.batch.config.physics_step_s)
        self.updates.setdefault(-(-int(self.batch.games[0]["step"]) // steps), self.batch.obstacles[0].copy())

    def situation(self) -> Situation:
        game, config = self.batch.games[0], self.batch.config
        self.live.clyde_speed_mps = float(game["clyde_speed"])
        for update in range(self.seen_updates + 1, max(self.updates) + 1):
            for number, ghost in enumerate(self.updates[update]):
                self.live.see_ghost(number, *ghost[:2].tolist(), round(update * self.period_s * 1e9))
            self.seen_updates = update
        until = self.batch.obstacles[0, :, HARMLESS_UNTIL:]
        wheels = float(game["left"]), float(game["right"])
        per_base = 1.0 / config.robot.wheel_base_m
        alive = self.batch.assets.pellet_ids[self.batch.alive[0, : self.batch.assets.pellets]]
        seen = Seen(
            time_s=float(game["tick"]) * config.execution.tick_s,
            pose=(
                float(game["x"] + game["error_x"]),
                float(game["y"] + game["error_y"]),
                float(game["heading"] + game["error_heading"]),
            ),
            left=alive.tolist(),
            velocity=(0.5 * (wheels[0] + wheels[1]), (wheels[1] - wheels[0]) * per_base),
            masked=np.flatnonzero(self.batch.rules["waits"][0] > game["step"]).tolist(),
            pursued=int(game["pursued"]),
            harmless_s=np.maximum(until - float(game["step"]), 0.0) * config.physics_step_s,
        )
        return self.live.situation(seen)


def differences(robots: Situation, simulators: Situation, clyde_cell_m: float) -> list[str]:
    """Names of the fields in which the two differ."""
    found = []
    for name, expected in zip(SituationArrays._fields, simulators.arrays(), strict=True):
        value = getattr(robots, name)
        if name in ROUNDED:
            same = np.allclose(value, expected, rtol=1e-9, atol=1e-12)
        elif name == "path_clyde":
            # Whether he has just reached a cell or is about to is a matter of the last bit.
            finite = np.isfinite(expected)
            same = bool((np.isfinite(value) == finite).all())
            apart = np.abs(value[finite] - expected[finite]) if same else np.array(np.inf)
            same = bool((apart <= math.sqrt(2) * clyde_cell_m + 0.011).all())
        else:
            same = np.array_equal(value, expected)
        if value.dtype != expected.dtype or value.shape != expected.shape or not same:
            found.append(f"{name}: {value} instead of {expected}")
    return found


def play(source: str, seed: int, policies: list[Policy], ticks: int, **changes: Any) -> dict[str, int]:
    """Play rounds with the first policy through the robot's eyes; every policy must choose alike in both."""
    # With the preset's costmaps path lengths of adjacent cells can differ by more than the cells' distance.
    config = make_config("robot", **{"nav2.inflation_radius_m": 0.22, "nav2.inflation_scale": 2.0, **changes})
    batch = new_batch(config, 1, source, first_seed=seed)
    robot = Robot(batch)
    counts = {"ticks": 0, "same_cell": 0, "barred": 0, "collected": 0, "frightened": 0, "caught": 0}
    for policy in policies:
        policy.reset(np.ones(1, np.bool_), config)
    for _ in range(ticks):
        if batch.games[0]["end"] != RUNNING:
            break
        simulators, robots = situation_of(batch), robot.situation()
        assert not differences(robots, simulators, batch.assets.clyde.resolution), f"tick {batch.games[0]['tick']}"
        choices = []
        for policy in policies:
            expected, chosen = policy.select(simulators), policy.select(robots)
            assert chosen.tolist() == expected.tolist(), policy.name
            choices.append(chosen)
        counts["ticks"] += 1
        counts["same_cell"] += np.array_equal(robots.path_clyde, simulators.path_clyde)
        counts["barred"] += not simulators.mask[0, : batch.assets.pellets][batch.alive[0]].all()
        batch.step(choices[counts["ticks"] // 40 % len(choices)])  # in turns, so that both get around
        counts["frightened"] += (simulators.frightened_s > 0).all()
        counts["collected"], counts["caught"] = (int(batch.games[0][name]) for name in ("collected", "caught"))
    return counts


@pytest.mark.parametrize(("source", "seed"), [("house", 7), ("open_plan", 3)])
def test_robot_sees_and_chooses_like_the_simulator(source: str, seed: int) -> None:
    counts = play(source, seed, [make_policy("lookahead"), make_policy("clyde_aware")], 200)
    assert counts["ticks"] > 20
    assert counts["collected"] > 0
    assert counts["same_cell"] > 0.9 * counts["ticks"]


@pytest.mark.parametrize("behaviour", ["chase", "arcade"])
def test_search_on_robot_chooses_like_in_simulator(behaviour: str) -> None:
    changes = {"clyde.ghosts": (behaviour,)}
    assert play("house", 1, [Search(nodes=1000)], 80, **changes)["collected"] > 0


def test_robot_matches_simulator_despite_aborts_and_fast_ghosts() -> None:
    policies = [make_policy(name) for name in ("lookahead", "clyde_aware", "nearest", "random_pellet")]
    changes = {"nav2.abort_rate": 0.5, "clyde.speed_mps": 0.45, "execution.death_radius_m": 1e-6}
    assert play("maze", 5, policies, 150, **changes)["barred"] > 5


def test_robot_agrees_while_ghosts_are_frightened_and_away() -> None:
    power = {"power.pellets": 9, "power.duration_s": 60.0, "power.speed_factor": 0.2}
    changes = {"clyde.ghosts": ("wander", "wander"), "execution.death_radius_m": 0.6, **power}
    games = [
        play("house", seed, [make_policy("nearest"), make_policy("clyde_aware")], 400, **changes) for seed in (9, 10)
    ]
    assert min(counts["frightened"] for counts in games) > 100
    assert sum(counts["caught"] for counts in games) > 0


@cache
def house() -> RobotView:
    config = make_config("robot")
    return RobotView(map_assets("house", config), config)


def test_pellets_are_known_by_id_and_place() -> None:
    game = house()
    number = int(game.assets.pellet_ids[0])
    x, y = game.assets.goal_xy[0].tolist()
    own = game.pellets({number: (x + 0.01, y), 9999: (x, y), number + 1: (x + 50.0, y)})
    assert own.known == {number: (x, y)}
    assert own.unknown == (9999, number + 1)


def test_unreachable_pellets_are_known_but_no_candidates() -> None:
    config = make_config("robot")
    rows = ["#" * 14, "#.......######", "#.......#....#", "#.......#....#", "#.......#....#", "#" * 14]
    assets = map_assets(drawn(rows, origin=(-1.5, -1.5, 0.0)), config.with_fields(**{"pellets.spacing_m": 0.5}))
    game = RobotView(assets, config.with_fields(**{"pellets.spacing_m": 0.5}))
    assert len(assets.dropped_ids) > 0
    far = int(assets.dropped_ids[0])
    places = generate_pellets(assets.occupancy, PelletConfig(spacing_m=0.5))
    everything = dict(zip(places.ids.tolist(), map(tuple, places.position.tolist()), strict=True))
    assert not game.pellets(everything).unknown
    assert far in game.out_of_reach(everything)
    game.see_ghost(0, 0.0, 0.0, 0)
    situation = game.situation(Seen(0.0, (0.0, 0.0, 0.0), left=list(everything)))
    assert situation.pellets_left[0] == assets.pellets
    assert situation.mask[0].all()


def test_moved_ghost_has_no_velocity() -> None:
    game = RobotView(house().assets, make_config("robot"))
    cells = game.assets.clyde.position
    here = cells[game.assets.clyde.cells_in(0)[0]]
    game.see_ghost(0, *here.tolist(), 10**9)
    game.see_ghost(0, here[0] + 0.05, here[1], 12 * 10**8)
    seen = Seen(0.0, (0.0, 0.0, 0.0), left=())
    assert game.situation(seen).clyde_velocity[0] == pytest.approx((0.25, 0.0))
    game.see_ghost(0, here[0] + 0.05, here[1], 12 * 10**8)
    assert game.situation(seen).clyde_velocity[0] == pytest.approx((0.25, 0.0))
    game.see_ghost(0, here[0] + 3.0, here[1], 14 * 10**8)
    assert game.situation(seen).clyde_velocity[0].tolist() == [0.0, 0.0]
    game.see_ghost(0, here[0] + 3.0, here[1], 10**8)
    assert game.situation(seen).clyde_velocity[0].tolist() == [0.0, 0.0]
    assert game.ghosts == [(here[0] + 3.0, here[1])]


def test_closing_speed_uses_the_time_passed() -> None:
    game = RobotView(house().assets, make_config("robot"))
    game.see_ghost(0, 2.0, 0.0, 0)
    looks = [(0.0, 0.0), (0.5, 0.1), (0.6, 0.12), (1.0, 0.15), (0.2, 0.2)]
    closing = [game.situation(Seen(time, (x, 0.0, 0.0), left=())).closing_speed[0] for time, x in looks]
    assert closing == pytest.approx([0.0, 0.2, 0.2, 0.1, 0.0])
    game.begin()
    assert game.situation(Seen(0.0, (0.5, 0.0, 0.0), left=())).closing_speed[0] == 0.0


def test_mask_lasts_for_one_decision() -> None:
    game = house()
    game.see_ghost(0, 2.0, 0.0, 0)
    left = game.assets.pellet_ids.tolist()
    seen = Seen(0.0, (0.0, 0.0, 0.0), left=left, masked={0, game.hold - 1}, pursued=2)
    situation = game.situation(seen)
    assert np.flatnonzero(~situation.mask[0]).tolist() == [0, game.hold - 1]
    assert situation.current[0] == 2
    assert game.situation(Seen(0.5, (0.0, 0.0, 0.0), left=left)).mask.all()


def test_candidates_have_places_on_the_map() -> None:
    game = house()
    x, y = game.assets.goal_xy[1].tolist()
    assert game.goal(1) == Place(1, x, y, int(game.assets.pellet_ids[1]))
    home = game.goal(game.assets.pellets)
    assert home is not None
    assert home.pellet is None
    assert game.goal(game.hold) is None
    assert not game.off_the_map(*game.assets.grid.home[:2])
    assert game.off_the_map(400.0, -400.0)


def test_rehearsal_leaves_nothing_behind() -> None:
    game = RobotView(house().assets, make_config("robot"))
    rehearsed = game.sample_situation()
    assert rehearsed.mask.all()
    assert game.unseen == ["clyde"]
    with pytest.raises(ValueError, match="clyde has not been seen yet"):
        game.situation(Seen(0.0, (0.0, 0.0, 0.0), left=()))
    make_policy("lookahead").select(rehearsed)
    game.see_ghost(0, 2.0, 0.0, 0)
    first = game.situation(Seen(0.0, (0.0, 0.0, 0.0), left=()))
    assert first.tick[0] == 0
    assert first.maps is rehearsed.maps
