"""Of checkpoints, earlier versions' too, tensors are read and nothing is run, with the facts beside them."""

import base64
import io
import json
import os
import pickle
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

pytest.importorskip("torch")
pytest.importorskip("onnx")
pytest.importorskip("sb3_contrib")

import torch

from pacman_env.config import make_config
from pacman_env.evaluation.rounds.scenarios import load_policy
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
from tests.training.planners import FACTS
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
    planner = load_policy(str(checkpoint))
    assert isinstance(planner, TorchPlanner)
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


class _Touch:
    """Unpickled, it leaves a trace."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> object:
        return os.mkdir, (str(self.path),)


def rewritten(path: Path, changes: dict[str, bytes | None]) -> None:
    """Change files of a zip, add them or leave them out."""
    with zipfile.ZipFile(path) as archive:
        files: dict[str, bytes | None] = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in {**files, **changes}.items():
            if content is not None:
                archive.writestr(name, content)


def tensors(value: object) -> bytes:
    file = io.BytesIO()
    torch.save(value, file)
    return file.getvalue()


WEIGHTS, OPTIMIZER = "policy.pth", "policy.optimizer.pth"
DAMAGES: dict[str, Callable[[Path, Path], object]] = {
    "missing": lambda path, _: path.unlink(),
    "empty": lambda path, _: path.write_bytes(b""),
    "torn": lambda path, _: path.write_bytes(path.read_bytes()[:2000]),
    "no-weights": lambda path, _: rewritten(path, {WEIGHTS: None}),
    "torn-weights": lambda path, _: rewritten(path, {WEIGHTS: b"PK\x03\x04"}),
    "list": lambda path, _: rewritten(path, {WEIGHTS: tensors([1, 2])}),
    "other-network": lambda path, _: rewritten(path, {WEIGHTS: tensors({"a": torch.zeros(2)})}),
    "code": lambda path, trace: rewritten(path, {WEIGHTS: tensors(_Touch(trace))}),
    "no-optimizer": lambda path, _: rewritten(path, {OPTIMIZER: tensors({})}),
    "code-in-optimizer": lambda path, trace: rewritten(path, {OPTIMIZER: tensors(_Touch(trace))}),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_invalid_checkpoint_is_refused_by_name(damage: str, checkpoint: Path, tmp_path: Path) -> None:
    path, model = Path(shutil.copy(checkpoint, tmp_path)), PPO(tiny().hyper, 1, dropped_kinds=(1,))
    DAMAGES[damage](path, tmp_path / "trace")
    with pytest.raises(ValueError, match=r"run\.zip: cannot be restored"):
        restore(path, model.network, model.optimizer)
    if "optimizer" not in damage:  # which a planner has no use for
        with pytest.raises(ValueError, match=r"run\.zip: .*no (checkpoint of 'pacman-env train'|such file)"):
            load_planner(path)
    assert not (tmp_path / "trace").exists()


def test_code_in_valid_checkpoint_is_never_run(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its tensors are read all the same."""
    monkeypatch.setattr("cloudpickle.loads", lambda *_, **__: pytest.fail("unpickled"))
    path, trace = Path(shutil.copy(checkpoint, tmp_path)), pickle.dumps(_Touch(tmp_path / "trace"))
    with zipfile.ZipFile(path) as archive:
        data = json.loads(archive.read("data"))
    data["lr_schedule"] = data["policy_class"] = {":type:": "x", ":serialized:": base64.b64encode(trace).decode()}
    rewritten(path, {"data": json.dumps(data).encode(), "pytorch_variables.pth": trace})
    model = PPO(tiny().hyper, 1, dropped_kinds=(1,))
    restore(path, model.network, model.optimizer)
    expected = load_planner(checkpoint).network.state_dict()
    for found in (load_planner(path).network.state_dict(), model.network.state_dict()):
        assert all((expected[name] == found[name]).all() for name in expected)
    assert not (tmp_path / "trace").exists()
