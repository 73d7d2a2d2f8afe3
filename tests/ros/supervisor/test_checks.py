"""Each check of a robot, good and bad, and the remedy of everything that is bad. No ROS runs here."""

import dataclasses
from collections import deque
from typing import Any

import numpy as np
import pytest

from pacman_env.ros.game_nodes import GAME, SELECTOR, SIMULATOR
from pacman_env.ros.map_comparison import Grid
from pacman_env.ros.supervisor.checks import CHECKS, examine, is_ready, render
from pacman_env.ros.supervisor.checks.check import BAD, OK, UNKNOWN, CheckTime, Finding, Observations, Source
from pacman_env.ros.supervisor.checks.domain import CLOCK, STAMPS, Clock, Delays
from pacman_env.ros.supervisor.checks.game import (
    ARRIVALS,
    CLOUDS,
    CONFIGURATIONS,
    DIAGNOSTICS,
    MANAGERS,
    STATE,
    STATES,
    UNRESPONSIVE,
)
from pacman_env.ros.supervisor.checks.robot import CHARGE, DOCKED, GRID, LINKS, POSE, SCANS, Link, ScanTally
from pacman_env.world.maps.occupancy import load_map

HOUSE = load_map("house")
NS = "/robot_15"
HASH = HOUSE.hash[:12]
COSTMAPS = (f"{NS}/global_costmap/global_costmap", f"{NS}/local_costmap/local_costmap")
BASE, LIDAR, NAVIGATOR = f"{NS}/create3_repub", f"{NS}/rplidar_composition", f"{NS}/bt_navigator"
SIM = f"{NS}/{SIMULATOR}"
NOW = CheckTime(wall_s=1000.0, monotonic_s=50.0)
WAITED = "within 10 s"
SOURCES: dict[str, Source[Any]] = {
    "clock": CLOCK,
    "grid": GRID,
    "pose": POSE,
    "links": LINKS,
    "scans": SCANS,
    "docked": DOCKED,
    "charge": CHARGE,
    "state": STATE,
    "condition": DIAGNOSTICS,
    "unresponsive": UNRESPONSIVE,
    "arrivals": ARRIVALS,
}


def delays(*wall_s: float, clock_s: tuple[float, ...] = (), turn_s: float = 0.0) -> Delays:
    return Delays(deque(wall_s), deque(clock_s), turn_s)


LATE = delays(*[0.02] * 20)


def silent(age_s: float) -> Delays:
    return dataclasses.replace(LATE, last_s=NOW.monotonic_s - age_s)


def scans(
    count: int, rate_hz: float, share: float, nearest_m: float, farthest_m: float, frame: str = "l"
) -> deque[ScanTally]:
    returns = round(100 * share)
    return deque(ScanTally(number / rate_hz, 100, returns, nearest_m, farthest_m, frame) for number in range(count))


def link(parent: str, age_s: float | None) -> Link:
    return Link(parent, None if age_s is None else NOW.monotonic_s - age_s)


def plays(node: str, **changes: Any) -> dict[str, Any]:
    content = {
        "node": node,
        "acts": True,
        "started": (1000.0, "laptop", 17),
        "hash": "abc",
        "map": HASH if node in ("pellet_manager", SELECTOR) else None,
        "configuration": {"clyde": {"speed_mps": 0.25}, "show": {"start_s": 8.0}},
    }
    return content | changes


def grid(**changes: Any) -> Grid:
    house: dict[str, Any] = {"resolution": float(np.float32(HOUSE.resolution)), "origin": HOUSE.origin}
    return Grid(**{**house, "cells": np.flipud(HOUSE.occupancy), **changes})


def full(name: str) -> str:
    return name if name.startswith("/") else f"{NS}/{name}"


def observed(**facts: Any) -> Observations:
    """Observations from facts by name: those of sources, and the graph's with relative names of topics."""
    values: dict[Any, Any] = {SOURCES[name]: facts.pop(name) for name in list(facts) if name in SOURCES}
    for group, sources in (("delays", STAMPS), ("managers", MANAGERS), ("states", STATES)):
        values |= {sources[name]: value for name, value in facts.pop(group).items()}
    configurations = facts.pop("configurations")
    values[CONFIGURATIONS] = {(one["node"], one["started"]): one for one in configurations}
    publishers = {full(topic): nodes for topic, nodes in facts.pop("publishers").items()}
    publishers[full("navigate_to_pose/_action/status")] = facts.pop("navigators")
    publishers[full("game/configuration")] = tuple(f"{NS}/{one['node']}" for one in configurations)
    subscribers = {full(topic): nodes for topic, nodes in facts.pop("subscribers").items()}
    return Observations(NS, 10.0, NOW, publishers=publishers, subscribers=subscribers, values=values, **facts)


