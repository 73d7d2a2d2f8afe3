"""Copies of running games go on as their originals do, or into futures of their own."""

import pickle
from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.game.execution import RUNNING
from pacman_env.sim.core.batch import GameBatch
from tests.sim.players import differences, everything, new_batch

N = 8
POWER = {"power.pellets": 8, "power.return_s": 3.0, "execution.pickup_radius_m": 2.0, "execution.death_radius_m": 0.6}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "ghosts": ("house", {"clyde.ghosts": ("chase", "arcade", "wander", "policy"), "execution.death_radius_m": 1e-6}),
    "at walls": ("maze", {"action": "velocity", "clyde.speed_mps": 0.05}),
    "endless": ("house", {"endless": True, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6}),
    "generated": ("generated", {"nav2.abort_rate": 0.3}),
    "power": ("house", {"clyde.ghosts": ("chase", "arcade", "wander", "policy"), **POWER}),
}


def make(case: str, n: int = N) -> GameBatch:
    source, changes = CASES[case]
    return new_batch(make_config("robot", **changes), n, source, first_seed=100, levels=5)


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


@pytest.mark.parametrize("case", CASES)
def test_clone_continues_like_its_original(case: str) -> None:
    batch = make(case)
    actions = Actions(batch)
    numbers, others = list(range(N)), [20, 21, 22, 23, 24]
    actions.play(batch, numbers, 0, 45)
    if case == "at walls":
        assert (batch.games["touch"] > 0).any()
    if case == "power":
        assert (batch.obstacles[:, :, 3] > 45).any()
    target, apart = like(batch, 5), like(batch, 5)
    for one in (target, apart):
        one.reset(np.arange(5), np.arange(5, dtype=np.uint64))
        actions.play(one, others, 0, 7)
    copied, into = [6, 1, 3], [0, 4, 2]
    batch.clone_into(target, np.array(copied), np.array(into))
    for step in range(25):
        for number, game in zip(copied, into, strict=True):
            assert differences(everything(batch, number), everything(target, game)) == [], (step, number)
        for other in (1, 3):
            assert differences(everything(apart, other), everything(target, other)) == [], (step, other)
        actions.play(batch, numbers, 45 + step, 46 + step)
        actions.play(target, [6, 21, 3, 23, 1], 45 + step, 46 + step)
        actions.play(apart, others, 45 + step, 46 + step)


def test_new_seed_gives_a_clone_another_future() -> None:
    batch = make("ghosts")
    actions = Actions(batch)
    actions.play(batch, list(range(N)), 0, 20)
    target = like(batch, 4)
    seeds = np.array([7, 8, 7, 9], dtype=np.uint64)
    batch.clone_into(target, np.full(4, 2), reseed=seeds)
    before = [everything(target, i) for i in range(4)]
    drawn = {"seed", "localization_stream", "nav_stream", "ghosts.stream", *(f"seen{k}.seed" for k in range(-1, 4))}
    for i in range(4):
        assert set(differences(everything(batch, 2), before[i])) <= drawn
    actions.play(target, [2] * 4, 20, 60)
    after = [everything(target, i) for i in range(4)]
    assert differences(after[0], after[2]) == []
    for a, b in ((0, 1), (0, 3), (1, 3)):
        assert "ghosts.x" in differences(after[a], after[b])


def test_games_are_cloned_within_their_batch() -> None:
    batch = make("generated")
    actions = Actions(batch)
    actions.play(batch, list(range(N)), 0, 15)
    kept = [everything(batch, i) for i in range(N)]
    batch.clone_into(batch, np.array([0, 1]), np.array([1, 0]))
    assert differences(everything(batch, 0), kept[1]) == []
    assert differences(everything(batch, 1), kept[0]) == []
    for i in range(2, N):
        assert differences(everything(batch, i), kept[i]) == []


def test_next_round_of_clone_has_its_seed() -> None:
    config = make_config("robot", endless=True, **{"execution.pickup_radius_m": 30.0})  # a round lasts a tick
    batch = new_batch(config)
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


def test_ended_games_are_copied_as_ended() -> None:
    batch = new_batch(make_config("robot", time_limit_s=1.0), 2)
    for _ in range(2):
        batch.step(np.full(2, batch.hold))
    target = like(batch, 1)
    batch.clone_into(target, np.array([0]))
    assert target.games["end"][0] == batch.games["end"][0] != RUNNING
    assert target.truncated[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"games": [2]}, r"games\[0\] = 2: there are 2 games"),
        ({"games": [0, 1, 0]}, r"into\[2\] = 2: there are 2 games"),
        ({"games": [0, 1], "into": [1, 1]}, "a game is named twice"),
        ({"games": [0, 1], "into": [1]}, r"games of shape \(2,\) into \(1,\)"),
        ({"games": [0], "reseed": [1, 2]}, r"reseed of shape \(2,\)"),
    ],
)
def test_missing_games_are_refused_and_nothing_changes(arguments: dict[str, Any], message: str) -> None:
    batch = new_batch(make_config("robot"), 2)
    target = like(batch, 2)
    target.reset(np.arange(2), np.array([8, 9], dtype=np.uint64))
    before = [everything(target, i) for i in range(2)]
    with pytest.raises(ValueError, match=message):
        batch.clone_into(target, **{name: np.array(value) for name, value in arguments.items()})
    assert [everything(target, i) for i in range(2)] == before


def test_unlike_targets_and_idle_games_are_refused() -> None:
    config = make_config("robot")
    batch = new_batch(config, 2)
    with pytest.raises(ValueError, match="another source of levels"):
        batch.clone_into(new_batch(config, 2), np.array([0]))
    with pytest.raises(ValueError, match="another configuration"):
        batch.clone_into(new_batch(make_config("ideal"), 2), np.array([0]))
    idle = like(batch, 2)
    with pytest.raises(ValueError, match="game 1 has not begun"):
        idle.clone_into(like(idle, 2), np.array([1]))
