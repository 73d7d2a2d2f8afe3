"""Each check of a robot, good and bad, and the remedy of everything that is bad. No node runs here."""

import dataclasses
import re
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pacman_env.ros.game_nodes import GAME, LISTENERS, ORIGINAL_REFEREE, SELECTOR, SIMULATOR
from pacman_env.ros.map_comparison import Grid
from pacman_env.ros.supervisor.checks import CHECKS, domain, examine, game, is_ready, render
from pacman_env.ros.supervisor.checks import robot as robot_checks
from pacman_env.ros.supervisor.checks.check import BAD, OK, UNKNOWN, CheckTime, Finding, Observations, Source
from pacman_env.ros.supervisor.checks.domain import STAMPS, Clock, Stamp
from pacman_env.ros.supervisor.checks.game import CLOUDS, CONFIGURATIONS, STATES
from pacman_env.world.maps.occupancy import load_map

HOUSE = load_map("house")
NS = "/robot_15"
HASH = HOUSE.hash[:12]
COSTMAPS = (f"{NS}/global_costmap/global_costmap", f"{NS}/local_costmap/local_costmap")
BASE, LIDAR, NAVIGATOR = f"{NS}/create3_repub", f"{NS}/rplidar_composition", f"{NS}/bt_navigator"
SIM = f"{NS}/{SIMULATOR}"
NODES = (GAME, *LISTENERS)
NOW = CheckTime(wall_s=1000.0, monotonic_s=50.0)
WAITED = "within 10 s"
MODULES = (domain, robot_checks, game)
SOURCES = {name.lower(): one for module in MODULES for name, one in vars(module).items() if isinstance(one, Source)}


def delays(*wall_s: float, clock_s: float | None = None) -> deque[Stamp]:
    return deque(Stamp(one, clock_s) for one in wall_s)


LATE = delays(*[0.02] * 20)


def scans(count: int, hz: float = 7.5, share: float = 0.95, far_m: float = 8.0, late_s: float = 0.15) -> deque[Stamp]:
    ranges_m = np.append(np.linspace(0.2, far_m, round(100 * share)), [np.inf] * round(100 * (1 - share)))
    limits = {"range_min": 0.1, "range_max": np.inf, "scan_time": 0.13}

    def message(stamp_s: float) -> Any:
        stamp = SimpleNamespace(sec=int(stamp_s), nanosec=stamp_s % 1 * 1e9)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="rplidar_link"), ranges=ranges_m, **limits)

    return deque(Stamp(late_s, None, message(number / hz)) for number in range(count))


def link(parent: str, age_s: float) -> tuple[str, float]:
    return parent, NOW.monotonic_s - age_s


def plays(node: str, **changes: Any) -> dict[str, Any]:
    content = {
        "node": node,
        "acts": True,
        "started": (1000.0, "laptop", 17),
        "hash": "abc",
        "map": HASH if node == GAME else None,
        "configuration": {"clyde": {"speed_mps": 0.25}, "show": {"start_s": 8.0}},
    }
    return content | changes


def grid(**changes: Any) -> Grid:
    house: dict[str, Any] = {"resolution": float(np.float32(HOUSE.resolution)), "origin": HOUSE.origin}
    return Grid(**{**house, "cells": np.flipud(HOUSE.occupancy), **changes})


def observed(facts: dict[str, Any]) -> Observations:
    """Observations from facts by name: those of sources, and the graph's with relative names of topics."""
    facts = dict(facts)
    configurations, ages_s = facts.pop("configurations"), facts.pop("ages_s")
    values: dict[Any, Any] = {SOURCES[name]: facts.pop(name) for name in list(facts) if name in SOURCES}
    for group, sources in (("delays", STAMPS), ("states", STATES)):
        values |= {sources[name]: value for name, value in facts.pop(group).items()}
    values[CONFIGURATIONS] = {(one["node"], one["started"]): one for one in configurations}
    arrivals = {SOURCES.get(name, STAMPS["odom"]): tuple(NOW[1] - age_s for age_s in ages_s[name]) for name in ages_s}
    facts["publishers"] = facts["publishers"] | {
        "navigate_to_pose/_action/status": facts.pop("navigators"),
        "game/configuration": tuple(f"{NS}/{one['node']}" for one in configurations),
    }
    for ends in ("publishers", "subscribers"):
        facts[ends] = {topic if topic[0] == "/" else f"{NS}/{topic}": nodes for topic, nodes in facts[ends].items()}
    return Observations(NS, 10.0, NOW, values=values, arrivals=arrivals, **facts)