FACTS: dict[str, Any] = {
    "domain": 15,
    "map": HOUSE,
    "map_file": "house",
    "middleware": "rmw_fastrtps_cpp",
    "nodes": (BASE, LIDAR, NAVIGATOR, f"{NS}/amcl", *COSTMAPS, *(f"{NS}/{name}" for name in (*GAME, SELECTOR))),
    "publishers": {"odom": (BASE,), "scan": (LIDAR,), "tf": (BASE,), "amcl_pose": (f"{NS}/amcl",)},
    "subscribers": dict.fromkeys(CLOUDS, COSTMAPS),
    "delays": {"odom": LATE, "scan": delays(*[0.15] * 9, turn_s=0.13), "tf": LATE},
    "grid": grid(),
    "pose": ((0.0, 0.0, 0.0), 800 * 10**9),  # standing still, AMCL is silent
    "links": {"odom": link("map", 0.1), "base_link": link("odom", 0.05), "rplidar_link": link("base_link", None)},
    "scans": scans(20, 7.5, 0.95, 0.3, 8.0, "rplidar_link"),
    "docked": False,
    "charge": 0.8,
    "navigators": (NAVIGATOR,),
    "managers": dict.fromkeys(MANAGERS, True),
    "states": {"amcl": "active", "bt_navigator": "active"},
    "configurations": tuple(plays(name) for name in (*GAME, SELECTOR)),
    "state": "menu",
    "condition": {"policy": "ppo", "active": True, "nav2": True, "troubles": {}},
    "unresponsive": {},
    "arrivals": (NOW.monotonic_s - 1.0, NOW.monotonic_s),
}


def robot(**changes: Any) -> Observations:
    """A real robot in a game where all is well, but for the changes."""
    return observed(**{**FACTS, **changes})


def simulated(**changes: Any) -> Observations:
    facts = {
        "simulated": True,
        "nodes": (SIM, *(f"{NS}/{name}" for name in (*GAME, SELECTOR))),
        "publishers": dict.fromkeys(("odom", "scan", "tf", "amcl_pose", "/clock"), (SIM,)),
        "subscribers": {CLOUDS[0]: (SIM,)},
        "delays": {"odom": delays(*[1.7e9] * 20, clock_s=(0.05,) * 20)},
        "clock": Clock(0.0, 0.0, 1.0, 10.0),
        "docked": None,
        "charge": None,
        "navigators": (SIM,),
        "managers": {},
        "states": {},
    }
    return robot(**{**facts, **changes})


BRINGUP_NODES = (f"{NS}/amcl", f"{NS}/map_server", NAVIGATOR, *COSTMAPS)


def base_with_nav2(**changes: Any) -> Observations:
    """A simulated base that a real Nav2 drives."""
    of_nav2 = {"amcl_pose": (f"{NS}/amcl",), "map": (f"{NS}/map_server",)}
    facts = {
        "nodes": (SIM, *BRINGUP_NODES, *(f"{NS}/{name}" for name in (*GAME, SELECTOR))),
        "publishers": {**dict.fromkeys(("odom", "scan", "tf", "/clock", "battery_state"), (SIM,)), **of_nav2},
        "subscribers": dict.fromkeys(CLOUDS, COSTMAPS),
        "docked": False,
        "charge": 0.9,
        "navigators": (NAVIGATOR,),
        "managers": dict.fromkeys(MANAGERS, True),
        "states": {"amcl": "active", "bt_navigator": "active"},
    }
    return simulated(**{**facts, **changes})


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


def test_good_robot_is_ready_and_settled() -> None:
    findings = examine(robot())
    assert [(f.check, f.summary) for f in findings if f.status != OK or f.remedy or not f.settled] == []
    assert is_ready(findings)


def test_good_base_with_nav2_is_ready() -> None:
    findings = examine(base_with_nav2())
    assert [(f.check, f.summary) for f in findings if f.status != OK] == []


