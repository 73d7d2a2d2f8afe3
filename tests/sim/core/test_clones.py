"""Copies of running games go on as their originals do, or into futures of their own."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.game.execution import RUNNING
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.maps.level_source import FixedMap, GeneratedMaps

N = 8
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "wander": ("house", {}),
    "ghosts": ("house", {"clyde.ghosts": ("chase", "arcade", "wander", "policy"), "execution.death_radius_m": 1e-6}),
    "at walls": ("maze", {"action": "velocity", "clyde.speed_mps": 0.05}),
    "endless": ("house", {"endless": True, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6}),
    "generated": ("generated", {}),
    "goals that fail": ("house", {"nav2.abort_rate": 0.3}),
}


def make(case: str, n: int = N) -> GameBatch:
    source, changes = CASES[case]
    config = make_config("robot", **changes)
    levels = GeneratedMaps(config, 0, 5) if source == "generated" else FixedMap(map_assets(source, config), config)
    batch = GameBatch(levels, config, n)
    batch.reset(np.arange(n), np.arange(100, 100 + n, dtype=np.uint64))
    return batch


def like(batch: GameBatch, n: int) -> GameBatch:
    return GameBatch(batch.source, batch.config, n)


class Actions:
    """Random ones of a game's number and tick alone, each kept for 4 ticks."""

    def __init__(self, batch: GameBatch) -> None:
        self.velocity, self.hold, self.ghosts = batch.config.action == "velocity", batch.hold, batch.ghosts.shape[1]

    def of(self, numbers: list[int], tick: int) -> tuple[np.ndarray, np.ndarray]:
        chosen, ghosts = [], []
        for number in numbers:
            rng = np.random.default_rng((number, tick // 4))
            chosen.append(rng.uniform((0.0, -1.0), (0.3, 1.0)) if self.velocity else rng.integers(0, self.hold + 1))
            ghosts.append(rng.integers(0, self.hold + 1, self.ghosts))
        return np.array(chosen), np.array(ghosts)

    def play(self, batch: GameBatch, numbers: list[int], first: int, last: int) -> None:
        for tick in range(first, last):
            batch.step(*self.of(numbers, tick))


def everything(batch: GameBatch, game: int) -> dict[str, bytes]:
    """All that there is of a game, but for the place of its map."""
    names = [name for name in batch.games.dtype.names or () if name != "level"]
    found = {name: batch.games[name][game].tobytes() for name in names}
    found |= {f"ghosts.{name}": batch.ghosts[name][game].tobytes() for name in batch.ghosts.dtype.names or ()}
    row = batch.situation().rows(np.array([game]))
    found |= {f"seen.{name}": v.tobytes() for name, v in vars(row).items() if name not in ("maps", "threads", "level")}
    results = ("reward", "elapsed_s", "terminated", "truncated", "alive", "paths", "completed_s")
    return found | {name: getattr(batch, name)[game].tobytes() for name in results}


def differences(a: dict[str, bytes], b: dict[str, bytes]) -> list[str]:
    return [name for name in a if a[name] != b[name]]


@pytest.mark.parametrize("case", CASES)
def test_a_copy_goes_on_as_its_original_to_the_bit(case: str) -> None:
    batch = make(case)
    actions = Actions(batch)
    numbers = list(range(N))
    actions.play(batch, numbers, 0, 45)
    if case == "at walls":
        assert (batch.games["touch"] > 0).any()
    target = like(batch, 5)
    target.reset(np.arange(5), np.arange(5, dtype=np.uint64))
    actions.play(target, [20, 21, 22, 23, 24], 0, 7)
    copied, into = [6, 1, 3], [0, 4, 2]
    batch.clone_into(target, np.array(copied), np.array(into))
    apart = like(batch, 5)
    apart.reset(np.arange(5), np.arange(5, dtype=np.uint64))
    actions.play(apart, [20, 21, 22, 23, 24], 0, 7)
    for step in range(60):
        for number, game in zip(copied, into, strict=True):
            assert differences(everything(batch, number), everything(target, game)) == [], (step, number)
        for other in (1, 3):
            assert differences(everything(apart, other), everything(target, other)) == [], (step, other)
        batch.step(*actions.of(numbers, 45 + step))
        both = [actions.of([6, 21, 3, 23, 1], 45 + step), actions.of([20, 21, 22, 23, 24], 45 + step)]
        target.step(*both[0])
        apart.step(*both[1])


def test_copies_of_running_games_are_made_at_every_moment_also_at_walls() -> None:
    batch = make("at walls", 3)
    actions = Actions(batch)
    target = like(batch, 3)
    at_walls = 0
    for tick in range(0, 120, 3):
        actions.play(batch, [0, 1, 2], tick, tick + 3)
        at_walls += int((batch.games["touch"] > 0).sum())
        batch.clone_into(target, np.arange(3))
        ahead = pickle.loads(pickle.dumps(batch))
        actions.play(target, [0, 1, 2], tick + 3, tick + 8)
        actions.play(ahead, [0, 1, 2], tick + 3, tick + 8)
        for i in range(3):
            assert differences(everything(ahead, i), everything(target, i)) == [], (tick, i)
    assert at_walls > 20


def test_a_seed_of_its_own_gives_a_copy_another_future_and_the_same_seed_the_same() -> None:
    batch = make("ghosts")
    actions = Actions(batch)
    actions.play(batch, list(range(N)), 0, 20)
    target = like(batch, 4)
    seeds = np.array([7, 8, 7, 9], dtype=np.uint64)
    batch.clone_into(target, np.full(4, 2), reseed=seeds)
    before = [everything(target, i) for i in range(4)]
    drawn = {"seed", "localization_stream", "nav_stream", "ghosts.stream", "seen.seed"}
    for i in range(4):
        assert set(differences(everything(batch, 2), before[i])) <= drawn
    actions.play(target, [2] * 4, 20, 60)
    after = [everything(target, i) for i in range(4)]
    assert differences(after[0], after[2]) == []
    for a, b in ((0, 1), (0, 3), (1, 3)):
        assert "ghosts.x" in differences(after[a], after[b])


def test_a_pickle_of_copies_with_seeds_of_their_own_is_the_same_and_so_is_a_copy_of_it() -> None:
    batch = make("at walls", 2)
    actions = Actions(batch)
    actions.play(batch, [0, 1], 0, 30)
    middle, target = like(batch, 3), like(batch, 3)
    batch.clone_into(middle, np.array([0, 1, 1]), reseed=np.array([5, 6, 7], dtype=np.uint64))
    actions.play(middle, [0, 1, 2], 30, 70)
    assert (middle.games["touch"] > 0).any()
    middle.clone_into(target, np.arange(3), reseed=np.array([1, 2, 3], dtype=np.uint64))
    actions.play(target, [0, 1, 2], 70, 90)
    again = pickle.loads(pickle.dumps(target))
    for batch_ in (again, target):
        actions.play(batch_, [0, 1, 2], 90, 120)
    for i in range(3):
        assert differences(everything(target, i), everything(again, i)) == []


def test_games_are_copied_within_their_batch() -> None:
    batch = make("generated")
    actions = Actions(batch)
    actions.play(batch, list(range(N)), 0, 15)
    kept = [everything(batch, i) for i in range(N)]
    batch.clone_into(batch, np.array([0, 1]), np.array([1, 0]))
    assert differences(everything(batch, 0), kept[1]) == []
    assert differences(everything(batch, 1), kept[0]) == []
    for i in range(2, N):
        assert differences(everything(batch, i), kept[i]) == []


def test_a_round_that_follows_in_a_copy_is_drawn_from_its_own_seed() -> None:
    config = make_config("robot", endless=True, **{"execution.pickup_radius_m": 30.0})  # a round lasts a tick
    batch = a_batch(config, 1)
    target = like(batch, 2)
    batch.clone_into(target, np.zeros(2, dtype=np.int64), reseed=np.array([1, 2], dtype=np.uint64))
    target.step(np.full(2, target.hold))
    assert target.games["round"].tolist() == [2, 2]
    assert target.games["seed"][0] != target.games["seed"][1]
    again = pickle.loads(pickle.dumps(target))
    for one in (target, again):
        one.step(np.full(2, one.hold))
    for i in range(2):
        assert differences(everything(target, i), everything(again, i)) == []


def test_games_that_have_ended_are_copied_as_ended() -> None:
    batch = make("wander", 2)
    batch.games["tick"][0] = batch._parameters["ticks_max"][0] - 1
    Actions(batch).play(batch, [0, 1], 0, 2)
    target = like(batch, 1)
    batch.clone_into(target, np.array([0]))
    assert target.games["end"][0] == batch.games["end"][0] != RUNNING
    assert target.truncated[0]


def a_batch(config: Config, n: int = 2, begun: bool = True) -> GameBatch:
    batch = GameBatch(map_assets("house", config), config, n)
    if begun:
        batch.reset(np.arange(n), np.arange(n, dtype=np.uint64))
    return batch


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"games": [2]}, r"games\[0\] = 2: there are 2 games"),
        ({"games": [-1]}, r"games\[0\] = -1"),
        ({"games": [0, 1, 0]}, r"into\[2\] = 2: there are 2 games"),
        ({"games": [0, 1], "into": [1, 1]}, "a game is named twice"),
        ({"games": [0, 1], "into": [1]}, r"games of shape \(2,\) into \(1,\)"),
        ({"games": [0], "reseed": [1, 2]}, r"reseed of shape \(2,\)"),
    ],
)
def test_games_that_are_not_there_are_refused_and_nothing_is_changed(arguments: dict[str, Any], message: str) -> None:
    batch = a_batch(make_config("robot"))
    target = like(batch, 2)
    target.reset(np.arange(2), np.array([8, 9], dtype=np.uint64))
    before = [everything(target, i) for i in range(2)]
    with pytest.raises(ValueError, match=message):
        batch.clone_into(target, **{name: np.array(value) for name, value in arguments.items()})
    assert [everything(target, i) for i in range(2)] == before


def test_another_kind_of_target_or_a_game_that_has_not_begun_is_refused() -> None:
    config = make_config("robot")
    batch = a_batch(config)
    with pytest.raises(ValueError, match="another source of levels"):
        batch.clone_into(a_batch(config), np.array([0]))
    with pytest.raises(ValueError, match="another configuration"):
        batch.clone_into(a_batch(make_config("ideal")), np.array([0]))
    idle = a_batch(config, begun=False)
    with pytest.raises(ValueError, match="game 1 has not begun"):
        idle.clone_into(like(idle, 2), np.array([1]))
