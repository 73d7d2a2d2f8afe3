"""What the single environment promises to its users."""

from __future__ import annotations

import copy
import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.policies.registry import make_policy
from pacman_env.sim.maps import assets
from pacman_env.world.maps.occupancy import MapError, load_map, shipped_maps
from tests.calls import calls_of
from tests.envs.helpers import ID, QUICK, arrays, make, same

MAPS = Path(__file__).resolve().parents[2] / "maps"
Step = tuple[Any, float, bool, bool, dict[str, Any]]


def random_play(env: gym.Env, steps: int, seed: int, first: int | None = 5) -> list[Any]:
    """Results of ``steps`` steps with random actions, each held for five, and of the resets between."""
    rng = np.random.default_rng(seed)
    results: list[Any] = [env.reset(seed=first)]
    action = 0
    for k in range(steps):
        if k % 5 == 0:
            action = int(rng.integers(env.action_space.n))  # type: ignore[attr-defined]
        results.append(env.step(action))
        if results[-1][2] or results[-1][3]:
            results.append(env.reset())
    return results


def play_round(env: PacManBotEnv, policy_name: str, seed: int | None = None) -> list[Step]:
    """One round with a policy of the package."""
    policy = make_policy(policy_name)
    policy.reset(np.ones(1, dtype=np.bool_), env.config)
    env.reset(seed=seed)
    steps: list[Step] = []
    while not steps or not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(int(policy.select(env.situation)[0])))
    return steps


# --- making


def test_make_takes_a_map_and_a_preset() -> None:
    env = make(map="maze", preset="ideal", settings={"execution.rules": "as_built"})
    assert env.batch.assets.occupancy.name == "maze"
    assert env.config == make_config("ideal", "as_built")
    assert env.action_space == gym.spaces.Discrete(env.batch.assets.pellets + env.batch.assets.refuges + 1)


def test_a_map_made_again_is_not_prepared_again(monkeypatch: pytest.MonkeyPatch) -> None:
    first = gym.make(ID, map="house").unwrapped
    monkeypatch.setattr(assets, "_build", lambda *arguments: pytest.fail("prepared again"))
    assert calls_of(lambda: gym.make(ID, map="house")) < 25_000  # most of them to read the map's YAML file
    assert gym.make(ID, map="house").unwrapped.batch.assets is first.batch.assets


@pytest.mark.parametrize("source", [str, Path, load_map], ids=["string", "path", "loaded"])
def test_a_map_is_the_same_by_name_by_file_and_loaded(source: Callable[[Path], Any]) -> None:
    named = random_play(make(map="loop"), 30, seed=1)
    other = random_play(make(map=source(MAPS / "loop.yaml")), 30, seed=1)
    assert same(named, other)


def test_an_unknown_map_gets_the_list_of_shipped_ones() -> None:
    with pytest.raises(MapError, match=f"nowhere.*{', '.join(shipped_maps())}"):
        make(map="nowhere")


def test_settings_and_config_say_the_same() -> None:
    config = make_config("ideal", "as_built", **QUICK)
    by_config = make(settings=config)
    by_settings = make(preset="ideal", settings={**QUICK, "execution.rules": "as_built"})
    assert by_config.config == by_settings.config == config
    assert same(random_play(by_config, 40, seed=1), random_play(by_settings, 40, seed=1))


@pytest.mark.parametrize(
    "also", [{"observation": "scan"}, {"preset": "ideal"}, {"ghosts": 2}, {"action": "velocity"}, {"flat": True}]
)
def test_a_config_with_anything_that_it_replaces_is_refused(also: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="settings is a Config"):
        make(settings=Config(), **also)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"settings": {"clyde.spede_mps": 0.3}}, r"clyde\.spede_mps"),
        ({"settings": {"ghost.speed_mps": 0.3}}, r"ghost\.speed_mps"),
        ({"settings": {"clyde.speed_mps": -1.0}}, r"clyde\.speed_mps = -1\.0"),
        ({"settings": {"max_pellets": 2}}, "max_pellets = 2: the map has 13"),
        ({"preset": "real"}, "unknown preset 'real'.*ideal.*robot"),
        ({"settings": {"execution.rules": "fast"}}, "unknown execution 'fast'.*as_built.*robust"),
    ],
)
def test_an_argument_that_cannot_be_played_is_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make(**arguments)