@pytest.mark.parametrize(
    ("changes", "check", "summary", "remedy"),
    [
        ({"navigators": ()}, "Nav2", "no server of navigate_to_pose", "nav2.log"),
        ({"managers": {}, "states": {}}, "Nav2's nodes", "not answering", "nav2.log"),
        ({"states": {"amcl": "inactive"}}, "Nav2's nodes", "amcl is inactive", "manage_nodes"),
        ({"grid": None}, "map", "map not received", "nav2.log"),
        ({"pose": None}, "pose", "amcl_pose not received", "RViz"),
        ({"subscribers": {}}, "clyde_obstacle", "no subscription of local_costmap", "nav2.log"),
        ({"docked": True}, "dock", "docked, where", "undock"),
        ({"scans": None}, "lidar", "scan not received", "start or restart the simulated game"),
    ],
)
def test_nav2_trouble_on_simulated_base_has_fitting_remedy(
    changes: dict[str, Any], check: str, summary: str, remedy: str
) -> None:
    finding = answered(base_with_nav2(**changes), check, BAD, summary, remedy)
    assert "turtlebot4" not in finding.command
    if finding.command.startswith("pacman-env"):
        assert finding.command == f"pacman-env ros up --map house --namespace {NS.strip('/')} --sim --nav2"


def test_good_simulated_robot_has_no_dock_or_battery() -> None:
    findings = examine(simulated())
    assert [f.check for f in findings if f.status != OK] == ["dock", "battery", "Nav2's nodes", "clyde_trail"]
    assert all(f.settled for f in findings)
    assert is_ready(findings)
    assert "10.0 times real time" in found(simulated(), "clock").summary


UNDOCK = f'ros2 action send_goal {NS}/undock irobot_create_msgs/action/Undock "{{}}"'
NAV2 = f"ros2 launch turtlebot4_navigation nav2.launch.py namespace:={NS} params_file:=$PWD/config/nav2.yaml"
LOCALIZE = f"ros2 launch turtlebot4_navigation localization.launch.py namespace:={NS} map:=$PWD/maps/house.yaml"
RESTART = "sudo systemctl restart turtlebot4"
STARTUP = f'{NS}/lifecycle_manager_navigation/manage_nodes nav2_msgs/srv/ManageLifecycleNodes "{{command: 0}}"'
UP = "pacman-env ros up --map house --namespace robot_15"
THREE = "clyde_ghost_node", SELECTOR, "pellet_manager"
SPEEDY = {"clyde": {"speed_mps": 0.35}, "show": {"start_s": 8.0}}


