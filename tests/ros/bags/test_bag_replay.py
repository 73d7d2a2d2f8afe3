"""A game of the simulator written as a robot's bag, with exact times, and what a replay of it reports."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("rosbags")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pacman_env.cli.main import main
from pacman_env.config import make_config
from pacman_env.game.decisions import LastDecision
from pacman_env.heuristics.simple import Nearest
from pacman_env.policies.registry import make_policy
from pacman_env.ros import topics
from pacman_env.ros.bags.bag import BagError, open_bag
from pacman_env.ros.bags.bag_replay import replay_bag
from pacman_env.ros.bags.bag_walk import chosen_of, recorded_config
from pacman_env.ros.bags.pose_statistics import PoseStatistics, simulated_statistics
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.situation import Situation

STORE = get_typestore(Stores.ROS2_JAZZY)
START_S = 2.0  # of the round, since the bag began
TICKS = 60
ARRIVES_S = 0.02  # a message is recorded a little after it was stamped


class Bagged:
    """Writes messages as a robot would send them."""

    def __init__(self, path: Path, namespace: str = "/robot_15") -> None:
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._namespace = namespace
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> Bagged:
        self._writer.open()
        return self

    def __exit__(self, *failure: object) -> None:
        self._writer.close()

    def say(self, topic: topics.Topic, at_s: float, **values: Any) -> None:
        name = topic.type_name.replace("/", "/msg/")
        if topic.name not in self._connections:
            self._connections[topic.name] = self._writer.add_connection(
                f"{self._namespace}/{topic.name}", name, typestore=STORE
            )
        raw = STORE.serialize_cdr(STORE.types[name](**values), name)
        self._writer.write(self._connections[topic.name], round((at_s + ARRIVES_S) * 1e9), raw)


def of(name: str, **values: Any) -> Any:
    return STORE.types[name.replace("/", "/msg/")](**values)


def header(at_s: float, frame: str = "map") -> Any:
    seconds, nanoseconds = divmod(round(at_s * 1e9), 1_000_000_000)
    return of("std_msgs/Header", stamp=of("builtin_interfaces/Time", sec=seconds, nanosec=nanoseconds), frame_id=frame)


def pose(x: float, y: float, heading: float = 0.0) -> Any:
    return of(
        "geometry_msgs/Pose",
        position=of("geometry_msgs/Point", x=x, y=y, z=0.0),
        orientation=of("geometry_msgs/Quaternion", x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2)),
    )


def markers(pellets: dict[int, tuple[float, float]], green: int | None = None) -> list[Any]:
    zero = of("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
    none = of("builtin_interfaces/Duration", sec=0, nanosec=0)

    def marker(number: int, action: int, x: float = 0.0, y: float = 0.0) -> Any:
        return of(
            "visualization_msgs/Marker",
            header=header(0.0),
            ns="pellets",
            id=number,
            type=2,
            action=action,
            pose=pose(x, y),
            scale=zero,
            color=of("std_msgs/ColorRGBA", r=0.0, g=float(number == green), b=0.0, a=1.0),
            lifetime=none,
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=of("sensor_msgs/CompressedImage", header=header(0.0), format="", data=np.zeros(0, np.uint8)),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=of("visualization_msgs/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )

    return [marker(0, 3), *(marker(number, 0, *at) for number, at in pellets.items())]


def said(node: str, configuration: Any) -> str:
    """As on ``game/configuration``."""
    return json.dumps({"node": node, "hash": "", "map": None, "configuration": configuration})


def write_round(
    path: Path,
    policy_name: str,
    plans: bool = True,
    odometry: bool = True,
    scores: bool = False,
    when: str = "tick",
) -> list[int]:
    """Half a minute of a round on the map ``house``, as a robot would say it; ``scores``: as our goal selector does.

    Returns the ticks of its decisions; ``when``: as in ``decisions.when``.
    """
    config = make_config(**{"execution.tick_s": 0.1, "execution.check_period_s": 0.1})
    assets = map_assets("house", config)
    batch = GameBatch(assets, config)
    batch.reset(np.array([0]), np.array([3], dtype=np.uint64))
    policy = make_policy(policy_name)
    policy.reset(np.ones(1, np.bool_), config)
    played, decided = make_config(**{"decisions.when": when}), []
    game, last = batch.games[0], LastDecision(played)
    updated = -1
    choice = np.array([batch.hold])
    covariance = np.zeros(36)
    with Bagged(path) as bag:
        bag.say(topics.GAME_STATE, 0.0, data="menu")
        bag.say(topics.CONFIGURATION, 0.0, data=said("goal_selector", played.as_dict()))
        bag.say(topics.CLYDE_SPEED, 0.0, data=float(game["clyde_speed"]))
        for tick in range(TICKS * 5):
            at_s = START_S + float(game["step"]) * config.physics_step_s
            if tick % 2 == 0:
                x, y = batch.obstacles[0, 0, :2].tolist()
                bag.say(topics.CLYDE_POSE, at_s - 0.04, header=header(at_s), pose=pose(x, y))
            if game["amcl_step"] != updated:
                updated = game["amcl_step"]
                at = of(
                    "geometry_msgs/PoseWithCovariance",
                    pose=pose(float(game["amcl_x"]), float(game["amcl_y"]), float(game["amcl_heading"])),
                    covariance=covariance,
                )
                bag.say(topics.AMCL_POSE, at_s - 0.03, header=header(at_s), pose=at)
            if odometry:
                speed = of("geometry_msgs/Vector3", x=float(game["left"] + game["right"]) / 2, y=0.0, z=0.0)
                turning = of("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
                bag.say(
                    topics.ODOMETRY,
                    at_s - 0.035,
                    header=header(at_s, "odom"),
                    child_frame_id="base_link",
                    pose=of(
                        "geometry_msgs/PoseWithCovariance",
                        pose=pose(float(game["x"]), float(game["y"]), float(game["heading"])),
                        covariance=covariance,
                    ),
                    twist=of(
                        "geometry_msgs/TwistWithCovariance",
                        twist=of("geometry_msgs/Twist", linear=speed, angular=turning),
                        covariance=covariance,
                    ),
                )
            alive = np.flatnonzero(batch.alive[0, : assets.pellets])
            shown = {int(assets.pellet_ids[p]): tuple(assets.goal_xy[p].tolist()) for p in alive}
            bag.say(topics.PELLET_MARKERS, at_s - 0.025, markers=markers(shown))
            if tick == 0:
                bag.say(topics.GAME_STATE, at_s, data="running")
            if tick % 5 == 0 and last.due(moment := batch.moment(0)):
                choice = policy.select(batch.situation())
                last.decide(int(choice[0]), moment)
                decided.append(tick // 5)
                if scores:
                    shown = {c: tuple(assets.goal_xy[c].tolist()) for c in range(assets.pellets)}
                    bag.say(topics.SCORES, at_s, markers=markers(shown, int(choice[0])))
            if plans and choice[0] != batch.hold:
                way = of(
                    "geometry_msgs/PoseStamped", header=header(at_s), pose=pose(*assets.goal_xy[choice[0]].tolist())
                )
                bag.say(topics.PLAN, at_s, header=header(at_s), poses=[way])
            batch.step(choice)
        bag.say(topics.GAME_STATUS, at_s, data="pellet_collected:3")
        bag.say(topics.GAME_STATE, at_s, data="menu")
    return decided


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "game"
    write_round(path, "nearest")
    return path


def test_the_policy_that_played_chooses_as_recorded(bag: Path) -> None:
    report = replay_bag(bag, "house", "nearest")
    assert (report.namespace, report.rounds, report.statuses) == ("/robot_15", 1, {"pellet_collected": 1})
    assert abs(report.decisions - TICKS) <= 1
    assert report.unknown == 0
    assert report.bad_messages == {}
    assert report.same >= 0.9 * report.decisions  # the plan that shows a choice may come a tick late


class Watcher(Nearest):
    """Nearest, and at which ticks it was asked."""

    name = "watcher"
    ticks: ClassVar[list[int]] = []

    def select(self, situation: Situation) -> np.ndarray:
        self.ticks.append(int(situation.tick[0]))
        return super().select(situation)


def test_of_a_game_decided_by_events_the_policy_is_asked_at_its_decisions_and_sees_every_tick_counted(
    tmp_path: Path,
) -> None:
    decided = write_round(tmp_path / "game", "nearest", plans=False, scores=True, when="event")
    Watcher.ticks.clear()
    report = replay_bag(tmp_path / "game", "house", f"{__name__}:Watcher")
    assert report.same == report.decisions == len(decided) < TICKS / 2
    assert Watcher.ticks[: len(decided)] == decided


def test_another_policy_is_reported_where_it_differs(bag: Path) -> None:
    report = replay_bag(bag, "house", "random")
    other = report.decisions - report.same - report.unknown
    assert other > 0
    assert sum(one.decisions for one in report.otherwise) == other
    first = report.otherwise[0]
    assert first.recorded != first.chosen
    assert first.at_s >= START_S
    text = report.render()
    assert f"{other} otherwise" in text
    assert f"{first.chosen} instead of {first.recorded}" in " ".join(text.split())


def test_the_recorded_simulator_moves_as_the_simulator(bag: Path) -> None:
    report = replay_bag(bag, "house", "nearest")
    for name in ("speed", "jump"):  # how often poses come depends on how much it turned in this half minute
        ours, theirs = report.robot[name], report.simulator[name]
        assert ours is not None
        assert theirs is not None
        assert ours[1] == pytest.approx(theirs[1], rel=0.35), name
    assert report.robot["clyde"] is not None
    assert report.robot["clyde"][1] == pytest.approx(0.25, abs=0.02)
    assert report.decision_ms is not None
    assert 0 < report.decision_ms[0] <= report.decision_ms[1] <= report.decision_ms[2]


def test_without_plans_choices_are_unknown_and_without_odometry_jumps_are(tmp_path: Path) -> None:
    write_round(tmp_path / "game", "nearest", plans=False, odometry=False)
    report = replay_bag(tmp_path / "game", "house", "nearest")
    assert report.unknown == report.decisions > 0
    assert report.otherwise == []
    assert report.robot["jump"] is None
    assert "-" in report.render()


def test_the_command_prints_text_or_json(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["ros", "replay", str(bag), "--map", "house", "--policy", "nearest"]
    assert main(command) == 0
    text = capsys.readouterr().out
    assert "as recorded" in text
    assert "driving speed, m/s" in text
    assert main([*command, "--json"]) == 0
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
def test_what_does_not_fit_the_bag_is_one_clear_line(bag: Path, change: dict[str, str], words: str) -> None:
    arguments = {"map": "house", "policy": "nearest", "namespace": "robot_15"} | change
    with pytest.raises(ValueError, match=words) as caught:
        replay_bag(bag, **arguments)
    assert "\n" not in str(caught.value)


def test_a_bag_without_a_round_says_so(tmp_path: Path) -> None:
    with Bagged(tmp_path / "idle") as idle:
        idle.say(topics.GAME_STATE, 0.0, data="menu")
    with pytest.raises(BagError, match="no round was played"):
        replay_bag(tmp_path / "idle", "house", "nearest")


def test_a_game_is_replayed_under_the_configuration_of_its_goal_selector(tmp_path: Path) -> None:
    fields = {"clyde.speed_mps": 0.35, "clyde.ghosts": ("wander", "far/away.onnx"), "max_pellets": 20}
    played = make_config(**fields)

    with Bagged(tmp_path / "game") as bagged:
        bagged.say(topics.GAME_STATE, 0.0, data="menu")
        bagged.say(topics.CONFIGURATION, 0.0, data=said("goal_selector", played.as_dict()))
        bagged.say(topics.CONFIGURATION, 0.1, data=said("sim_robot", make_config("ideal").as_dict()))
    with open_bag(tmp_path / "game") as bag:
        assert recorded_config(bag) == make_config(**fields | {"clyde.ghosts": ("wander", "policy")})
    for number, bad in enumerate(("no json", said("goal_selector", {"clyde": {"hue": "orange"}}), "[]")):
        with Bagged(tmp_path / f"bad{number}") as bagged:
            bagged.say(topics.GAME_STATE, 0.0, data="menu")
            bagged.say(topics.CONFIGURATION, 0.0, data=bad)
        with open_bag(tmp_path / f"bad{number}") as bag, pytest.raises(BagError, match="configuration"):
            recorded_config(bag)


def test_the_candidate_shown_as_chosen_is_the_one_read() -> None:
    from builtin_interfaces.msg import Time

    from pacman_env.ros.selector.goal_scores import score_markers

    config = make_config()
    batch = GameBatch(map_assets("house", config), config)
    batch.reset(np.array([0]), np.array([3], dtype=np.uint64))
    situation = batch.situation()
    scores = make_policy("lookahead").scores(situation)
    finite = np.flatnonzero(np.isfinite(scores[0]))
    for chosen in (*finite[:3].tolist(), batch.hold):
        assert chosen_of(score_markers(situation, scores, chosen, Time())) == chosen
    assert chosen_of(score_markers(situation, np.full_like(scores, -np.inf), batch.hold, Time())) == -1


def test_odometry_carries_a_pose_until_the_next_and_the_rest_is_its_jump() -> None:
    motion = PoseStatistics()
    assert motion.believed is None
    motion.drive((10.0, 0.0, math.pi / 2), 0.0)
    motion.localize(1.0, (0.0, 0.0, 0.0))
    motion.drive((10.0, 2.0, math.pi / 2), 0.3)  # two metres ahead
    assert motion.believed == pytest.approx((2.0, 0.0, 0.0))
    motion.localize(2.5, (2.0, 0.25, 0.1))
    assert motion.samples["jump"] == pytest.approx([0.25])
    assert motion.samples["turn"] == pytest.approx([0.1])
    assert motion.samples["interval"] == pytest.approx([1.5])
    assert motion.samples["speed"] == [0.3]
    motion.localize(60.0, (2.0, 0.25, 0.1))  # it stood
    assert len(motion.samples["interval"]) == 1


def test_simulated_poses_jump_by_the_error_that_is_drawn_anew() -> None:
    config = make_config()
    motion = simulated_statistics(map_assets("house", config), config, make_policy("nearest"), rounds=2)
    quantiles = motion.quantiles()
    assert quantiles["jump"] is not None
    # Two errors of 0.035 m per axis apart: Rayleigh with sigma 0.035 * sqrt(2), median 1.18 sigma.
    assert quantiles["jump"][1] == pytest.approx(0.058, rel=0.2)
    assert quantiles["speed"] is not None
    assert quantiles["speed"][2] <= config.robot.wheel_speed_mps


def test_replay_ends_quietly_without_reader(bag: Path) -> None:
    """As ``| head`` does, but certainly before anything is written."""
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "pacman_env.cli.main", "ros", "replay", str(bag), "--map", "house"]
    with open(writing, "wb") as output:
        ended = subprocess.run(
            [*command, "--policy", "nearest"],
            stdout=output,
            stderr=subprocess.PIPE,
        )
    assert b"Traceback" not in ended.stderr
    assert b"Exception ignored" not in ended.stderr
    assert ended.stderr.count(b"\n") <= 1
