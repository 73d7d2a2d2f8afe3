"""What is particular to the environment with one agent; the rest is in the contract."""

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pettingzoo_env import parallel_env
from pacman_env.policies.registry import make_policy
from pacman_env.world.maps.occupancy import load_map
from tests.envs.helpers import QUICK, make, same

MAPS = Path(__file__).resolve().parents[2] / "maps"
Step = tuple[Any, float, bool, bool, dict[str, Any]]


def play_round(env: PacManBotEnv, policy_name: str, seed: int | None = None) -> list[Step]:
    """Play one round with a built-in policy."""
    policy = make_policy(policy_name)
    policy.reset(np.ones(1, dtype=np.bool_), env.config)
    env.reset(seed=seed)
    steps: list[Step] = []
    while not steps or not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(int(policy.select(env.situation)[0])))
    return steps


@pytest.mark.parametrize("source", [str, Path, load_map], ids=["string", "path", "loaded"])
def test_map_may_be_a_name_file_or_object(source: Callable[[Path], Any]) -> None:
    other = make(map=source(MAPS / "loop.yaml"))
    assert same(play_round(make(map="loop"), "nearest", 1), play_round(other, "nearest", 1))


def test_round_begins_at_configured_home() -> None:
    x, y = make().batch.assets.cell_xy[100].tolist()
    env = make(preset="ideal", settings={"home": (x, y, 1.5)})
    robot = env.reset(seed=0)[0]["robot"]
    np.testing.assert_allclose(robot[:4], [x, y, np.cos(1.5), np.sin(1.5)], atol=1e-6)


@pytest.mark.parametrize(("execution", "more"), [("robust", {}), ("as_built", {"nav2.abort_rate": 0.3})])
def test_rewards_and_ends_are_as_documented(execution: str, more: dict[str, float]) -> None:
    env = make(settings={**QUICK, **more, "execution.rules": execution})
    config, ends = env.config, set()
    end_reward = {"caught": config.reward.death, "complete": config.reward.completion, "timeout": config.reward.timeout}
    for seed in range(60):
        before = 0
        steps = play_round(env, "nearest" if seed % 2 else "clyde_aware", seed)
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
        if outcome == "caught":
            assert observation["clyde"][4] <= config.execution.death_radius_m + 1e-6
        else:
            if outcome == "timeout":  # the last pellet completes the round, however near Clyde is
                assert observation["clyde"][4] > config.execution.death_radius_m - 1e-6
            assert (gone == 4) == (outcome != "timeout")
            assert (outcome == "cleared") == (gone == 4 and info["lost"] > 0)
        assert (len(steps) == 36) >= (outcome == "timeout")
        with pytest.raises(gym.error.ResetNeeded, match="the episode is over: call reset"):
            env.step(0)
    assert len(ends) >= 3, ends
    assert ("cleared" in ends) == (execution == "as_built")


def test_render_without_mode_warns() -> None:
    env = make()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None


def test_docstring_lists_keys_infos_and_arguments() -> None:
    """Columns are on a generated page, ``tests/tools/test_reference.py``."""
    text = PacManBotEnv.__doc__ or ""
    env = make(ghosts=3, observation=("features", "scan", "grid"), settings={"power.pellets": 1})
    letters = {"C": env.action_space.n, "G": 3, "K": 4, "R": 360, "S": 64}
    shapes = dict(re.findall(r"\| `(\w+)` \| (\([^)]*\)) \|", text))
    for key, space in env.observation_space.items():
        assert eval(shapes.pop(key), letters) == space.shape
    assert shapes == {}
    infos = text.split("## Information")[1].split("##")[0]
    settings = {"randomize.speed_mps": (0.2, 0.3), "num_levels": 1, "endless": True}
    _, info = make(map="generated", settings=settings).reset(seed=0)
    assert all(f"`{name}`" in infos for name in info)
    arguments = set(inspect.signature(PacManBotEnv.__init__).parameters) - {"self"}
    assert set(re.findall(r"^ *- `(\w+)`:", text.split("## Arguments")[1].split("## ")[0], re.MULTILINE)) == arguments
    call = re.search(r"```py\n(.*?)```", text, re.DOTALL)
    assert call
    assert eval(call[1].strip(), {"gymnasium": gym}).unwrapped.config == make_config(**{"clyde.speed_mps": 0.35})


@pytest.mark.parametrize("several", [False, True])
def test_human_mode_shows_every_step_and_closes(several: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env: Any = parallel_env(render_mode="human") if several else make(render_mode="human")
    env.reset(seed=0)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    assert shown.shape[1] == 720
    assert env.render() is None
    env.step({"pacman": 0, "clyde": 0} if several else 0)
    assert (pygame.surfarray.array3d(pygame.display.get_surface()) != shown).any()
    env.close()
    env.close()
    assert not pygame.display.get_init()
