"""The simulated Nav2 drives recorded goals as slowly as Nav2 does, if it is told to."""

import itertools
import math
from pathlib import Path

import pytest

from pacman_env.config import make_config
from pacman_env.evaluation.checks.recorded_goals import compare, drive, read_goals
from pacman_env.evaluation.checks.validation import main
from pacman_env.sim.core.robot import SimulatedRobot, place
from pacman_env.world.maps.occupancy import load_map

RECORDED = Path(__file__).parents[3] / "eval" / "nav2" / "house"
#: As the recorded base.
BASE = {"robot.speed_mps": 0.306}


def test_simulated_mppi_takes_the_recorded_times() -> None:
    def off(preset: str) -> float:
        _, pairs = compare(RECORDED, make_config(preset, **BASE))
        both = [(goal.driven.ended_s, driven.ended_s) for goal, driven in pairs if driven.succeeded]
        return abs(math.log(sum(simulated for _, simulated in both) / sum(recorded for recorded, _ in both)))

    assert off("robot") < 0.05 < 0.15 < off("robot_0_15")


def test_mppi_turns_on_the_spot_before_it_drives() -> None:
    config = make_config(**{"localization.perfect": True})
    robot = SimulatedRobot(load_map("house"), config)
    robot.set_goal(3.3, -0.6)
    x, y, heading = robot.pose
    place(robot, (x, y, heading + math.pi), (0.0, 0.0))
    robot.set_goal(3.3, -0.6)
    speeds = []
    for _ in range(int(12 / config.physics_step_s)):
        robot.step()
        speeds.append(robot.velocity)
    turning_s = sum(abs(turn) > 0.3 and speed < 0.05 for speed, turn in speeds) * config.physics_step_s
    assert 2.5 < turning_s < 6.0
    assert max(abs(turn) for _, turn in speeds) <= config.mppi.turn_radps + 1e-6
    changes = [abs(after[0] - before[0]) for before, after in itertools.pairwise(speeds)]
    assert max(changes) <= config.mppi.speed_response * config.robot.speed_mps * config.physics_step_s + 1e-6
    assert 0.9 * config.robot.speed_mps < max(speed for speed, _ in speeds) <= config.robot.speed_mps + 1e-6


def test_goals_of_a_trial_are_pre_empted_and_canceled_as_recorded() -> None:
    trials = read_goals(RECORDED / "goals.csv")
    robot = SimulatedRobot(load_map("house"), make_config())
    canceled = next(goals for goals in trials if not math.isnan(goals[-1].canceled_s))
    assert not drive(robot, canceled)[-1].succeeded
    preempted = next(goals for goals in trials if len(goals) > 1 and goals[-1].preempts and goals[-1].driven.succeeded)
    first, *_, last = drive(robot, preempted)
    assert last.succeeded
    assert not first.succeeded


def test_damaged_row_is_refused_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (RECORDED / "goals.csv").read_text().splitlines()
    lines[2] = lines[2].replace(".", "x", 3)
    for name in ("card.yaml", "goals.csv"):
        (tmp_path / name).write_text((RECORDED / name).read_text() if name == "card.yaml" else "\n".join(lines))
    assert main(["--recorded-goals", str(tmp_path)]) != 0
    assert "line 3" in capsys.readouterr().err
