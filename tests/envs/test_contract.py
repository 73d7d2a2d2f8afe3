"""Every environment keeps the contract, under arguments of which any two meet."""

import copy
import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.envs.infos import OUTCOMES
from pacman_env.observations.situation_writer import situation_of
from tests.envs.adapters import CASES, episodes, made, play
from tests.envs.cases import AXES, PAIRWISE, RANGES
from tests.envs.helpers import arrays, same

ROOT = Path(__file__).resolve().parents[2]
OVER = {"caught", "complete", "cleared"}


@pytest.fixture(scope="module")
def other_process() -> dict[str, str]:
    """Return the fingerprints of all cases as another process computes them."""
    code = "import json; from tests.envs.adapters import *; print(json.dumps({c: episodes(c) for c in CASES}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("case", CASES)
class TestEveryEnvironment:
    """What every environment promises, whatever its interface; what is particular to one is in its own test file."""

    def test_spaces_contain_observations_and_info_is_complete(self, case: str) -> None:
        adapter = made(case)
        config = adapter.core.config
        expected = {"outcome", "collected", "lost", "spawned", "aborts", "round_seed", "score", "ghosts_caught"}
        expected |= {"round"} if config.endless else set()
        expected |= {name.partition(".")[2] for name in RANGES if "randomize.speed_mps" in CASES[case][1]["settings"]}
        expected |= {"level"} if CASES[case][1]["map"] == "generated" else set()
        expected |= {"elapsed_s"} if config.decisions.when == "event" else set()
        seen = 0
        for result in [adapter.reset(seed=0), *play(adapter, 40, seed=1)]:
            for space, observation in adapter.observed(result):
                assert space.contains(observation)
                seen += 1
            for info in adapter.infos(result):
                assert expected - {"elapsed_s"} <= set(info) <= expected | {"action_mask"}
                if config.observation.numeric_info:
                    assert all(isinstance(value, (int, float, np.number)) for value in info.values())
        assert seen > 30

    def test_returned_data_never_changes(self, case: str) -> None:
        adapter = made(case)
        returned: list[Any] = [
            adapter.reset(seed=3),
            *play(adapter, 20, seed=1),
            situation_of(adapter.core.batch).arrays(),
        ]
        returned += [adapter.masks()]
        kept = copy.deepcopy(returned)
        play(adapter, 24, seed=2)
        adapter.reset(seed=7)
        assert same(returned, kept)
        every = [array for result in returned[:-2] for array in arrays(result)]
        assert len({array.__array_interface__["data"][0] for array in every}) == len(every) > 15
        assert all(array.flags.writeable for array in every)

    def test_seed_determines_episodes_regardless_of_history(self, case: str) -> None:
        fresh, used = made(case), made(case)
        used.reset(seed=9)
        play(used, 14, seed=3)
        first = [fresh.reset(seed=4), *play(fresh, 30, seed=1), fresh.reset()]
        assert same([used.reset(seed=4), *play(used, 30, seed=1), used.reset()], first)
        assert not same([used.reset(seed=5), *play(used, 30, seed=1)], first[:-1])

    def test_unseeded_environments_differ(self, case: str) -> None:
        one, other = made(case), made(case)
        assert not same([one.reset(), *play(one, 8, seed=0)], [other.reset(), *play(other, 8, seed=0)])

    def test_copies_continue_alike(self, case: str) -> None:
        adapter = made(case)
        adapter.reset(seed=2)
        play(adapter, 9, seed=3)
        twins = [copy.deepcopy(adapter), pickle.loads(pickle.dumps(adapter))]
        if adapter.env is adapter.core:  # wrappers have a state of their own
            twins.append(made(case))
            twins[-1].core.restore_state(adapter.core.clone_state())
        expected = [*play(adapter, 30, seed=5), adapter.reset()]
        for twin in twins:
            assert same([*play(twin, 30, seed=5), twin.reset()], expected)

    def test_other_process_plays_same_bits(self, case: str, other_process: dict[str, str]) -> None:
        assert episodes(case) == other_process[case]

    def test_bad_actions_are_refused_and_change_nothing(self, case: str) -> None:
        adapter, twin = made(case), made(case)
        for one in (adapter, twin):
            one.reset(seed=1)
        good = adapter.sample(np.random.default_rng(0))
        for bad in adapter.bad_actions(good):
            with pytest.raises(ValueError, match=r"action|choice|integers|velocities|number"):
                adapter.env.step(bad)
        assert same(adapter.advance(good), twin.advance(good))

    def test_step_is_refused_before_reset(self, case: str) -> None:
        adapter = made(case)
        with pytest.raises((gym.error.ResetNeeded, AssertionError), match="reset"):  # PettingZoo's wrapper: the latter
            adapter.env.step(adapter.sample(np.random.default_rng(0)))

    def test_masks_match_observations_and_forbid_collected(self, case: str) -> None:
        adapter = made(case)
        result = adapter.reset(seed=0)
        forbidden, rng = 0, np.random.default_rng(2)
        for _ in range(48 if adapter.masks() is not None else 0):
            masks = adapter.masks()
            assert masks.dtype == np.bool_
            assert masks[:, -1].all() or adapter.core.config.observation.candidates == "nearest"
            forbidden += int((~masks).sum())
            seen = [row for _, row in adapter.observed(result) if isinstance(row, dict) and "action_mask" in row]
            if len(seen) in (1, len(masks)):
                allowed = np.stack([one["action_mask"] for one in seen]).reshape(masks.shape)
                np.testing.assert_array_equal(masks, allowed == 1)
            if masks.shape[1] == adapter.core.batch.candidates:
                assert not (masks[:, : adapter.core.batch.pellet_slots] & ~adapter.core.batch.alive).any()
            masks[:] = False  # a copy: the environment does not notice
            assert adapter.masks().any()
            result = adapter.advance(adapter.sample(rng))[-1]
        assert forbidden > 0 or adapter.masks() is None or adapter.core.config.execution.on_abort != "back_off"

    def test_ends_are_terminations_or_truncations(self, case: str) -> None:
        adapter = made(case)
        adapter.reset(seed=1)
        over = OVER | ({"timeout"} if adapter.core.config.timeout == "termination" else set())
        ended = 0
        for result in play(adapter, 60, seed=4):
            for outcome, terminated, truncated in adapter.ends(result) if len(result) > 2 else ():
                outcome = outcome if isinstance(outcome, str) else OUTCOMES[outcome]
                assert (terminated, truncated) == (outcome in over, outcome == "timeout" and outcome not in over)
                ended += terminated or truncated
        assert ended > 0

    def test_pictures_show_every_game_and_change_nothing(self, case: str) -> None:
        plain, drawn = made(case), made(case, render_mode="rgb_array")
        for one in (plain, drawn):
            one.reset(seed=0)
        before = drawn.pictures()
        actions = plain.sample(np.random.default_rng(0))
        assert same(plain.advance(actions), drawn.advance(actions))
        after = drawn.pictures()
        assert len(before) == len(after) == drawn.games
        for one, other in zip(before, after, strict=True):
            assert one.dtype == np.uint8
            assert one.shape[::2] == (720, 3)
            assert one.shape != other.shape or (one != other).any()
        drawn.env.close()
        drawn.env.close()


def test_cases_combine_every_pair_of_values() -> None:
    for one in AXES:
        for other in AXES:
            met = {(str(row[one]), str(row[other])) for row in PAIRWISE}
            assert len(met) == (len(AXES[one]) * len(AXES[other]) if one != other else len(AXES[one]))