FACTS: dict[str, Any] = {
    "domain": 15,
    "map": HOUSE,
    "map_file": "house",
    "middleware": "rmw_fastrtps_cpp",
    "nodes": (BASE, LIDAR, NAVIGATOR, f"{NS}/amcl", *COSTMAPS, *(f"{NS}/{name}" for name in NODES)),
    "publishers": {"odom": (BASE,), "scan": (LIDAR,), "tf": (BASE,), "amcl_pose": (f"{NS}/amcl",)},
    "subscribers": dict.fromkeys(CLOUDS, COSTMAPS),
    "delays": {"odom": LATE, "scan": scans(20), "tf": LATE},
    "grid": grid(),
    "pose": ((0.0, 0.0, 0.0), 800 * 10**9),  # standing still, AMCL is silent
    "links": {"odom": link("map", 0.1), "base_link": link("odom", 0.05)},
    "static_links": {"rplidar_link": link("base_link", 9.0)},
    "docked": False,
    "charge": 0.8,
    "navigators": (NAVIGATOR,),
    "states": {"amcl": "active", "bt_navigator": "active"},
    "configurations": tuple(plays(name) for name in NODES),
    "state": "menu",
    "diagnostics": {"policy": "ppo", "active": True, "nav2": True, "troubles": {}},
    "processes": {"processes": dict.fromkeys(("watcher", GAME), "")},
    "ages_s": {"diagnostics": (1.0, 0.0), "odom": (0.1, 0.0)},
}


def robot(**changes: Any) -> Observations:
    """A real robot in a game where all is well, but for the changes."""
    return observed(FACTS | changes)


def simulated(**changes: Any) -> Observations:
    facts: dict[str, Any] = {
        "simulated": True,
        "nodes": (SIM, *(f"{NS}/{name}" for name in NODES)),
        "publishers": dict.fromkeys(("odom", "scan", "tf", "amcl_pose", "/clock"), (SIM,)),
        "subscribers": {CLOUDS[0]: (SIM,)},
        "delays": {"odom": delays(*[1.7e9] * 20, clock_s=0.05), "scan": scans(20, late_s=1.7e9)},
        "clock": Clock(0.0, 0.0, 10.0, 10.0),
        "docked": None,
        "charge": None,
        "navigators": (SIM,),
        "states": {},
    }
    return robot(**(facts | changes))


def base_with_nav2(**changes: Any) -> Observations:
    """A simulated base that a real Nav2 drives."""
    amcl, map_server = f"{NS}/amcl", f"{NS}/map_server"
    base = dict.fromkeys(("odom", "scan", "tf", "/clock", "battery_state"), (SIM,))
    facts: dict[str, Any] = {
        "nodes": (SIM, amcl, map_server, NAVIGATOR, *COSTMAPS, *(f"{NS}/{name}" for name in NODES)),
        "publishers": base | {"amcl_pose": (amcl,), "map": (map_server,)},
        "subscribers": dict.fromkeys(CLOUDS, COSTMAPS),
        "docked": False,
        "charge": 0.9,
        "navigators": (NAVIGATOR,),
        "states": dict.fromkeys(("amcl", "map_server", "bt_navigator"), "active"),
    }
    return simulated(**(facts | changes))


def found(observations: Observations, check: str) -> Finding:
    (one,) = [finding for finding in examine(observations) if finding.check == check]
    return one


def answered(observations: Observations, check: str, status: str, summary: str, remedy: str) -> Finding:
    """Return the answer to a check, which contains these words."""
    finding = found(observations, check)
    assert finding.status == status
    assert summary in finding.summary
    assert remedy in f"{finding.remedy}: {finding.command}"
    return finding


def test_every_check_has_name_and_question() -> None:
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert all(check.question.endswith("?") for check in CHECKS)


@pytest.mark.parametrize(
    ("observations", "unanswered"),
    [
        (robot(), []),
        (base_with_nav2(), []),
        (simulated(), ["dock", "battery", "Nav2's nodes", "clyde_trail"]),
    ],
)
def test_good_robot_is_ready_and_settled(observations: Observations, unanswered: list[str]) -> None:
    findings = examine(observations)
    assert [finding.check for finding in findings if finding.status != OK] == unanswered
    assert all(finding.settled and not finding.remedy for finding in findings)
    assert is_ready(findings)


