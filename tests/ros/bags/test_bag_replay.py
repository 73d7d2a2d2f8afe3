"""Recorded games, and what replays of them report: the policy that played chooses again what it chose."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

pytest.importorskip("rosbags")

from pacman_env.cli.main import main
from pacman_env.config import make_config
from pacman_env.heuristics.simple import Nearest
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.ros import topics
from pacman_env.ros.bags import record
from pacman_env.ros.bags.bag import BagError, open_bag
from pacman_env.ros.bags.bag_replay import replay_bag
from pacman_env.ros.bags.bag_walk import chosen_of, recorded_config
from pacman_env.ros.bags.pose_statistics import PoseStatistics, simulated_statistics
from pacman_env.sim.batch import GameBatch
from tests.ros.bags.recorded import record_round, replay, said, words_bag


@pytest.fixture(scope="module")
def bag(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_round(tmp_path_factory.mktemp("bags"), "nearest")


def test_policy_that_played_chooses_as_recorded(bag: Path, domain: int, tmp_path: Path) -> None:
    for path, policy in ((bag, "nearest"), (record_round(tmp_path, "clyde_aware"), "clyde_aware")):
        report = replay(path, policy)
        assert (report.namespace, report.rounds, report.bad_messages) == ("/robot_15", 1, {})
        assert report.statuses["pellet_collected"] == 3
        assert (report.same, report.unknown, report.otherwise) == (report.decisions, 0, [])
        assert report.decisions > 100


class Watcher(Nearest):
    """Chooses the nearest pellet, and keeps at which ticks it was asked."""

    name = "watcher"
    ticks: ClassVar[list[int]] = []

    def select(self, situation: Situation) -> np.ndarray:
        self.ticks.append(int(situation.tick[0]))
        return super().select(situation)


def test_policy_is_asked_at_recorded_events(domain: int, tmp_path: Path) -> None:
    recorded = record_round(tmp_path, "nearest", "decisions.when=event")
    Watcher.ticks.clear()
    report = replay(recorded, f"{__name__}:Watcher")
    assert report.same == report.decisions
    ticks = Watcher.ticks[-report.decisions :]
    assert ticks == sorted(set(ticks))
    assert ticks[-1] - ticks[0] > 2 * report.decisions > 4


def test_another_policy_is_reported_where_it_differs(bag: Path) -> None:
    report = replay(bag, "random_pellet")
    other = report.decisions - report.same - report.unknown
    assert other > 0
    assert sum(one.decisions for one in report.otherwise) == other
    first, text = report.otherwise[0], " ".join(report.render().split())
    assert first.recorded != first.chosen
    assert f"{other} otherwise" in text
    assert f"{first.chosen} instead of {first.recorded}" in text


def test_robot_is_compared_with_simulator(bag: Path) -> None:
    report = replay(bag)
    medians = {name: values[1] for name, values in report.robot.items() if values}
    assert medians["speed"] == pytest.approx((report.simulator["speed"] or [])[1], rel=0.35)
    assert medians["clyde"] == pytest.approx(0.02, abs=0.002)
    assert 0 < report.decision_ms[0] <= report.decision_ms[1] <= report.decision_ms[2]


def test_choices_are_unknown_without_plans(domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left_out = topics.PLAN, topics.SCORES, topics.ODOMETRY
    monkeypatch.setattr(record, "RECORDED", [topic for topic in record.RECORDED if topic not in left_out])
    report = replay(record_round(tmp_path, "nearest"))
    assert report.unknown == report.decisions > 0
    assert (report.otherwise, report.robot["jump"]) == ([], None)


def replay_command(bag: Path) -> list[str]:
    return ["ros", "replay", str(bag), "--map", str(bag.parent / "ground.yaml"), "--policy", "nearest"]


def test_replay_prints_text_or_json(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(replay_command(bag)) == 0
    assert "driving speed, m/s" in " ".join(capsys.readouterr().out.split())  # lines are wrapped
    assert main([*replay_command(bag), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rounds"] == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"map": "maze"}, "no decision can be made"),
        ({"policy": "brave"}, "unknown policy 'brave'"),
        ({"map": "nowhere"}, "nowhere: neither a YAML file"),
        ({"namespace": "robot_7"}, "no topic game_state"),
    ],
)
def test_replay_refuses_what_does_not_fit_bag(bag: Path, change: dict[str, str], words: str) -> None:
    arguments = {"map": str(bag.parent / "ground.yaml"), "policy": "nearest", "namespace": "robot_15"} | change
    with pytest.raises(ValueError, match=words) as caught:
        replay_bag(bag, **arguments)
    assert "\n" not in str(caught.value)


def test_bag_without_round_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no round was played"):
        replay_bag(words_bag(tmp_path / "idle", GAME_STATE=["menu"]), "house", "nearest")


def test_recorded_configuration_is_read_from_goal_selector(tmp_path: Path) -> None:
    fields = {"clyde.speed_mps": 0.35, "clyde.ghosts": ("wander", "far/away.onnx"), "max_pellets": 20}
    own = said("goal_selector", make_config(**fields).as_dict())
    others = said("sim_robot", make_config("ideal").as_dict())
    with open_bag(words_bag(tmp_path / "game", GAME_STATE=["menu"], CONFIGURATION=[own, others])) as bag:
        assert recorded_config(bag) == make_config(**fields | {"clyde.ghosts": ("wander", "policy")})
    for number, bad in enumerate(("no json", said("goal_selector", {"clyde": {"hue": "orange"}}), "[]")):
        path = words_bag(tmp_path / f"bad{number}", GAME_STATE=["menu"], CONFIGURATION=[bad])
        with open_bag(path) as bag, pytest.raises(BagError, match="configuration"):
            recorded_config(bag)


def test_chosen_candidate_is_read_from_markers() -> None:
    from builtin_interfaces.msg import Time

    from pacman_env.ros.selector.goal_scores import score_markers

    config = make_config()
    batch = GameBatch(map_assets("house", config), config)
    batch.reset(np.array([0]), np.array([3], dtype=np.uint64))
    situation = situation_of(batch)
    scores = make_policy("lookahead").scores(situation)
    finite = np.flatnonzero(np.isfinite(scores[0]))
    for chosen in (*finite[:3].tolist(), batch.hold):
        assert chosen_of(score_markers(situation, scores[0], chosen, Time())) == chosen
    assert chosen_of(score_markers(situation, np.full_like(scores[0], -np.inf), batch.hold, Time())) == -1


def test_jump_is_what_odometry_does_not_explain() -> None:
    motion = PoseStatistics()
    motion.drive((10.0, 0.0, math.pi / 2), 0.0)
    motion.localize(1.0, (0.0, 0.0, 0.0))
    motion.drive((10.0, 2.0, math.pi / 2), 0.3)  # two metres ahead
    motion.localize(2.5, (2.0, 0.25, 0.1))
    assert motion.samples["jump"] == pytest.approx([0.25])
    assert motion.samples["turn"] == pytest.approx([0.1])
    assert motion.samples["interval"] == pytest.approx([1.5])
    assert motion.samples["speed"] == [0.3]
    motion.localize(60.0, (2.0, 0.25, 0.1))  # it stood
    assert len(motion.samples["interval"]) == 1


def test_simulated_poses_jump_by_their_drawn_error() -> None:
    config = make_config()
    motion = simulated_statistics(map_assets("house", config), config, make_policy("nearest"), rounds=2)
    # Two errors of 0.035 m per axis apart: Rayleigh with sigma 0.035 * sqrt(2), median 1.18 sigma.
    assert np.median(motion.samples["jump"]) == pytest.approx(0.058, rel=0.2)
    assert np.quantile(motion.samples["speed"], 0.9) <= config.robot.wheel_speed_mps


def test_replay_ends_quietly_without_reader(bag: Path) -> None:
    """As ``| head`` does, but certainly before anything is written."""
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "pacman_env.cli.main", *replay_command(bag)]
    with open(writing, "wb") as output:
        ended = subprocess.run(command, stdout=output, stderr=subprocess.PIPE)
    assert b"Traceback" not in ended.stderr
    assert b"Exception ignored" not in ended.stderr
    assert ended.stderr.count(b"\n") <= 1
