"""The scripts of docs/examples/clients: each learns, saves, and plays beside the baselines, as its page shows it."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sb3_contrib
import stable_baselines3
import torch

from pacman_env.envs.registration import FLAT_ID
from tests.pages import loaded

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "docs" / "examples" / "clients"
SHARED = "evaluate"  # by several scripts


def test_every_script_is_run_documented_and_pinned() -> None:
    rows = re.findall(
        r"\| \[(\w+)\].*? \| ([\d.]+)\S* \|.*clients/(\w+)\.py", (ROOT / "docs/use_with/README.md").read_text()
    )
    clients = re.findall(r'"(\w+) ([\w-]+) (\w+)"', (ROOT / "scripts" / "clients").read_text())
    assert {name for *_, name in rows} == {name for name, *_ in clients}
    assert {name for name, *_ in clients} == {path.stem for path in SCRIPTS.glob("*.py")} - {SHARED}
    assert all((ROOT / "docs" / "use_with" / f"{page}.md").exists() for *_, page in clients)
    environment = {name: folder for name, folder, _ in clients if folder != "-"}
    requirements = {path.stem: path.read_text() for path in (SCRIPTS / "requirements").glob("*.txt")}
    assert set(environment.values()) == set(requirements)
    for library, version, name in rows:
        if name in environment and library != "gymnasium":  # in the version of constraints.txt
            assert re.search(rf"^{library}(\[\w+\])?=={version}$", requirements[environment[name]], re.MULTILINE), name


def test_gymnasium_wrappers_work_unmodified(tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPTS / "gymnasium_wrappers.py"), "--map", "house", "--decisions", "100"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    both = "PacManBot-v2 PacManBotFlat-v2"
    for line in (f"single TimeAwareObservation: {both}", f"vector RecordEpisodeStatistics: {both}", "RecordVideo:"):
        assert line in done.stdout
    assert done.stdout.count("sync, async, vector_entry_point are equal") == 2


def output(*command: str, decisions: int) -> str:
    """What a script says that learns and plays on one map."""
    given = ["--map", "loop", "--decisions", str(decisions), "--test", "loop", "--rounds", "4"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([*command, *given], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def run(
    script: str, decisions: int, folder: Path, *, python: tuple[str, ...] = (sys.executable, "-W", "error")
) -> Path:
    """The model that a script has saved, after its report was looked at."""
    model = folder / "model.zip"
    said = output(*python, str(SCRIPTS / script), "--num-envs", "1", "--save", str(model), decisions=decisions)
    assert re.search(r"^loop: \d+\.\d \[.*\] % of 4 rounds completed$", said, re.MULTILINE)
    assert re.findall(r"^  (\w+) \d+\.\d %, difference [+-]", said, re.MULTILINE) == ["nearest", "random_pellet"]
    return model


@pytest.fixture(scope="module")
def evaluate() -> Any:
    return loaded(SCRIPTS / "evaluate.py")


@pytest.mark.parametrize(
    ("script", "algorithm"), [("sb3_ppo.py", stable_baselines3.PPO), ("sb3_maskable_ppo.py", sb3_contrib.MaskablePPO)]
)
@pytest.mark.daily
def test_stable_baselines3_model_plays_every_map_after_learning(script: str, algorithm: Any, tmp_path: Path) -> None:
    model = algorithm.load(run(script, 300, tmp_path), device="cpu")
    env = gym.make(FLAT_ID, map="maze")
    observation, _ = env.reset(seed=0)
    action, _ = model.predict(observation, deterministic=True)
    assert action in env.action_space


@pytest.mark.daily
def test_cleanrl_ppo_learns_and_saves_its_networks(tmp_path: Path) -> None:
    weights = torch.load(run("cleanrl_ppo.py", 512, tmp_path), weights_only=True)
    assert not torch.equal(weights["critic.4.bias"], torch.zeros(1))  # it begins there


def interpreter(venv: str, script: str) -> str:
    """Of the environment with a library whose pins clash with this one's."""
    folder = ROOT / ".clients" / venv
    if not (folder / "installed").exists():
        pytest.skip(f"scripts/clients {script} makes the environment {venv}")
    return str(folder / "bin" / "python")


@pytest.mark.parametrize(
    ("venv", "script", "decisions"),
    [
        ("", "torchrl_ppo", 1000),
        pytest.param("rllib", "rllib_ppo", 300, marks=pytest.mark.daily),
        pytest.param("benchmarl", "benchmarl_mappo", 500, marks=pytest.mark.daily),
    ],
)
def test_client_learns_and_saves_finite_weights(venv: str, script: str, decisions: int, tmp_path: Path) -> None:
    if not venv:
        pytest.importorskip("torchrl")
    python = (interpreter(venv, script),) if venv else (sys.executable, "-W", "error")
    weights = torch.load(run(f"{script}.py", decisions, tmp_path, python=python), weights_only=True)
    tensors = [value for value in weights.values() if isinstance(value, torch.Tensor)]  # others are sizes
    assert tensors
    assert all(torch.isfinite(value).all() for value in tensors)


@pytest.mark.daily
def test_rllib_self_play_returns_sum_to_zero() -> None:
    said = output(interpreter("rllib", "rllib_ppo"), str(SCRIPTS / "rllib_self_play.py"), decisions=1000)
    returns = re.findall(r"decisions: return (\S+), pacman (\S+), clyde (\S+)$", said, re.MULTILINE)
    assert returns
    for both, pacman, clyde in returns:
        assert float(both) == 0
        assert float(pacman) == -float(clyde) != 0
    assert re.search(r"^no choice was forbidden: \d+ of pacman \d+ of clyde$", said, re.MULTILINE)


@pytest.mark.daily
def test_supersuit_ppo_learns_both_players_in_one_network(tmp_path: Path) -> None:
    python = interpreter("farama", "supersuit_ppo")
    model = run("supersuit_ppo.py", 600, tmp_path, python=(python,))
    assert stable_baselines3.PPO.load(model, device="cpu").observation_space.shape == (88,)


def test_evaluation_plays_same_rounds_for_models_and_baselines(evaluate: Any) -> None:
    def nearest(observation: np.ndarray, masks: np.ndarray) -> np.ndarray:
        return masks.argmax(axis=1)

    ours, theirs = evaluate.completed(nearest, "house", 60), evaluate.baseline("nearest", "house", 60)
    assert (ours == theirs).mean() > 0.8  # one decides at events, the other every 0.5 s
    assert (evaluate.completed(nearest, "house", 6) == ours[:6]).all()
    assert (evaluate.completed(nearest, "house", 6, seed=50) == ours[50:56]).all()


def test_ten_line_example_of_sb3_page_learns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = re.findall(r"```py\n(.*?)```", (ROOT / "docs" / "use_with" / "sb3.md").read_text(), re.DOTALL)[0]
    assert len(lines.splitlines()) <= 10
    monkeypatch.chdir(tmp_path)
    small = lines.replace('(8, map="generated"', '(1, map="loop"').replace("200_000", "300")
    assert small.count('(1, map="loop"') == small.count("300") == 1
    torch.set_num_threads(1)
    exec(compile(small, "ten lines", "exec"), {})
    assert (tmp_path / "maskable_ppo.zip").stat().st_size > 0