def test_an_unknown_render_mode_is_named_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'ansi'.*rgb_array.*human"):
        PacManBotEnv(render_mode="ansi")


def test_the_round_begins_at_the_home_pose_given() -> None:
    x, y = make().batch.assets.cell_xy[100].tolist()
    env = make(preset="ideal", settings={"home": (x, y, 1.5)})
    robot = env.reset(seed=0)[0]["robot"]
    np.testing.assert_allclose(robot[:4], [x, y, np.cos(1.5), np.sin(1.5)], atol=1e-6)
    with pytest.raises(MapError, match=r"home pose \(100\.0, 0\.0\)"):
        make(settings={"home": (100.0, 0.0, 0.0)})


# --- actions


@pytest.mark.parametrize("why", ["padding", "collected", "waits after an abort"])
def test_a_forbidden_candidate_makes_the_robot_hold(why: str) -> None:
    settings = {**QUICK, "clyde.speed_mps": 0.0, "execution.death_radius_m": 0.1, "max_pellets": 6}
    if why == "waits after an abort":
        settings["nav2.abort_rate"] = 1.0
    forbidding, holding = (make(settings=settings) for _ in range(2))
    for env in (forbidding, holding):
        env.reset(seed=2)
    goal = int(forbidding.situation.path_robot[0, :4].argmin())
    # towards it until it is forbidden; padding: under way, so that holding shows
    while forbidding.action_masks()[goal] and not (why == "padding" and forbidding.situation.tick[0] == 3):
        assert same(forbidding.step(goal), holding.step(goal))
    forbidden = 5 if why == "padding" else goal
    hold = int(forbidding.action_space.n) - 1
    for k in range(6):
        assert not forbidding.action_masks()[forbidden]
        result = forbidding.step(forbidden)
        assert same(result, holding.step(hold)), k
    assert result[0]["robot"][4] == 0.0
    assert forbidding.situation.current[0] == -1


@pytest.mark.parametrize("kind", [int, np.int64, np.int32, np.uint8, np.array])
def test_any_integer_type_is_an_action(kind: Callable[[int], Any]) -> None:
    plain, other = make(), make()
    plain.reset(seed=1)
    other.reset(seed=1)
    for _ in range(5):
        assert same(plain.step(3), other.step(kind(3)))


@pytest.mark.parametrize("action", [-1, 24, 2**40, 1.0, "1", None, np.array([1]), np.array(1.0), [1]])
def test_what_is_no_action_is_named_and_changes_nothing(action: Any) -> None:
    env, twin = make(), make()
    env.reset(seed=1)
    twin.reset(seed=1)
    assert env.action_space.n == 24
    with pytest.raises(ValueError, match=f"{re.escape(repr(action))} is not in Discrete"):
        env.step(action)
    assert same(env.step(1), twin.step(1))


def test_nothing_can_be_asked_before_the_first_reset() -> None:
    env = make()
    for ask in (lambda: env.step(0), env.action_masks, lambda: env.situation):
        with pytest.raises(gym.error.ResetNeeded):
            ask()


# --- observations


@pytest.mark.parametrize("execution", ["robust", "as_built"])
@pytest.mark.parametrize("name", shipped_maps())
def test_observations_stay_inside_the_space(name: str, execution: str) -> None:
    env = make(map=name, settings={"time_limit_s": 60.0, "execution.rules": execution})
    for result in random_play(env, 300, seed=4):
        observation = result[0]
        assert env.observation_space.contains(observation), {
            key: (value, env.observation_space[key]) for key, value in observation.items()
        }
        assert all(np.isfinite(array).all() for array in observation.values())
        assert observation["action_mask"][-1] == 1