UNDOCK = f'ros2 action send_goal {NS}/undock irobot_create_msgs/action/Undock "{{}}"'
NAV2 = f"ros2 launch turtlebot4_navigation nav2.launch.py namespace:={NS} params_file:=$PWD/config/nav2.yaml"
LOCALIZE = f"ros2 launch turtlebot4_navigation localization.launch.py namespace:={NS} map:=$PWD/maps/house.yaml"
MOTOR = f"ros2 service call {NS}/start_motor std_srvs/srv/Empty"
RESTART = "sudo systemctl restart turtlebot4"
STARTUP = f'{NS}/lifecycle_manager_navigation/manage_nodes nav2_msgs/srv/ManageLifecycleNodes "{{command: 0}}"'
UP = "pacman-env ros up --map house --namespace robot_15"
SPEEDY = {"clyde": {"speed_mps": 0.35}, "show": {"start_s": 8.0}}
OTHER_MAP = tuple(plays(name, map="feed") for name in (GAME, SELECTOR))
AUDIO_LOST = tuple(node for node in robot().nodes if "audio" not in node)
AUDIO_TWICE = (plays("audio_node"), plays("audio_node", started=(2000.0, "pi", 4)))
POSE_LOST = {"troubles": {"late": 3, "pose lost": 9}, "trouble_texts": {"pose lost": "lost for 12 s"}}
STALE_ODOM = {"odom": link("map", 4.0), "base_link": link("odom", 0.1)}
STALE_BASE = {"odom": link("map", 0.1), "base_link": link("odom", 4.0)}
NO_ODOM = {"diagnostics": (1.0, 0.0)}