@pytest.mark.parametrize(
    ("changes", "check", "summary", "remedy"),
    [
        ({"environment": {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}}, "ROS", "sees no other program", "RANGE=SUBNET"),
        ({"nodes": ()}, "domain", f"no node discovered in domain 15 {WAITED}", "one ROS_DOMAIN_ID"),
        ({"nodes": ("/robot_7/amcl",), "publishers": {"/robot_7/odom": ("/robot_7/base",)}}, "namespace",
         "others in /robot_7", "did you mean --namespace robot_7?"),
        ({"publishers": {}}, "base", f"no publisher of {NS}/odom discovered {WAITED}", RESTART),
        ({"publishers": {"odom": (BASE, "/other")}}, "base", f"2 nodes publish {NS}/odom: {BASE}, /other",
         "set another for"),
        ({"nodes": (*robot().nodes, SIM), "publishers": {"odom": (BASE, SIM)}}, "base",
         f"a simulated robot, {SIM}, and a real one, {BASE}", "--sim --domain-id 16"),
        ({"publishers": {"odom": (BASE,), "/clock": ("/a/sim", "/b/sim")}}, "clock", "2 publish /clock: /a/sim, /b/sim",
         "ROS_DOMAIN_ID=16"),
        ({"delays": {"odom": delays(*[3.0] * 9), "tf": LATE}}, "time of odom", "3.00 s behind this machine's clock",
         "sudo chronyc makestep"),
        ({"delays": {"odom": LATE, "tf": delays(*[-0.25] * 9)}}, "time of tf", "0.25 s ahead of this machine's clock",
         "apt install chrony"),
        ({"delays": {}}, "time of odom", f"odom not received {WAITED}", "sudo ufw allow proto udp"),
        ({"delays": {"scan": LATE}}, "base's messages", f"odom not received {WAITED}, but scan: create3_republisher",
         RESTART),
        ({"delays": {"odom": silent(6.5), "scan": LATE}}, "base's messages", "odom silent for 6.5 s, but scan is not",
         RESTART),
        ({"docked": True}, "dock", "docked, where", UNDOCK),
        ({"charge": 0.1, "docked": True}, "battery", "10 %, less than", "leave it on its dock"),
        ({"charge": 0.19}, "battery", "19 %, less than 20 %", f"ros2 action send_goal {NS}/dock "),
        ({"scans": None}, "lidar", f"scan not received {WAITED}", f"ros2 service call {NS}/start_motor std_srvs/srv/"),
        ({"scans": None, "docked": True}, "lidar", "scan not received", "undock: a docked TurtleBot 4 stops it"),
        ({"scans": scans(20, 2.0, 0.9, 0.2, 5.0)}, "lidar", "2.0 Hz, 90 % of rays return, 0.20 to 5.00 m",
         "run the game on the robot"),
        ({"scans": scans(20, 7.0, 0.01, 0.2, 0.3)}, "lidar", "1 % of rays", "covered"),
        ({"grid": None}, "map", f"map not received {WAITED}", LOCALIZE),
        ({"grid": grid(cells=np.zeros((5, 4), np.int8))}, "map", "not house: size 4 x 5, here 300 x 283", LOCALIZE),
        ({"grid": grid(resolution=0.06)}, "map", "cells of 0.06 m, here 0.05 m", LOCALIZE),
        ({"grid": grid(cells=np.zeros_like(HOUSE.occupancy))}, "map", "% of cells differ", LOCALIZE),
        ({"pose": None}, "pose", f"amcl_pose not received {WAITED}: no initial pose yet", '"2D Pose Estimate"'),
        ({"pose": None, "nodes": (BASE,), "publishers": {}}, "pose", "amcl_pose not received", LOCALIZE),
        ({"pose": ((99.0, 0.0, 0.0), 0)}, "pose", "off the map", '"2D Pose Estimate"'),
        ({"links": {}}, "tf to base", f"no parent of base_link received on {NS}/tf {WAITED}", RESTART),
        ({"links": {"odom": link("map", 4.0), "base_link": link("odom", 0.1)}}, "tf to base",
         "map > odom is 4.0 s old, more than 1 s", "see lidar and dock"),
        ({"links": {"odom": link("map", 0.1), "base_link": link("odom", 4.0)}}, "tf to base", "odom > base_link is 4.0",
         RESTART),
        ({"links": {"odom": link("map", 0.1), "base_link": link("odom", 0.1)}}, "tf to lidar",
         f"no parent of rplidar_link received on {NS}/tf_static", RESTART),
        ({"navigators": ()}, "Nav2", f"no server of navigate_to_pose discovered {WAITED}", NAV2),
        ({"navigators": ("/a", "/b")}, "Nav2", "2 serve navigate_to_pose: /a, /b", "end all but one"),
        ({"managers": {"lifecycle_manager_localization": True, "lifecycle_manager_navigation": False}}, "Nav2's nodes",
         "lifecycle_manager_navigation is not active", STARTUP),
        ({"states": {"planner_server": "inactive"}}, "Nav2's nodes", "planner_server is inactive", STARTUP),
        ({"subscribers": {}}, "clyde_obstacle",
         f"no subscription of local_costmap and global_costmap discovered {WAITED}", NAV2),
        ({"subscribers": {CLOUDS[0]: COSTMAPS}}, "clyde_trail",
         "no subscription of local_costmap and global_costmap", NAV2),
        ({"subscribers": {"local_costmap/clyde_obstacle": COSTMAPS[1:]}}, "clyde_obstacle",
         f"but of {NS}/local_costmap/clyde_obstacle, which no node publishes", NAV2),
        ({"nodes": tuple(n for n in robot().nodes if "audio" not in n)}, "game's nodes",
         f"6 of 7; not discovered {WAITED}: audio_node", f"pkill -9 -f 'audio_node.*__ns:={NS}( |$)'"),
        ({"nodes": tuple(n for n in robot().nodes if SELECTOR not in n)}, "game's nodes", "goal_selector",
         "it starts when the robot has a pose"),
        ({"configurations": (plays("audio_node"), plays("audio_node", started=(2000.0, "pi", 4)))}, "game's nodes",
         "audio_node runs 2 times: process 17 on laptop, process 4 on pi", "end all but one"),
        ({"unresponsive": {"pellet_manager": "reset_pellets: no answer to 3 calls"}}, "game's answers",
         "pellet_manager does not respond, reset_pellets: no answer to 3 calls", "kill -9 17"),
        ({"configurations": (plays("game_controller"), plays("audio_node", hash="d", configuration=SPEEDY))},
         "configuration", "audio_node plays by clyde.speed_mps 0.35, there 0.25 (there: game_controller)", UP),
        ({"configurations": (plays("pellet_manager", map="feed"),)}, "configuration",
         f"pellet_manager plays on feed, map house is {HASH}", UP),
        ({"configurations": tuple(plays(name, map="feed") for name in THREE)},
         "configuration", f"clyde_ghost_node, goal_selector and pellet_manager play on feed, map house is {HASH}",
         "ask with the map that they play on"),
    ],
)  # fmt: skip
def test_bad_robot_is_reported_with_figures_and_remedy(
    changes: dict[str, Any], check: str, summary: str, remedy: str
) -> None:
    observations = robot(**changes)
    answered(observations, check, BAD, summary, remedy)
    assert not is_ready(examine(observations))


