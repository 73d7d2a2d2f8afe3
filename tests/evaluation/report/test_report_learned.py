"""Planners that were learned take part in a report, as files; their networks are random here."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")
import torch

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.evaluation.replay import main as replay
from pacman_env.evaluation.report.__main__ import main
from pacman_env.policies.metadata import read_planner
from pacman_env.sim.maps.assets import map_assets
from pacman_env.training.checkpoint import facts_path, load_network, save_checkpoint, write_facts
from pacman_env.training.export import export_planner
from tests.training.planners import FACTS, random_network, random_planner

EASY = {"pellets.spacing_m": 3.0, "time_limit_s": 60.0, "execution.pickup_radius_m": 2.0}
RULES = [word for name, value in EASY.items() for word in ("--set", f"{name}={value}")]
FEW = ["--episodes", "6", "--endless", "1", "--speeds", "0.25", "--variant", *RULES]


def report(folder: Path, *arguments: str) -> dict[str, Any]:
    files = ["--out", str(folder / "page.html"), "--json", str(folder / "page.json")]
    assert main([*FEW, *arguments, *files]) == 0
    result: dict[str, Any] = json.loads((folder / "page.json").read_text())
    return result


def played(report: dict[str, Any], policy: str) -> dict[str, dict[str, Any]]:
    """Return the outcomes of a policy on the map by part."""
    return {r["part"]: r["outcomes"] for r in report["rows"] if (r["policy"], r["map"]) == (policy, "house")}


def test_planner_file_is_reported_and_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = random_planner(tmp_path)
    made = report(tmp_path, "--policies", str(path), "--baseline", "nearest", "--replays", "1")
    config = make_config(**EASY)
    records, _ = play(map_assets("house", config), config, str(path), episode_seeds(0, 6))
    np.testing.assert_array_equal(played(made, "mine")["rounds"]["collected"], records["collected"])
    np.testing.assert_allclose(played(made, "mine")["rounds"]["time_s"], records["time_s"], atol=1e-3)
    assert [(p["name"], p["spec"]) for p in made["policies"]] == [("mine", str(path)), ("nearest", "nearest")]
    assert made["policies"][0]["facts"]["sha256"] == read_planner(path)[0].sha256
    assert "Metadata of mine" in (tmp_path / "page.html").read_text()
    row = (made["pair"]["wins"] + made["pair"]["losses"])[0]
    assert (tmp_path / row["film"]).is_file()
    monkeypatch.chdir(tmp_path)
    assert replay(shlex.split(row["command"])[2:]) == 0
    text = capsys.readouterr().out
    for name, outcome in (("mine", row["ours"]), ("nearest", row["theirs"])):
        assert f"{outcome['time_s']:.1f} s, {outcome['collected']} of {outcome['pellets']} pellets" in (
            next(line for line in text.splitlines() if line.startswith(f"{name}: "))
        )


def test_checkpoint_plays_like_its_export(tmp_path: Path) -> None:
    checkpoint, exported = tmp_path / "run.zip", tmp_path / "mine.onnx"
    network = random_network()
    save_checkpoint(checkpoint, network, torch.optim.Adam(network.parameters()))
    write_facts(facts_path(checkpoint), FACTS)
    export_planner(load_network(checkpoint), exported, FACTS)
    policies = ["--policies", str(checkpoint), str(exported), "--baseline", "nearest"]
    made = report(tmp_path, *policies)
    assert set(played(made, "run")) == {"rounds", "endless games"}
    assert len(set(played(made, "run")["rounds"]["collected"])) > 1
    assert played(made, "run") == played(made, "mine")