@pytest.mark.parametrize(
    ("changes", "check", "summary", "remedy"),
    [
        ({"environment": {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}}, "ROS", "", "RANGE=SUBNET"),
        ({"nodes": ()}, "domain", f"domain 15 {WAITED}", "ROS_DOMAIN_ID"),
        ({"nodes": ("/robot_7/amcl",), "publishers": {"/robot_7/odom": ("/robot_7/base",)}}, "namespace",
         "others in /robot_7", "--namespace robot_7"),
        ({"publishers": {}}, "base", f"{NS}/odom discovered {WAITED}", RESTART),
        ({"publishers": {"odom": (BASE, "/other")}}, "base", f"2 nodes publish {NS}/odom: {BASE}, /other", "another"),
        ({"nodes": (*robot().nodes, SIM), "publishers": {"odom": (BASE, SIM)}}, "base", BASE, "--sim --domain-id 16"),
        ({"publishers": {"odom": (BASE,), "/clock": ("/a", "/b")}}, "clock", "2 publish /clock: /a, /b", "DOMAIN_ID="),
        ({"delays": {"odom": delays(*[3.0] * 9), "tf": LATE}}, "time of odom", "3.00 s behind", "chronyc makestep"),
        ({"delays": {"odom": LATE, "tf": delays(*[-0.25] * 9)}}, "time of tf", "0.25 s ahead", "apt install chrony"),
        ({"delays": {}}, "time of odom", WAITED, "sudo ufw allow proto udp"),
        ({"ages_s": NO_ODOM}, "base's messages", f"{WAITED}, but scan", RESTART),
        ({"ages_s": {**NO_ODOM, "odom": (6.5,)}}, "base's messages", "odom silent for 6.5 s", RESTART),
        ({"docked": True}, "dock", "docked", UNDOCK),
        ({"charge": 0.1, "docked": True}, "battery", "10 %", "on its dock"),
        ({"charge": 0.19}, "battery", "19 %, less than 20 %", f"ros2 action send_goal {NS}/dock "),
        ({"delays": {}}, "lidar", f"scan not received {WAITED}", MOTOR),
        ({"delays": {"scan": scans(2)}}, "lidar", f"2 scans {WAITED}", MOTOR),
        ({"delays": {}, "docked": True}, "lidar", "scan not received", "undock"),
        ({"delays": {"scan": scans(20, 2.0, 0.9, 5.0)}}, "lidar", "2.0 Hz, 90 % of rays return, 0.20 to 5.00 m", "Hz"),
        ({"delays": {"scan": scans(20, 7.0, 0.01)}}, "lidar", "1 % of rays", "covered"),
        ({"grid": None}, "map", f"map not received {WAITED}", LOCALIZE),
        ({"grid": grid(cells=np.zeros((5, 4), np.int8))}, "map", "not house: size 4 x 5, here 300 x 283", LOCALIZE),
        ({"grid": grid(resolution=0.06)}, "map", "cells of 0.06 m, here 0.05 m", LOCALIZE),
        ({"grid": grid(cells=np.zeros_like(HOUSE.occupancy))}, "map", "% of cells differ", LOCALIZE),
        ({"pose": None}, "pose", f"amcl_pose not received {WAITED}", '"2D Pose Estimate"'),
        ({"pose": None, "nodes": (BASE,), "publishers": {}}, "pose", "amcl_pose not received", LOCALIZE),
        ({"pose": ((99.0, 0.0, 0.0), 0)}, "pose", "off the map", '"2D Pose Estimate"'),
        ({"links": {}}, "tf to base", f"no parent of base_link received on {NS}/tf {WAITED}", RESTART),
        ({"links": STALE_ODOM}, "tf to base", "map > odom is 4.0 s old, more than 1 s", "lidar and dock"),
        ({"links": STALE_BASE}, "tf to base", "odom > base_link is 4.0", RESTART),
        ({"static_links": {}}, "tf to lidar", f"no parent of rplidar_link received on {NS}/tf_static", RESTART),
        ({"navigators": ()}, "Nav2", WAITED, NAV2),
        ({"navigators": ("/a", "/b")}, "Nav2", "2 serve navigate_to_pose: /a, /b", "all but one"),
        ({"states": {"planner_server": "inactive"}}, "Nav2's nodes", "planner_server is inactive", STARTUP),
        ({"subscribers": {}}, "clyde_obstacle", f"local_costmap and global_costmap discovered {WAITED}", NAV2),
        ({"subscribers": {CLOUDS[0]: COSTMAPS}}, "clyde_trail", "local_costmap and global_costmap", NAV2),
        ({"subscribers": {"local_costmap/clyde_obstacle": COSTMAPS[1:]}}, "clyde_obstacle",
         f"but of {NS}/local_costmap/clyde_obstacle", NAV2),
        ({"nodes": AUDIO_LOST}, "game's nodes", f"3 of 4; not discovered {WAITED}: audio_node",
         f"pkill -9 -f 'audio_node.*__ns:={NS}( |$)'"),
        ({"diagnostics": {"selector": "original"}}, "game's nodes", "planner_stub", "--selector"),
        ({"configurations": AUDIO_TWICE}, "game's nodes",
         "audio_node runs 2 times: process 17 on laptop, process 4 on pi", "all but one"),
        ({"processes": {"processes": {GAME: "was killed"}}}, "game's reports", f"{GAME}: was killed", "kill -9 17"),
        ({"ages_s": {"diagnostics": (5.0,), "odom": (0.0,)}}, "game's reports", GAME, "kill -9 17"),
        ({"configurations": (plays(GAME), plays("audio_node", hash="d", configuration=SPEEDY))},
         "configuration", "audio_node plays by clyde.speed_mps 0.35, here 0.25", UP),
        ({"configurations": (OTHER_MAP[0], plays(SELECTOR, map=HASH))}, "configuration", f"map feed, here {HASH}", UP),
        ({"configurations": OTHER_MAP}, "configuration", "goal_selector plays by map feed", "--map FILE_OR_NAME"),
        ({"diagnostics": POSE_LOST}, "game", "menu; lost for 12 s", "localization must publish map to odom"),
        ({"diagnostics": {"troubles": {"pose jumped": 1}}}, "game", "pose jumped",
         "pacman-env ros continue --namespace robot_15"),
        ({"diagnostics": {"troubles": {"policy fails": 1}}}, "game", "policy fails", "--policy"),
        ({"diagnostics": {"troubles": {"Nav2 fails": 2}, "trouble_texts": [1]}}, "game", "Nav2 fails", "Nav2's log"),
    ],
)  # fmt: skip
def test_bad_robot_is_reported_with_figures_and_remedy(
    changes: dict[str, Any], check: str, summary: str, remedy: str
) -> None:
    observations = robot(**changes)
    answered(observations, check, BAD, summary, remedy)
    assert not is_ready(examine(observations))


