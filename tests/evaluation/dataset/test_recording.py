"""What is recorded is what was played: the rounds of the environment, one after the other."""

import numpy as np
import pytest

from pacman_env.envs.arguments import EnvArguments
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.evaluation.dataset.recording import (
    RecordedRounds,
    Recording,
    flattened,
    outcomes,
    record,
    round_seeds,
    tasks_of,
)
from pacman_env.policies.registry import make_policy

SHORT = {"time_limit_s": 40.0, "pellets.spacing_m": 3.0}
ENVIRONMENTS: dict[str, EnvArguments] = {
    "flat": EnvArguments("loop", flat=True, settings=SHORT),
    "features": EnvArguments("loop", settings=SHORT),
    "two-kinds": EnvArguments("loop", observation=("scan", "grid"), ghosts=("wander", "chase"), settings=SHORT),
    "mask-beside": EnvArguments("loop", flat=True, settings={**SHORT, "observation.mask": "beside"}),
    "levels": EnvArguments("generated", flat=True, settings={**SHORT, "num_levels": 2}),
    "power": EnvArguments("loop", flat=True, ghosts=("chase", "wander"), settings={**SHORT, "power.pellets": 2}),
    "endless": EnvArguments("loop", flat=True, settings={**SHORT, "endless": True, "execution.pickup_radius_m": 2.0}),
}


def equal(a: RecordedRounds, b: RecordedRounds) -> bool:
    arrays = (
        *((getattr(a, name), getattr(b, name)) for name in ("rounds", "masks", "actions", "rewards", "elapsed_s")),
        *((a.observations[key], b.observations[key]) for key in a.observations),
    )
    return all(np.array_equal(one, other) for one, other in arrays)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_recorded_round_equals_round_of_single_environment(name: str) -> None:
    arguments, seeds = ENVIRONMENTS[name], round_seeds(3, 5)
    played = record(Recording("nearest", arguments, seeds))
    assert (played.rounds["seed"] == seeds).all()
    assert played.rounds["decisions"].sum() == len(played.actions) == len(played.masks) - len(seeds)
    fields = ("map", "ghosts", "observation", "settings", "flat")
    env = PacManBotEnv(**{name: getattr(arguments, name) for name in fields})
    for number, (decisions, looks) in enumerate(played.slices()):
        about, policy = played.rounds[number], make_policy("nearest")
        observation, info = env.reset(options={"round_seed": int(about["seed"])})
        policy.reset(np.ones(1, np.bool_), env.config)
        seen, rewards, over = [flattened(observation)], [], False
        for k in range(decisions.start, decisions.stop):
            assert not over
            assert (env.action_masks() == played.masks[looks][k - decisions.start]).all()
            assert env.action_of(policy.select(env.situation))[0] == played.actions[k]
            observation, reward, terminated, truncated, info = env.step(int(played.actions[k]))
            assert (terminated, truncated) == (played.terminated[k], played.truncated[k])
            over = terminated or truncated
            seen.append(flattened(observation))
            rewards.append(reward)
        assert over
        np.testing.assert_array_equal(rewards, played.rewards[decisions])
        assert about["return"] == pytest.approx(sum(rewards))
        for key, array in played.observations.items():
            np.testing.assert_array_equal(np.stack([one[key] for one in seen]), array[looks])
            assert array.dtype == seen[0][key].dtype
        numeric = env.config.observation.numeric_info
        assert (int(about["outcome"]) if numeric else outcomes(played.rounds)[number]) == info["outcome"]
        assert about["level"] == info.get("level", 0)
        assert about["collected"] == info["collected"] or "round" in info


def test_rounds_are_same_when_recorded_together_or_alone() -> None:
    arguments, seeds = ENVIRONMENTS["flat"], round_seeds(0, 80)
    together = record(Recording("random_pellet", arguments, seeds))
    assert (together.rounds["seed"] == seeds).all()
    some = [0, 41, 79]
    for number, (decisions, looks) in enumerate(together.slices()):
        if number in some:
            alone = record(Recording("random_pellet", arguments, seeds[number : number + 1]))
            np.testing.assert_array_equal(alone.actions, together.actions[decisions])
            np.testing.assert_array_equal(alone.observations[""], together.observations[""][looks])


def test_rounds_of_level_are_adjacent_in_small_tasks() -> None:
    arguments = EnvArguments("generated", flat=True, settings={**SHORT, "num_levels": 3})
    seeds = round_seeds(0, 1100)
    tasks = tasks_of("nearest", arguments, seeds)
    assert [len(task.seeds) for task in tasks] == [500, 500, 100]
    in_order = np.concatenate([task.seeds for task in tasks])
    assert sorted(in_order) == sorted(seeds)
    config, _ = arguments.make_config()
    levels = arguments.make_source(config).levels_of(in_order)
    assert (np.diff(levels) >= 0).all()
    assert set(levels.tolist()) == {0, 1, 2}


def test_unlisted_choices_are_counted_and_become_hold() -> None:
    few = EnvArguments("loop", flat=True, settings={**SHORT, "observation.nearest_pellets": 1})
    every = EnvArguments("loop", flat=True, settings={**SHORT, "observation.candidates": "all"})
    listed, whole = (record(Recording("lookahead", one, round_seeds(0, 8))) for one in (few, every))
    assert listed.rounds["unlisted"].sum() > 0
    assert (listed.actions == listed.masks.shape[1] - 1).sum() >= listed.rounds["unlisted"].sum()
    assert whole.rounds["unlisted"].sum() == 0
