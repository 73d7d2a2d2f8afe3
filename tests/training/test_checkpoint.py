"""Of checkpoints, earlier versions' too, tensors are read and nothing is run, with the facts beside them."""

from __future__ import annotations

import base64
import io
import json
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

pytest.importorskip("torch")
pytest.importorskip("onnx")
pytest.importorskip("sb3_contrib")

from pacman_env.config import make_config
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.training.checkpoint import (
    Facts,
    TorchPlanner,
    facts_path,
    load_planner,
    read_facts,
    restore,
    save_checkpoint,
    write_facts,
)
from pacman_env.training.export import main
from pacman_env.training.ppo import PPO
from tests.policies.contract import random_situation
from tests.training.planners import FACTS, random_network
from tests.training.stock import stock_model
from tests.training.test_arguments import tiny


def test_facts_are_read_as_written(tmp_path: Path) -> None:
    path = facts_path(tmp_path / "run.1.zip")
    assert path.name == "run.1.facts.json"
    write_facts(path, FACTS)
    assert read_facts(path) == FACTS
    assert list(tmp_path.iterdir()) == [path]


def test_unreadable_facts_are_not_written(tmp_path: Path) -> None:
    path = tmp_path / "run.facts.json"
    with pytest.raises(ValueError, match=r"run\.facts\.json: training\.decisions = 1\.5: Expected `int`"):
        write_facts(path, structs.replace(FACTS, training=structs.replace(FACTS.training, decisions=1.5)))
    with pytest.raises(ValueError, match=r"run\.facts\.json: cannot be read"):
        read_facts(path)


def test_facts_with_other_fields_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.facts.json"
    path.write_text('{"robot_speed_mps": 0.256, "metrics": {}}')
    with pytest.raises(ValueError, match=r"run\.facts\.json: Object missing required field `training`"):
        read_facts(path)


class _Touch:
    """Unpickled, it leaves a trace."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> object:
        return os.mkdir, (str(self.path),)


def test_code_in_invalid_checkpoint_is_never_run(tmp_path: Path) -> None:
    trace, path = tmp_path / "trace", tmp_path / "run.zip"
    with zipfile.ZipFile(path, "w") as file:
        for name in ("data", "policy.pth", "pytorch_variables.pth"):
            content = io.BytesIO()
            pickle.dump(_Touch(trace), content)
            file.writestr(name, content.getvalue())
    with pytest.raises(ValueError, match=r"run\.zip: no planner that can be loaded"):
        load_planner(path)
    assert not trace.exists()


def test_code_in_valid_checkpoint_is_never_run(checkpoint: Path, tmp_path: Path) -> None:
    """Its tensors are read all the same."""
    trace, path = tmp_path / "trace", tmp_path / "run.zip"
    serialized = base64.b64encode(pickle.dumps(_Touch(trace))).decode()
    with zipfile.ZipFile(checkpoint) as good, zipfile.ZipFile(path, "w") as file:
        for name in good.namelist():
            content = good.read(name)
            if name == "data":
                data = json.loads(content)
                data["lr_schedule"] = data["policy_class"] = {":type:": "x", ":serialized:": serialized}
                content = json.dumps(data).encode()
            file.writestr(name, content)
    expected, found = (load_planner(one).network.state_dict() for one in (checkpoint, path))
    assert all((expected[name] == found[name]).all() for name in expected)
    assert not trace.exists()


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"run\.zip: no such file"):
        load_planner(tmp_path / "run.zip")


def test_torch_planner_chooses_only_allowed_candidates() -> None:
    situation = random_situation(0, 30)
    planner = TorchPlanner("mine", random_network(dropped_kinds=(1,)), 0.25)
    np.testing.assert_array_equal(planner.scores(situation) > -np.inf, situation.mask & (situation.kind != 1))
    assert situation.mask[np.arange(30), planner.select(situation)].all()


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of an earlier version, saved by Stable-Baselines3 before the first decision is learned from."""
    env = PacManBotVecEnv(2, map="house", observation="planner")
    path = tmp_path_factory.mktemp("run") / "run.zip"
    stock_model(env, tiny().hyper, dropped_kinds=(1,)).save(path)
    return path


def test_checkpoint_of_earlier_version_is_restored_and_saved(checkpoint: Path, tmp_path: Path) -> None:
    model = PPO(tiny().hyper, 1, dropped_kinds=(1,))
    restore(checkpoint, model.network, model.optimizer)
    save_checkpoint(tmp_path / "run.zip", model.network, model.optimizer)
    ours, theirs = load_planner(tmp_path / "run.zip").network, load_planner(checkpoint).network
    assert ours.dropped_kinds == theirs.dropped_kinds == (1,)
    assert all((ours.state_dict()[name] == value).all() for name, value in theirs.state_dict().items())


def test_checkpoint_planner_uses_robot_speed_of_its_facts(checkpoint: Path) -> None:
    planner = load_planner(checkpoint)
    assert planner.name == "run"
    assert planner.robot_speed_mps == make_config("robot").robot.speed_mps
    write_facts(facts_path(checkpoint), Facts(0.2, FACTS.training, {}))
    assert load_planner(checkpoint).robot_speed_mps == 0.2


def test_exported_checkpoint_decides_like_its_network(checkpoint: Path, tmp_path: Path) -> None:
    out, facts = tmp_path / "mine.onnx", tmp_path / "facts.json"
    write_facts(facts, FACTS)
    assert main([str(checkpoint), "--out", str(out), "--facts", str(facts)]) == 0
    situation = random_situation(1, 40)
    found = make_policy(str(out)).scores(situation)
    network = load_planner(checkpoint).network
    expected = TorchPlanner("mine", network, FACTS.robot_speed_mps).scores(situation)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_damaged_checkpoint_is_refused(checkpoint: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "run.zip"
    damaged.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"run\.zip: no planner that can be loaded"):
        load_planner(damaged)
