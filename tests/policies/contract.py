"""What every policy promises: inherit ``PolicyContract``, say how the policy is made, done."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.levels.assets import map_assets
from pacman_env.levels.level import Level
from pacman_env.levels.level_slots import LevelSlots
from pacman_env.observations.situation import HOLD, PELLET, REFUGE, Situation
from pacman_env.policies.base import Policy


@cache
def house() -> LevelSlots:
    config = make_config()
    return LevelSlots.only(Level.of(map_assets("house", config), config), config)


def random_situation(seed: int, games: int, pellets: int = 13, refuges: int = 10, allowed: float = 0.7) -> Situation:
    """Situations on a plain without walls, near enough to Clyde that every rule matters.

    For policies that plan on maps they lie in ``house``, where candidates are goals drawn at random.
    """
    rng = np.random.default_rng(seed)
    candidates = pellets + refuges + 1
    kind = np.array([PELLET] * pellets + [REFUGE] * refuges + [HOLD], np.int8)
    robot = np.column_stack((rng.uniform(-4, 4, (games, 2)), rng.uniform(-np.pi, np.pi, games)))
    clyde = robot[:, :2] + rng.uniform(-3, 3, (games, 2))
    position = rng.uniform(-5, 5, (games, candidates, 2))
    position[:, -1] = robot[:, :2]
    mask = rng.random((games, candidates)) < allowed
    mask[:, -1] = True
    assets = house().level(0).assets
    goal = rng.integers(0, assets.pellets + assets.refuges, (games, candidates)).astype(np.int32)
    goal[:, -1] = -1
    return Situation(
        time_s=rng.uniform(0, 300, games),
        robot=robot,
        robot_velocity=rng.uniform(-0.3, 0.3, (games, 2)),
        pose_age_s=rng.uniform(0, 1, games),
        clyde=clyde,
        clyde_velocity=rng.uniform(-0.3, 0.3, (games, 2)),
        clyde_speed=np.full(games, 0.25),
        closing_speed=rng.uniform(-0.2, 0.2, games),
        kind=np.tile(kind, (games, 1)),
        position=position,
        mask=mask,
        path_robot=1.2 * np.hypot(*np.moveaxis(position - robot[:, None, :2], -1, 0)),
        path_clyde=1.2 * np.hypot(*np.moveaxis(position - clyde[:, None], -1, 0)),
        current=rng.integers(-1, candidates, games),
        seed=rng.integers(0, 2**64, games, np.uint64, endpoint=False),
        tick=rng.integers(0, 1000, games),
        ghosts=rng.uniform(-5.0, 5.0, (games, 1, 5)),
        fright=np.zeros((games, 1, 3)),
        is_power=np.zeros((games, candidates), np.bool_),
        belief=rng.dirichlet(np.ones(4), (games, 1)),
        goal=goal,
        level=np.zeros(games, np.int32),
        maps=house(),
        pellets_left=(kind == PELLET).sum() * np.ones(games, np.int64),
    )


def copy(situation: Situation) -> Situation:
    arrays = {f.name: getattr(situation, f.name) for f in fields(situation) if f.name not in ("maps", "threads")}
    return Situation(**{name: array.copy() for name, array in arrays.items()}, maps=situation.maps)


class PolicyContract:
    """Inherit and give ``make``; ``config`` is what the games are played by."""

    config = make_config()

    def make(self) -> Policy:
        raise NotImplementedError

    def fresh(self, games: int) -> Policy:
        policy = self.make()
        policy.reset(np.ones(games, np.bool_), self.config)
        return policy

    @pytest.mark.parametrize("allowed", [0.3, 0.0])  # 0.0: hold alone
    def test_goal_is_allowed_and_has_a_score(self, allowed: float) -> None:
        situation = random_situation(3, 100, allowed=allowed)
        policy, games = self.fresh(100), np.arange(100)
        scores = policy.scores(situation)
        assert scores.shape == situation.mask.shape
        assert not np.isnan(scores).any()
        assert not (scores == np.inf).any()
        goal = policy.select(situation)
        assert (goal.shape, goal.dtype) == ((100,), np.int64)
        assert situation.mask[games, goal].all()
        assert ((scores[games, goal] > -np.inf) | (situation.kind[games, goal] == HOLD)).all()

    def test_reset_of_some_games_leaves_others_alone(self) -> None:
        some, kept, fresh = self.fresh(20), self.fresh(20), self.fresh(20)
        before, after = random_situation(7, 20), random_situation(8, 20)
        games = np.arange(20) % 2 == 0
        some.select(before)
        kept.select(before)
        some.reset(games, self.config)
        expected = np.where(games, fresh.select(after), kept.select(after))
        np.testing.assert_array_equal(some.select(after), expected)

    def test_batch_gives_what_single_games_give(self) -> None:
        sequence = [random_situation(seed, 20) for seed in range(3)]
        batch = self.fresh(20)
        singles = [self.fresh(1) for _ in range(20)]
        for situation in sequence:
            goals, scores = batch.select(situation), batch.scores(situation)
            for game, single in enumerate(singles):
                row = situation.rows(slice(game, game + 1))
                assert single.select(row)[0] == goals[game]
                np.testing.assert_array_equal(single.scores(row)[0], scores[game])

    def test_scores_and_reasons_change_neither_answer_nor_situation(self) -> None:
        asked, silent = self.fresh(20), self.fresh(20)
        for seed in (11, 12):
            situation = random_situation(seed, 20)
            before = copy(situation)
            asked.scores(situation)
            asked.explain(situation)
            np.testing.assert_array_equal(asked.select(situation), silent.select(before))
            for f in (f for f in fields(situation) if f.name != "maps"):
                np.testing.assert_array_equal(getattr(situation, f.name), getattr(before, f.name))

    def test_reasons_cover_candidates_and_agree_with_scores(self) -> None:
        situation = random_situation(13, 5)
        policy = self.fresh(5)
        reasons = policy.explain(situation)
        assert [len(row) for row in reasons] == [situation.mask.shape[1]] * 5
        explained = [[candidate["score"] for candidate in row] for row in reasons]
        np.testing.assert_array_equal(explained, policy.scores(situation))
        names = {PELLET: "pellet", REFUGE: "refuge", HOLD: "hold"}
        for row, kinds, mask in zip(reasons, situation.kind, situation.mask, strict=True):
            assert [c["kind"] for c in row] == [names[int(k)] for k in kinds]
            assert [c["allowed"] for c in row] == mask.tolist()

    def test_looks_of_masked_candidates_do_not_matter(self) -> None:
        situation = random_situation(14, 20, allowed=0.5)
        position, path = situation.position.copy(), situation.path_robot.copy()
        position[~situation.mask] += 100.0
        path[~situation.mask] = np.inf
        changed = replace(situation, position=position, path_robot=path)
        np.testing.assert_array_equal(self.fresh(20).select(situation), self.fresh(20).select(changed))