@pytest.mark.parametrize(
    ("changes", "check", "summary", "remedy"),
    [
        ({"environment": {"ROS_DISCOVERY_SERVER": "10.0.0.2:11811"}}, "ROS", "ROS_DISCOVERY_SERVER=10.0.0.2:11811",
         "export ROS_SUPER_CLIENT=True"),
        ({"docked": None}, "dock", f"dock_status not received {WAITED}", "--wait 60"),
        ({"docked": None, "unavailable": {"dock_status": "no type"}}, "dock", "no type", "tools.ros_interfaces.build"),
        ({"charge": None, "unreadable": {"battery_state": "percentage nan"}}, "battery", "percentage nan", "--wait"),
        ({"map": None}, "map", "300 x 283 cells of 0.05 m; not compared", "--map FILE_OR_NAME"),
        ({"managers": {}}, "Nav2's nodes", f"not answering {WAITED}; active: amcl, bt_navigator", LOCALIZE),
        ({"managers": {"lifecycle_manager_localization": True}}, "Nav2's nodes", "lifecycle_manager_navigation", NAV2),
        ({"publishers": {"odom": (BASE,), "/clock": ("/a",)}}, "clock", "/clock not received", "--wait 30"),
        ({"nodes": (BASE, *COSTMAPS), "configurations": (), "state": None, "condition": None}, "game's nodes",
         "no node of the game discovered", UP),
        ({"configurations": ()}, "configuration", "game/configuration not received", "nodes of the original game"),
        ({"state": None, "condition": None}, "game", f"game_state not received {WAITED}", "compiles"),
        ({"condition": {"policy": "ppo", "troubles": {"late": 3}}}, "game", "menu, policy ppo, troubles: late (3)",
         "goal_selector.log"),
        ({"condition": {"policy": "ppo", "nav2": False}}, "game", "Nav2 does not answer it", "see the lines above"),
        ({"condition": {"policy": 5, "troubles": [1]}, "state": None}, "game", "game_state not received", "see"),
    ],
)  # fmt: skip
def test_unanswered_question_has_reason_and_is_no_fault(
    changes: dict[str, Any], check: str, summary: str, remedy: str
) -> None:
    observations = robot(**changes)
    answered(observations, check, UNKNOWN, summary, remedy)
    assert is_ready(examine(observations))