AMCL_SILENT = {"map_server": "active", "bt_navigator": "active"}


@pytest.mark.parametrize(
    ("changes", "check", "summary", "remedy"),
    [
        ({"environment": {"ROS_DISCOVERY_SERVER": "10.0.0.2:11811"}}, "ROS", "=10.0.0.2:11811", "ROS_SUPER_CLIENT"),
        ({"docked": None}, "dock", f"dock_status not received {WAITED}", "--wait 60"),
        ({"docked": None, "unavailable": {"dock_status": "no type"}}, "dock", "no type", "tools.ros_interfaces.build"),
        ({"charge": None, "unreadable": {"battery_state": "percentage nan"}}, "battery", "percentage nan", "--wait"),
        ({"map": None}, "map", "300 x 283 cells of 0.05 m", "--map FILE_OR_NAME"),
        ({"states": {"bt_navigator": "active"}}, "Nav2's nodes", "lifecycle_manager_localization", LOCALIZE),
        ({"states": {"amcl": "active"}}, "Nav2's nodes", f"lifecycle_manager_navigation {WAITED}; active: amcl", NAV2),
        ({"states": AMCL_SILENT}, "Nav2's nodes", f"amcl {WAITED}; active: map_server, bt_navigator", NAV2),
        ({"publishers": {"odom": (BASE,), "/clock": ("/a",)}}, "clock", "/clock not received", "--wait 30"),
        ({"nodes": (BASE,), "configurations": (), "state": None, "diagnostics": None}, "game's nodes", "", UP),
        ({"configurations": ()}, "configuration", "game/configuration not received", "original game"),
        ({"state": None, "diagnostics": None}, "game", f"game_state not received {WAITED}", "compiles"),
        ({"diagnostics": {"policy": "ppo", "troubles": {"late": 3}}}, "game", "menu, policy ppo, troubles: late (3)",
         "pacman_game.log"),
        ({"diagnostics": {"policy": "ppo", "nav2": False}}, "game", "Nav2 does not answer it", "see"),
        ({"diagnostics": {"policy": 5, "troubles": [1]}, "state": None}, "game", "game_state not received", "see"),
    ],
)  # fmt: skip
def test_unanswered_question_has_reason_and_is_no_fault(
    changes: dict[str, Any], check: str, summary: str, remedy: str
) -> None:
    observations = robot(**changes)
    answered(observations, check, UNKNOWN, summary, remedy)
    assert is_ready(examine(observations))


WITH_NAV2 = f"{UP} --sim --nav2"


@pytest.mark.parametrize(
    ("make", "changes", "check", "remedy"),
    [
        (simulated, {"subscribers": {}}, "clyde_obstacle", f"{UP} --sim"),
        (simulated, {"navigators": ()}, "Nav2", f"{UP} --sim"),
        (simulated, {"grid": None}, "map", f"{UP} --sim"),
        (simulated, {"delays": {}}, "lidar", f"{UP} --sim"),
        (simulated, {"links": {}}, "tf to base", f"{UP} --sim"),
        (simulated, {"static_links": {}}, "tf to lidar", f"{UP} --sim"),
        (simulated, {"ages_s": NO_ODOM, "delays": {"scan": scans(20)}}, "base's messages", f"{UP} --sim"),
        (simulated, {"nodes": (), "publishers": {}}, "domain", f"{UP} --sim"),
        (simulated, {"pose": None}, "pose", '"2D Pose Estimate"'),
        (simulated, {"diagnostics": {"troubles": {"no odometry": 4}}}, "game", f"{UP} --sim"),
        (simulated, {"diagnostics": {"troubles": {"pose jumped": 1}}}, "game", "continue --namespace robot_15 --sim"),
        (base_with_nav2, {"navigators": ()}, "Nav2", f"nav2.log in the folder.*: {WITH_NAV2}"),
        (base_with_nav2, {"states": {}}, "Nav2's nodes", f"nav2.log in the folder.*: {WITH_NAV2}"),
        (base_with_nav2, {"states": {"amcl": "inactive"}}, "Nav2's nodes", "manage_nodes"),
        (base_with_nav2, {"grid": None}, "map", f"nav2.log in the folder.*: {WITH_NAV2}"),
        (base_with_nav2, {"pose": None}, "pose", "RViz"),
        (base_with_nav2, {"subscribers": {}}, "clyde_obstacle", f"nav2.log in the folder.*: {WITH_NAV2}"),
        (base_with_nav2, {"docked": True}, "dock", "undock"),
        (base_with_nav2, {"delays": {}}, "lidar", f"start or restart the simulated game: {WITH_NAV2}"),
    ],
)
def test_remedies_for_simulated_robot_are_no_robot_commands(
    make: Callable[..., Observations], changes: dict[str, Any], check: str, remedy: str
) -> None:
    one = found(make(**changes), check)
    said = f"{one.remedy}: {one.command}"
    assert one.status == BAD
    assert re.search(remedy, said)
    assert "turtlebot4" not in said
    assert make is base_with_nav2 or "ros2 " not in said