def test_what_was_returned_is_never_changed_later() -> None:
    env = make(settings=QUICK)
    returned = random_play(env, 50, seed=3)
    kept = copy.deepcopy(returned)
    random_play(env, 50, seed=4, first=None)
    assert same(returned, kept)
    all_arrays = [array for result in returned for array in arrays(result)]
    # each array is memory of its own, so that changing one leaves all others alone
    starts = [array.__array_interface__["data"][0] for array in all_arrays]
    assert len(set(starts)) == len(all_arrays) > 250


def test_action_masks_are_those_of_the_observation() -> None:
    env = make(settings={**QUICK, "nav2.abort_rate": 0.3})
    forbidden = 0
    for k in range(100):
        if k % 36 == 0:
            observation, _ = env.reset(seed=k)
        masks = env.action_masks()
        assert masks.dtype == np.bool_
        np.testing.assert_array_equal(masks, observation["action_mask"] == 1)
        forbidden += (~masks).sum()
        masks[:] = False  # a copy: the environment does not notice
        assert env.action_masks().any()
        observation, _, terminated, *_ = env.step(k % 4)
        if terminated:
            observation, _ = env.reset()
    assert forbidden > 0


def test_slots_beyond_the_maps_pellets_change_nothing_but_the_shape() -> None:
    plain, padded = make(), make(settings={"max_pellets": 20})
    first, second = plain.reset(seed=3)[0], padded.reset(seed=3)[0]
    for k in range(40):
        keep = np.r_[0:13, 20 : padded.action_space.n]
        np.testing.assert_array_equal(second["candidates"][keep], first["candidates"])
        np.testing.assert_array_equal(second["action_mask"][keep], first["action_mask"])
        np.testing.assert_array_equal(second["candidates"][13:20], np.eye(10)[np.zeros(7, dtype=int)])
        assert not second["action_mask"][13:20].any()
        goal = k // 10 % 13
        first, second = plain.step(goal)[0], padded.step(goal)[0]
        for key in ("robot", "clyde", "round"):
            np.testing.assert_array_equal(first[key], second[key])


# --- seeds


def test_a_seed_makes_the_trajectory_and_another_seed_another() -> None:
    plays = [random_play(make(settings=QUICK), 60, seed=0, first=seed) for seed in (1, 1, 2)]
    assert same(plays[0], plays[1])
    assert not same(plays[0], plays[2])


def test_reset_without_a_seed_continues_the_generator() -> None:
    def rounds(steps_between: int) -> list[Any]:
        env = make()
        results = [env.reset(seed=8)]
        for _ in range(3):
            for _ in range(steps_between):
                env.step(0)
            results.append(env.reset())
        return results

    quiet, busy = rounds(0), rounds(5)
    assert same(quiet, busy)
    assert len({info["round_seed"] for _, info in quiet}) == 4
    assert same(make().reset(seed=8), quiet[0])


def test_reset_without_any_seed_is_random() -> None:
    assert make().reset()[1]["round_seed"] != make().reset()[1]["round_seed"]


# --- rewards and ends