@pytest.mark.parametrize(
    ("changes", "check", "remedy"),
    [
        ({"subscribers": {}}, "clyde_obstacle", f"{UP} --sim"),
        ({"navigators": ()}, "Nav2", f"{UP} --sim"),
        ({"grid": None}, "map", f"{UP} --sim"),
        ({"scans": None}, "lidar", f"{UP} --sim"),
        ({"links": {}}, "tf to base", f"{UP} --sim"),
        ({"links": {}}, "tf to lidar", f"{UP} --sim"),
        ({"delays": {"scan": LATE}}, "base's messages", f"{UP} --sim"),
        ({"nodes": (), "publishers": {}}, "domain", f"{UP} --sim"),
        ({"pose": None}, "pose", '"2D Pose Estimate"'),
        ({"condition": {"troubles": {"no odometry": 4}}}, "game", f"{UP} --sim"),
        ({"condition": {"troubles": {"pose jumped": 1}}}, "game", "pacman-env ros continue --namespace robot_15 --sim"),
    ],
)
def test_remedies_for_simulated_robot_are_no_robot_commands(changes: dict[str, Any], check: str, remedy: str) -> None:
    one = answered(simulated(**changes), check, BAD, "", remedy)
    assert "ros2 " not in one.command + one.remedy
    assert "turtlebot4" not in one.command + one.remedy


@pytest.mark.parametrize(
    ("condition", "summary", "remedy"),
    [
        ({"policy": "ppo", "troubles": {"late": 3, "pose lost": 9}, "trouble_texts": {"pose lost": "lost for 12 s"}},
         "lost for 12 s", "localization must publish map to odom"),
        ({"troubles": {"pose jumped": 1}}, "pose jumped", "pacman-env ros continue --namespace robot_15"),
        ({"troubles": {"policy fails": 1}}, "policy fails", "correct the policy, or play with another one"),
        ({"troubles": {"Nav2 fails": 2}, "trouble_texts": [1]}, "Nav2 fails", "see Nav2's log"),  # of another version
    ],
)  # fmt: skip
def test_trouble_that_stops_game_is_bad(condition: dict[str, Any], summary: str, remedy: str) -> None:
    one = answered(robot(condition=condition, state="running"), "game", BAD, summary, remedy)
    assert one.summary == f"running; {summary}"


def test_skew_within_limits_and_few_outliers_are_accepted() -> None:
    outliers = {"odom": delays(*[0.02] * 9, *[40.0] * 4), "tf": LATE}
    assert found(robot(delays=outliers), "time of odom").status == OK
    late = {"odom": delays(*[0.2] * 9), "scan": delays(*[0.32] * 9, turn_s=0.13), "tf": delays(*[-0.2] * 9)}
    assert is_ready(examine(robot(delays=late)))
    later = delays(*[0.34] * 9, turn_s=0.13)
    assert found(robot(delays=late | {"scan": later}), "time of scan").status == BAD


def test_clock_of_other_simulation_is_not_used() -> None:
    changes = {"publishers": {"odom": (BASE,), "/clock": ("/sim/robot",)}, "clock": Clock(0.0, 0.0, 1.0, 1.0)}
    late = {"odom": delays(*[3.0] * 9, clock_s=(-1.7e9,) * 9)}
    observations = robot(**changes, delays=late)
    assert "the robot's stamps are not by it" in found(observations, "clock").summary
    assert found(observations, "time of odom").status == BAD
    assert not [f for f in examine(simulated(clock=None)) if f.check.startswith("time of")]


def test_original_planner_counts_as_goal_selector() -> None:
    nodes = [f"{NS}/planner_stub" if name == f"{NS}/{SELECTOR}" else name for name in robot().nodes]
    assert found(robot(nodes=tuple(nodes)), "game's nodes").status == OK


def test_selector_without_diagnostics_does_not_respond() -> None:
    def answers(*ages_s: float) -> Finding:
        return found(robot(arrivals=tuple(NOW.monotonic_s - age_s for age_s in ages_s)), "game's answers")

    silent = answers(5.0)
    assert (silent.status, silent.command) == (BAD, "kill -9 17")
    assert SELECTOR in silent.summary
    assert "5 s" in silent.summary
    assert not answers(1.0).settled, "an old message of a frozen node"
    assert (answers(1.5, 0.5).status, answers(1.5, 0.5).settled) == (OK, True)


def test_root_namespace_has_one_slash() -> None:
    observations = dataclasses.replace(robot(docked=True, grid=None), namespace="/")
    assert 'send_goal /undock irobot_create_msgs/action/Undock "{}"' in found(observations, "dock").command
    assert "namespace:=" not in found(observations, "map").command


def test_list_fits_80_columns_except_commands() -> None:
    findings = examine(robot(docked=True, scans=None, subscribers={}, delays={"odom": delays(*[3.0] * 9)}, grid=None))
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
