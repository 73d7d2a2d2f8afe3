"""``pacman-env warm-up``: afterwards ordinary use compiles nothing, and the command itself does nothing twice."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

from pacman_env.cli import warm_up
from pacman_env.cli.main import main
from pacman_env.engine import cache_folder

ROOT = Path(__file__).resolve().parents[2]
#: Prints the kernels that games need which are none of those that the command plays.
OTHERS = """
import copy, sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from pacman_env.cli.warm_up import PARTS, ROBOT_PARTS
from pacman_env.config import make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from pacman_env.policies.registry import make_policy

def compiled():
    modules = [module for name, module in sys.modules.items() if name.startswith("pacman_env.")]
    kernels = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    return {f"{kernel.__name__} {hash(signature)}" for kernel in kernels for signature in kernel.signatures}

for work in PARTS.values():
    work()
before = compiled()
AS_BUILT = {"execution.rules": "as_built"}
NUMBERS = {"observation.numeric_info": True, "timeout": "termination"}
HOUSES = {"num_levels": 1, "observation.normalize": True, "observation.mask": "info"}
FLAT = {"observation.candidates": "nearest", "decisions.when": "event", "observation.mask": "beside"}
games = [
    dict(
        map="loop", preset="ideal", settings=AS_BUILT | {"endless": True}, ghosts=4, observation=("features", "flat")
    ),
    dict(map="generated:test", settings=HOUSES, observation=("scan", "planner")),
    dict(settings=FLAT | {"randomize.speed_mps": (0.2, 0.3)}),
    dict(action="velocity", observation="grid", map="maze", ghosts=("chase", "arcade")),
    dict(ghosts=("wander", make_policy("lookahead")), settings=NUMBERS),
]
for arguments in games:
    for env in (PacManBotEnv(**arguments), PacManBotVectorEnv(3, **arguments)):
        env.reset(seed=1)
        for _ in range(30):
            velocity = arguments.get("action") == "velocity"
            env.step(env.action_space.sample() if velocity else env.action_masks().argmax(axis=-1))
        copy.deepcopy(env).step(env.action_space.sample())
envs = PacManBotVectorEnv(3)
envs.reset(seed=1)
for name in ("clyde_aware", "lookahead", "nearest", "ppo", "random", "random_pellet"):
    policy = make_policy(name)
    policy.reset(np.ones(3, np.bool_), envs.config)
    envs.step(policy.select(envs.situation))
two = PacManBotParallelEnv(ghosts=("policy", "policy"), settings={"zero_sum": False})
two.reset(seed=1)
two.step({agent: 0 for agent in two.agents})
print(*sorted(compiled() - before), sep="\\n")
print(len(before), "kernels")
"""


def test_warm_up_compiles_kernels_of_other_games_too() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", OTHERS], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *missing, count = done.stdout.splitlines()
    assert [line for line in missing if line] == []
    assert int(count.split()[0]) > 30


def counted(done: list[str], name: str) -> Callable[[], None]:
    return lambda: done.append(name)


@pytest.fixture
def done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The parts that were played; here they are quick ones."""
    names: list[str] = []
    monkeypatch.setattr(cache_folder, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(warm_up, "PARTS", {name: counted(names, name) for name in ("one game", "policies")})
    monkeypatch.setattr(warm_up, "ROBOT_PARTS", {"robot": counted(names, "robot")})
    return names


def test_warm_up_skips_finished_parts_and_unrequested_robot(
    done: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["warm-up"]) == 0
    assert done == ["one game", "policies"]
    assert capsys.readouterr().out.endswith(f"{tmp_path}\n")
    assert main(["warm-up", "--robot"]) == 0
    assert done == ["one game", "policies", "robot"]
    out = capsys.readouterr().out
    assert out.count("already compiled") == 2


def test_verbose_warm_up_lists_kernels_with_their_own_times(
    done: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    inner = numba.njit(lambda x: x + 1)

    @numba.njit
    def outer(x: int) -> int:
        return inner(x) * 2

    monkeypatch.setattr(warm_up, "PARTS", {"two kernels": lambda: outer(1)})
    assert main(["warm-up", "--verbose"]) == 0
    _, *rows, total, _ = capsys.readouterr().out.splitlines()
    assert {"outer", "<lambda>"} <= {row.split()[0].rpartition(".")[2] for row in rows}
    seconds = [float(row.split()[-2]) for row in (*rows, total)]
    assert seconds[-1] == pytest.approx(sum(seconds[:-1]), abs=0.15)


def test_warm_up_repeats_after_compiler_change(
    done: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["warm-up"])
    monkeypatch.setattr("numba.__version__", "0.0")
    main(["warm-up"])
    assert done == ["one game", "policies"] * 2
    assert "already compiled" not in capsys.readouterr().out


def fail() -> None:
    raise ValueError("no such map")


def fill_disk() -> None:
    with pytest.warns(RuntimeWarning):
        cache_folder.warn_unkept(OSError(errno.ENOSPC, "No space left on device"))


@pytest.mark.parametrize("part", [fail, fill_disk])
def test_failed_or_unsaved_part_runs_again_next_time(
    part: Callable[[], None], done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache_folder, "unkept", [])
    with monkeypatch.context() as patched:
        patched.setitem(warm_up.PARTS, "policies", part)
        assert main(["warm-up"]) == 2
    cache_folder.unkept.clear()
    assert main(["warm-up"]) == 0
    assert done == ["one game", "policies"]


def test_unwritable_cache_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PACMAN_ENV_CACHE", "/dev/null/cache")
    monkeypatch.setattr(cache_folder, "kernel_folder", cache_folder.kernel_folder.__wrapped__)
    monkeypatch.setattr(cache_folder, "unkept", [])
    with pytest.warns(RuntimeWarning):
        assert main(["warm-up"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pacman-env warm-up: /dev/null/cache: cannot be written")
    assert err.count("\n") == 1