@pytest.mark.parametrize("policy", ["nearest", "clyde_aware"])
@pytest.mark.parametrize(("execution", "more"), [("robust", {}), ("as_built", {"nav2.abort_rate": 0.3})])
def test_rewards_and_ends_are_as_documented(execution: str, more: dict[str, float], policy: str) -> None:
    env = make(settings={**QUICK, **more, "execution.rules": execution})
    config, ends = env.config, set()
    end_reward = {"caught": config.reward.death, "complete": config.reward.completion, "timeout": config.reward.timeout}
    for seed in range(40):
        before = 0
        steps = play_round(env, policy, seed)
        for observation, reward, terminated, truncated, info in steps:
            outcome, gained = info["outcome"], info["collected"] - before
            expected = config.reward.tick + gained * config.reward.pellet + end_reward.get(outcome, 0.0)
            assert reward == pytest.approx(expected, abs=1e-12)
            assert type(reward) is float
            assert (terminated, truncated) == (outcome in ("caught", "complete", "cleared"), outcome == "timeout")
            before = info["collected"]
            gone = info["collected"] + info["lost"]
            assert observation["round"][1] <= info["spawned"] - gone
            assert info["lost"] <= info["aborts"]
        ends.add(outcome)
        assert info["spawned"] == 4
        total = sum(step[1] for step in steps)
        ticks = len(steps) * config.reward.tick
        assert total == pytest.approx(ticks + info["collected"] * config.reward.pellet + end_reward.get(outcome, 0.0))
        if outcome == "caught":
            assert observation["clyde"][4] <= config.execution.death_radius_m + 1e-6
        else:
            if outcome == "timeout":  # the last pellet completes the round, however near Clyde is
                assert observation["clyde"][4] > config.execution.death_radius_m - 1e-6
            assert (gone == 4) == (outcome != "timeout")
            assert (outcome == "cleared") == (gone == 4 and info["lost"] > 0)
        assert (len(steps) == 36) >= (outcome == "timeout")
    assert len(ends) >= 3, ends
    assert ("cleared" in ends) == (execution == "as_built")


def test_an_episode_that_is_over_has_to_be_reset() -> None:
    env, seen = make(settings={**QUICK, "time_limit_s": 17.0}), set()
    for seed in range(30):
        *_, info = play_round(env, "nearest", seed)[-1]
        seen.add(info["outcome"])
        for _ in range(2):
            with pytest.raises(gym.error.ResetNeeded, match="the episode is over: call reset"):
                env.step(0)
    assert seen == {"caught", "complete", "timeout"}


def test_a_pellet_reached_after_the_time_limit_does_not_count() -> None:
    settings = {"time_limit_s": 5.0, "clyde.speed_mps": 0.0}
    env = PacManBotVectorEnv(1, preset="ideal", settings=settings, autoreset_mode="Disabled")  # may be stepped on
    env.reset(seed=0)
    distance = env.situation.path_robot[0, : env.batch.pellet_slots]
    goal = int(np.where(distance > 2.0, distance, np.inf).argmin())
    infos = [env.step(np.array([goal]))[4] for _ in range(50)]
    assert infos[9]["outcome"] == "timeout"
    assert infos[49] == infos[9]


@pytest.mark.parametrize(("limit", "ticks"), [(0.5, 1), (7.0, 14), (30.0, 60)])
def test_the_time_limit_is_obeyed(limit: float, ticks: int) -> None:
    env = make(settings={"time_limit_s": limit, "clyde.speed_mps": 0.0})
    env.reset(seed=0)
    hold = int(env.action_space.n) - 1
    results = [env.step(hold) for _ in range(ticks)]
    assert [r[3] for r in results] == [False] * (ticks - 1) + [True]
    assert not any(r[2] for r in results)
    assert results[-1][0]["round"][0] == limit
    assert results[-1][4]["outcome"] == "timeout"


# --- pictures


def test_pictures_are_rgb_and_follow_the_game() -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    pictures = [env.render()]
    for _ in range(3):
        env.step(0)
        pictures.append(env.render())
    for picture in pictures:
        assert picture is not None
        assert picture.dtype == np.uint8
        assert picture.shape[0] == 720
        assert picture.shape[2] == 3
    for first, second in itertools.pairwise(pictures):
        assert not np.array_equal(first, second)


def test_rendering_does_not_change_the_game() -> None:
    plain, drawn = make(), make(render_mode="rgb_array")
    plain.reset(seed=0)
    drawn.reset(seed=0)
    for _ in range(4):
        drawn.render()
        assert same(plain.step(2), drawn.step(2))


def test_render_without_a_mode_says_how_to_get_one() -> None:
    env = make()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None


def test_human_mode_shows_a_window_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    env = make(render_mode="human")
    env.reset(seed=0)
    assert env.render() is None
    assert pygame.display.get_surface().get_height() == 720
    env.close()
    env.close()
    assert not pygame.display.get_init()