def test_skew_within_limits_and_few_outliers_are_accepted() -> None:
    outliers = {"odom": delays(*[0.02] * 9, *[40.0] * 4), "tf": LATE}
    assert found(robot(delays=outliers), "time of odom").status == OK
    late = {"odom": delays(*[0.2] * 9), "scan": scans(9, late_s=0.32), "tf": delays(*[-0.2] * 9)}
    assert is_ready(examine(robot(delays=late)))
    assert found(robot(delays=late | {"scan": scans(9, late_s=0.34)}), "time of scan").status == BAD


def test_clock_of_other_simulation_is_not_used() -> None:
    changes = {"publishers": {"odom": (BASE,), "/clock": ("/sim/robot",)}, "clock": Clock(0.0, 0.0, 1.0, 1.0)}
    late = {"odom": delays(*[3.0] * 9, clock_s=-1.7e9)}
    observations = robot(**changes, delays=late)
    assert "the robot's stamps are not by it" in found(observations, "clock").summary
    assert found(observations, "time of odom").status == BAD
    assert "10.0 times real time" in found(simulated(), "clock").summary
    assert not [f for f in examine(simulated(clock=None)) if f.check.startswith("time of")]


@pytest.mark.parametrize("selector", ["planner_stub", SELECTOR])
def test_game_of_original_needs_one_goal_selector(selector: str) -> None:
    nodes = [name for name in robot().nodes if name.rpartition("/")[2] not in NODES] + [f"/{ORIGINAL_REFEREE}"]
    assert found(robot(nodes=tuple(nodes)), "game's nodes").status == BAD
    assert found(robot(nodes=(*nodes, f"{NS}/{selector}")), "game's nodes").status == OK


def test_old_message_of_game_is_no_answer() -> None:
    def answers(*ages_s: float) -> Finding:
        return found(robot(ages_s={"diagnostics": ages_s}), "game's reports")

    assert not answers(1.0).settled, "an old message of a frozen node"
    assert (answers(1.5, 0.5).status, answers(1.5, 0.5).settled) == (OK, True)


def test_root_namespace_has_one_slash() -> None:
    observations = dataclasses.replace(robot(docked=True, grid=None), namespace="/")
    assert 'send_goal /undock irobot_create_msgs/action/Undock "{}"' in found(observations, "dock").command
    assert "namespace:=" not in found(observations, "map").command


def test_list_fits_80_columns_except_commands() -> None:
    findings = examine(robot(docked=True, subscribers={}, delays={"odom": delays(*[3.0] * 9)}, grid=None))
    commands = {f.command for f in findings if f.command}
    lines = render(findings, "title").splitlines()
    assert {line.strip() for line in lines} >= commands
    assert [line for line in lines if len(line) > 80 and line.strip() not in commands] == []
    assert lines[1].startswith("ok  ROS ")
    assert any(line.startswith("BAD dock ") for line in lines)
    assert lines[-1] == "6 of 22 BAD: time of odom, dock, lidar, map, clyde_obstacle, clyde_trail"
    assert render(examine(robot()), "title").endswith("\nnothing is BAD")


def test_foreign_names_cannot_write_to_terminal() -> None:
    text = render(examine(robot(navigators=("/a\x1b[2J\nBAD all", "/" + "b" * 5000))), "title")
    assert "\x1b" not in text
    assert not any(line.startswith("BAD all") for line in text.splitlines())
    assert len(text) < 6000
