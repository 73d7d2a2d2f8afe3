"""Checks of Nav2 and of the game: servers, nodes, ghosts in costmaps, configuration, state."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from pacman_env.config import differences

from ...discovery import COSTMAPS
from ...game_nodes import GAME, ORIGINAL_SELECTOR, REFEREE, SELECTOR, SIMULATOR
from ...selector.reasons import NO_ODOMETRY, POSE_JUMPED, REMEDIES, SILENCE, SILENT_S, troubles_of
from .check import (
    RESTART_GAME,
    START_AGAIN,
    Check,
    CheckTime,
    Finding,
    Observations,
    Request,
    Source,
    both,
    count,
    listed,
    monitored,
)

CLOUDS = ("clyde_obstacle", "clyde_trail")
#: Managers in Nav2's launch files for Jazzy and the nodes they start (nav2_bringup 1.3.13, f4108e5).
MANAGED: Mapping[str, tuple[str, ...]] = {
    "lifecycle_manager_localization": ("map_server", "amcl"),
    "lifecycle_manager_navigation": (
        *("controller_server", "smoother_server", "planner_server", "route_server", "behavior_server"),
        *("velocity_smoother", "collision_monitor", "bt_navigator", "waypoint_follower", "docking_server"),
    ),
}
MANAGERS = {
    name: Request(f"{name}/is_active", "std_srvs/Trigger", lambda response: bool(response.success)) for name in MANAGED
}
STATES = {
    name: Request(f"{name}/get_state", "lifecycle_msgs/GetState", lambda response: str(response.current_state.label))
    for names in MANAGED.values()
    for name in names
}


def _check_navigator(robot: Observations) -> Finding:
    servers = robot.publishers.get(robot.full("navigate_to_pose/_action/status"), ())
    if len(servers) > 1:
        summary = f"{len(servers)} serve navigate_to_pose: {listed(servers)}"
        return Finding.bad(summary, "end all but one: each of them receives every goal")
    if servers:
        return Finding.ok(f"navigate_to_pose is served by {servers[0]}")
    summary = f"no server of navigate_to_pose discovered {robot.within}"
    return robot.not_yet(summary, "start Nav2", robot.start_nav2)


def _check_lifecycle(robot: Observations) -> Finding:
    if not robot.real_nav2:
        return Finding.unknown("a simulated robot needs none")
    managers = {name: robot.get(request) for name, request in MANAGERS.items()}
    states = {name: state for name, request in STATES.items() if (state := robot.get(request)) is not None}
    active = listed(name for name, state in states.items() if state == "active")
    inactive = {name: f"{name} is {state}" for name, state in states.items() if state != "active"}
    refused = [name for name, answer in managers.items() if answer is False]
    silent = [name for name, answer in managers.items() if answer is None]
    if refused or inactive:
        summary = listed([*(f"{name} is not active" for name in refused), *inactive.values()])
        manager = (refused or [name for name, nodes in MANAGED.items() if inactive.keys() & set(nodes)])[0]
        service = robot.full(f"{manager}/manage_nodes")
        command = f'ros2 service call {service} nav2_msgs/srv/ManageLifecycleNodes "{{command: 0}}"'
        return Finding.bad(summary, "start them up; the launch file's log names the reason", command)
    if silent:
        summary = f"{' and '.join(silent)} not answering {robot.within}; active: {active or 'none known'}"
        command = robot.start_nav2 if silent == ["lifecycle_manager_navigation"] else robot.start_localization
        if robot.virtual:
            return robot.not_yet(summary, "", command)
        return Finding.unknown(summary, "if it does not run, start it", command, settled=False)
    return Finding.ok(f"localization and navigation are active: {active}".removesuffix(": "))


def _check_cloud(topic: str, robot: Observations) -> Finding:
    subscribers = robot.subscribers_of(topic)
    if not robot.real_nav2:
        simulator = robot.full(SIMULATOR)
        if simulator in subscribers:
            return Finding.ok(f"{simulator} subscribes to it, in place of the costmaps")
        if topic != CLOUDS[0]:
            return Finding.unknown("a simulated robot needs none: Clyde's trail is cleared without it")
        return robot.not_yet(f"no subscription of {simulator} discovered {robot.within}", "")
    missing = [name for name in COSTMAPS if robot.full(f"{name}/{name}") not in subscribers]
    if not missing:
        return Finding.ok(f"{' and '.join(COSTMAPS)} subscribe to it")
    summary = f"no subscription of {' and '.join(missing)} discovered {robot.within}"
    others = [robot.full(f"{costmap}/{topic}") for costmap in COSTMAPS]  # names if Nav2's file has a relative topic
    if others := [name for name in others if robot.subscribers_of(name)]:
        summary += f", but of {listed(others)}, which no node publishes"
    remedy = "Nav2 does not see Clyde: launch it with the game's config/nav2.yaml, from the checkout"
    return robot.not_yet(summary, remedy, robot.start_nav2)


def _add_configuration(previous: Any, message: Any, arrival: CheckTime) -> Any:
    from ...game_monitor import add_process, configuration_of

    return add_process(previous or {}, configuration_of(message))


CONFIGURATIONS = Source("game/configuration", "std_msgs/String", _add_configuration, "COMMANDS")
STATE = monitored("state", "game_state", "std_msgs/String")
DIAGNOSTICS = monitored("condition", "goal_selector/diagnostics", "std_msgs/String")
#: Monotonic times, s, of the last two diagnostics. If there is only one, it may be an old message of a frozen node.
ARRIVALS: Source[tuple[float, ...]] = Source(
    *(DIAGNOSTICS.name, DIAGNOSTICS.type_name),
    lambda previous, message, arrival: (*(previous or ())[-1:], arrival.monotonic_s),
    "LATCHED",
)
UNRESPONSIVE = monitored("unresponsive", "game/unresponsive", "std_msgs/String")


def _configurations(robot: Observations) -> list[Mapping[str, Any]]:
    """Return the configurations of existing nodes; a restarted node has published several."""
    counts = Counter(name.rpartition("/")[2] for name in robot.publishers.get(robot.full(CONFIGURATIONS.name), ()))
    nodes: list[Mapping[str, Any]] = []
    for (name, _), configured in sorted((robot.get(CONFIGURATIONS) or {}).items(), key=lambda pair: pair[0])[::-1]:
        if sum(other["node"] == name for other in nodes) < max(counts[name], 1):
            nodes.append(configured)
    return nodes


def _check_game_nodes(robot: Observations) -> Finding:
    names = [*((SIMULATOR,) if robot.virtual else ()), *GAME, SELECTOR]
    discovered = {name for name in names if robot.full(name) in robot.nodes}
    if robot.full(ORIGINAL_SELECTOR) in robot.nodes:
        discovered.add(SELECTOR)
    missing = [name for name in names if name not in discovered]
    if duplicates := _duplicates(robot):
        remedy = "end all but one: Ctrl-C in the terminal of the other ros up or ros2 launch"
        return Finding.bad("; ".join(duplicates), remedy)
    if not missing:
        return Finding.ok(f"all {len(names)} are there")
    if not discovered - {SIMULATOR}:
        remedy = "start the game when all other checks are ok"
        return Finding.unknown("no node of the game discovered", remedy, robot.start_game, settled=False)
    remedy = f"it ended or is frozen: {START_AGAIN}; the game's terminal and its log name the reason"
    if missing == [SELECTOR]:
        remedy = f"it starts when the robot has a pose; else {remedy}"
    summary = f"{len(discovered)} of {len(names)}; not discovered {robot.within}: {listed(missing)}"
    command = f"pkill -9 -f '{missing[0]}.*__ns:={robot.namespace}( |$)'"
    return Finding.bad(summary, remedy, command, settled=False)


def _duplicates(robot: Observations) -> list[str]:
    """List the nodes that run several times although only one may act, each with its processes."""
    processes: dict[str, list[str]] = {}
    for configured in reversed(_configurations(robot)):
        if configured["acts"]:
            _, host, number = configured["started"]
            processes.setdefault(configured["node"], []).append(f"process {number} on {host}")
    return [f"{name} runs {len(ids)} times: {listed(ids)}" for name, ids in processes.items() if len(ids) > 1]


def _check_responses(robot: Observations) -> Finding | None:
    if robot.full(REFEREE) not in robot.nodes:
        return None
    reasons, arrivals = robot.get(UNRESPONSIVE), robot.get(ARRIVALS) or ()
    if arrivals and (silent_s := robot.now.monotonic_s - arrivals[-1]) > SILENT_S:
        reasons = {**(reasons or {}), SELECTOR: SILENCE.format(silent_s)}
    if reasons is None:
        return Finding.unknown(robot.silence(UNRESPONSIVE.name), "nodes of the original game do not report it")
    if not reasons:
        return replace(Finding.ok("what the referee asks for is done"), settled=len(arrivals) != 1)
    ids = {one["node"]: one["started"][2] for one in _configurations(robot)}
    summary = listed(f"{node} does not respond, {reason}" for node, reason in reasons.items())
    number = next((ids[node] for node in reasons if node in ids), None)
    return Finding.bad(summary, START_AGAIN, "" if number is None else f"kill -9 {number}")


def _check_configuration(robot: Observations) -> Finding:
    nodes = sorted(_configurations(robot), key=lambda one: (one["node"] != REFEREE, one["node"]))
    if not nodes:
        if not any(robot.full(name) in robot.nodes for name in GAME):
            return Finding.unknown("no node of the game to compare")
        remedy = "restart the game; nodes of the original game publish no configuration"
        return Finding.unknown(robot.silence(CONFIGURATIONS.name), remedy, settled=False)
    first, wrong = nodes[0], []
    for one in nodes[1:]:
        fields = differences(one["configuration"], first["configuration"])
        if fields:
            words = [f"{name} {own}, there {other}" for name, (own, other) in fields.items()]
            wrong.append(f"{one['node']} plays by {listed(words)}")
        elif one["hash"] != first["hash"]:
            wrong.append(f"{one['node']} plays by {one['hash']}, {first['node']} by {first['hash']}")
    reference = f" (there: {first['node']})" if wrong else ""
    maps = {str(one["node"]): str(one["map"]) for one in nodes if one["map"] is not None}
    whose, ours = next(((f"{node}'s map", other) for node, other in maps.items()), ("", None))
    if robot.map is not None:
        whose, ours = f"map {robot.map.name}", robot.map.hash[:12]
    for other in dict.fromkeys(one for one in maps.values() if one != ours):
        names = [node for node, one in maps.items() if one == other]
        wrong.append(f"{both(names)} play{'s' if len(names) == 1 else ''} on {other}, {whose} is {ours}")
    if wrong:
        remedy = "start all nodes with the same --map, --preset, --execution and --set"
        agree = len(wrong) == len(set(maps.values())) == 1 and ours not in maps.values()
        if robot.map is not None and agree:
            remedy = f"ask with the map that they play on, --map FILE_OR_NAME; else {remedy}"
        return Finding.bad(listed(wrong) + reference, remedy, robot.start_game)
    return Finding.ok(f"{count(len(nodes), 'node')} by {first['hash']}{f' on map {ours}' if maps else ''}")


def _remedy(robot: Observations, trouble: str) -> tuple[str, str]:
    """Return remedy and command for a trouble of the goal selector."""
    if trouble == NO_ODOMETRY and robot.virtual:
        return RESTART_GAME, robot.start_game
    if trouble == POSE_JUMPED:
        place = robot.namespace.strip("/") or "/"
        return REMEDIES[trouble], f"pacman-env ros continue --namespace {place}{' --sim' if robot.virtual else ''}"
    return REMEDIES[trouble], ""


def _check_game(robot: Observations) -> Finding:
    state, condition = robot.get(STATE), robot.get(DIAGNOSTICS) or {}
    if state is None and not condition:
        if not {robot.full(REFEREE), robot.full(SELECTOR)} & set(robot.nodes):
            return Finding.unknown("no game is in progress")
        remedy = "wait: the first start compiles for about a minute"
        return Finding.unknown(robot.silence(STATE.name), remedy, settled=False)
    policy, troubles = condition.get("policy"), troubles_of(condition)
    if serious := [kind for kind in REMEDIES if kind in troubles]:
        summary = "; ".join([state or robot.silence(STATE.name), *(troubles[kind] for kind in serious)])
        return Finding.bad(summary, *_remedy(robot, serious[0]))
    counted = [f"{kind} ({condition['troubles'][kind]})" for kind in troubles if kind != "no Nav2"]
    faults = [
        *(["the goal selector is not active"] if condition.get("active") is False else []),
        *(["Nav2 does not answer it"] if condition.get("nav2") is False else []),
        *([f"troubles: {listed(counted)}"] if counted else []),
    ]
    words = [state or robot.silence(STATE.name), robot.silence(DIAGNOSTICS.name)]
    if policy is not None:
        words[1] = f"policy {policy}"
    summary, settled = ", ".join([*words, *faults]), state is not None and policy is not None
    if settled and not faults:
        return Finding.ok(summary)
    remedy = "see its log for details: goal_selector.log in the folder that ros up names" if counted else ""
    return Finding.unknown(summary, remedy or "see the lines above", settled=settled)


_LIFECYCLE: tuple[Request[Any], ...] = (*MANAGERS.values(), *STATES.values())
CHECKS = (
    Check("Nav2", "Does exactly one node serve navigate_to_pose?", _check_navigator),
    Check("Nav2's nodes", "Are the nodes of localization and navigation active?", _check_lifecycle, _LIFECYCLE),
    *(Check(topic, f"Do both costmaps subscribe to {topic}?", partial(_check_cloud, topic)) for topic in CLOUDS),
    Check("game's nodes", "Does each node of the game run exactly once?", _check_game_nodes, (CONFIGURATIONS,)),
    Check(
        "game's answers",
        "Do all nodes do what the referee asks them to?",
        _check_responses,
        (UNRESPONSIVE, ARRIVALS, CONFIGURATIONS),
    ),
    Check(
        "configuration", "Do all nodes have the same configuration and map?", _check_configuration, (CONFIGURATIONS,)
    ),
    Check("game", "What is the state of the game?", _check_game, (STATE, DIAGNOSTICS)),
)
