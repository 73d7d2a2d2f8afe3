"""Checks of Nav2 and of the game: servers, nodes, ghosts in costmaps, configuration, state."""

from collections import Counter
from collections.abc import Mapping
from functools import partial
from itertools import groupby, islice
from operator import itemgetter
from typing import Any

from pacman_env.config import differences

from ... import topics
from ...discovery import COSTMAPS
from ...game_monitor import MONITORED, Processes, add_process
from ...game_nodes import GAME, LISTENERS, ORIGINAL_SELECTOR, ORIGINALS, OURS, SELECTOR, SIMULATOR, needed_nodes
from ...message_conversion import configuration_of
from ...selector.reasons import NO_ODOMETRY, POSE_JUMPED, REMEDIES, SILENCE, SILENT_S, troubles_of
from .check import (
    RESTART_GAME,
    Check,
    CheckTime,
    Finding,
    Observations,
    Source,
    bad,
    count,
    listed,
    newest,
    ok,
    unknown,
)

START_AGAIN = "ros up or the launch file starts it again by itself; if not, end its process"
CLOUDS = (topics.CLYDE_OBSTACLE.name, topics.CLYDE_TRAIL.name)
#: Lifecycle managers in Nav2's launch files for Jazzy and the nodes they start (nav2_bringup 1.3.13, f4108e5).
MANAGED: Mapping[str, tuple[str, ...]] = {
    "lifecycle_manager_localization": ("map_server", "amcl"),
    "lifecycle_manager_navigation": (
        *("controller_server", "smoother_server", "planner_server", "route_server", "behavior_server"),
        *("velocity_smoother", "collision_monitor", "bt_navigator", "waypoint_follower", "docking_server"),
    ),
}
STATES = {
    name: newest(topics.Service(f"{name}/get_state", "lifecycle_msgs/GetState"), lambda m: str(m.current_state.label))
    for names in MANAGED.values()
    for name in names
}


def _check_navigator(robot: Observations) -> Finding:
    servers = robot.publishers.get(robot.full("navigate_to_pose/_action/status"), ())
    if len(servers) > 1:
        summary = f"{len(servers)} serve navigate_to_pose: {listed(servers)}"
        return bad(summary, "end all but one: each of them receives every goal")
    if servers:
        return ok(f"navigate_to_pose is served by {servers[0]}")
    summary = f"no server of navigate_to_pose discovered {robot.within}"
    return robot.not_yet(summary, "start Nav2", robot.launch("nav2"))


def _check_lifecycle(robot: Observations) -> Finding:
    if not robot.real_nav2:
        return unknown("a simulated robot needs none")
    states = {name: state for name, source in STATES.items() if (state := robot.get(source))}
    active = listed(name for name, state in states.items() if state == "active")
    if inactive := [name for name, state in states.items() if state != "active"]:
        manager = next(manager for manager, nodes in MANAGED.items() if inactive[0] in nodes)
        service = robot.full(f"{manager}/manage_nodes")
        command = f'ros2 service call {service} nav2_msgs/srv/ManageLifecycleNodes "{{command: 0}}"'
        remedy = "start them up; the launch file's log names the reason"
        return bad(listed(f"{name} is {states[name]}" for name in inactive), remedy, command)
    silent = [manager for manager, nodes in MANAGED.items() if not states.keys() & set(nodes)]
    launch = robot.launch("localization" if "lifecycle_manager_localization" in silent else "nav2")
    if silent := silent or [name for name in STATES if robot.has(name) and name not in states]:
        summary = f"no answer from {listed(silent)} {robot.within}; active: {active or 'none known'}"
        if robot.virtual:
            return robot.not_yet(summary, "", launch)
        return unknown(summary, "if it does not run, start it", launch, settled=False)
    return ok(f"localization and navigation are active: {active}")


def _check_cloud(topic: str, robot: Observations) -> Finding:
    subscribers = robot.subscribers.get(robot.full(topic), ())
    if not robot.real_nav2:
        simulator = robot.full(SIMULATOR)
        if simulator in subscribers:
            return ok(f"{simulator} subscribes to it, in place of the costmaps")
        if topic != CLOUDS[0]:
            return unknown("a simulated robot needs none: Clyde's trail is cleared without it")
        return robot.not_yet(f"no subscription of {simulator} discovered {robot.within}", "")
    missing = [name for name in COSTMAPS if robot.full(f"{name}/{name}") not in subscribers]
    if not missing:
        return ok(f"{' and '.join(COSTMAPS)} subscribe to it")
    summary = f"no subscription of {' and '.join(missing)} discovered {robot.within}"
    others = [robot.full(f"{costmap}/{topic}") for costmap in COSTMAPS]  # names if Nav2's file has a relative topic
    if others := [name for name in others if robot.subscribers.get(name)]:
        summary += f", but of {listed(others)}, which no node publishes"
    remedy = "Nav2 does not see Clyde: launch it with the game's config/nav2.yaml, from the checkout"
    return robot.not_yet(summary, remedy, robot.launch("nav2"))


def _add_configuration(previous: Processes | None, message: Any, arrival: CheckTime) -> Processes:
    return add_process(previous or {}, configuration_of(message))


CONFIGURATIONS = Source(topics.CONFIGURATION, _add_configuration)
STATE, DIAGNOSTICS, PROCESSES = (newest(*MONITORED[name]) for name in ("state", "condition", "started"))


def _configurations(robot: Observations) -> list[Mapping[str, Any]]:
    """Return the configurations of existing nodes; a restarted node has published several."""
    counts = Counter(name.rpartition("/")[2] for name in robot.publishers.get(robot.full(CONFIGURATIONS.name), ()))
    newest_first = sorted((robot.get(CONFIGURATIONS) or {}).items(), key=itemgetter(0), reverse=True)
    by_node = groupby((configured for _, configured in newest_first), key=itemgetter("node"))
    return [one for name, processes in by_node for one in islice(processes, max(counts[name], 1))]


def _check_game_nodes(robot: Observations) -> Finding:
    # Nodes of the original game have no namespace or the robot's.
    foreign = {name for name in ORIGINALS if f"/{name}" in robot.nodes or robot.has(name)}
    names = needed_nodes(robot.virtual, foreign, (robot.get(DIAGNOSTICS) or {}).get("selector", OURS))
    missing = [name for name in names if name not in foreign and not robot.has(name)]
    processes: dict[str, list[str]] = {}  # by node of which only one may act
    for one in reversed(_configurations(robot)):
        if one["acts"]:
            _, host, number = one["started"]
            processes.setdefault(one["node"], []).append(f"process {number} on {host}")
    if several := [f"{name} runs {len(ids)} times: {listed(ids)}" for name, ids in processes.items() if len(ids) > 1]:
        remedy = "end all but one: Ctrl-C in the terminal of the other ros up or ros2 launch"
        return bad("; ".join(several), remedy)
    if set(missing) >= {GAME, *LISTENERS}:
        remedy = "start the game when all other checks are ok"
        return unknown("no node of the game discovered", remedy, robot.start_game, settled=False)
    if ORIGINAL_SELECTOR in missing:
        summary = f"{ORIGINAL_SELECTOR} not discovered {robot.within}, and this game waits for it"
        return bad(summary, "start the original's planner, or the game without --selector", settled=False)
    if not missing:
        return ok(f"all {len(names)} are there{f'; of the original: {listed(sorted(foreign))}' if foreign else ''}")
    remedy = f"it ended or is frozen: {START_AGAIN}; the game's terminal and its log name the reason"
    summary = f"{len(names) - len(missing)} of {len(names)}; not discovered {robot.within}: {listed(missing)}"
    command = f"pkill -9 -f '{missing[0]}.*__ns:={robot.namespace}( |$)'"
    return bad(summary, remedy, command, settled=False)


def _check_reports(robot: Observations) -> Finding | None:
    """Report a game that is silent, and processes that do not run."""
    if not robot.has(GAME):
        return None
    arrivals, started = robot.arrivals.get(DIAGNOSTICS), robot.get(PROCESSES) or {}
    if not arrivals:
        return unknown(robot.silence(DIAGNOSTICS.name), settled=False)
    reasons = {name: text for name, text in started.get("processes", {}).items() if text}
    if (silent_s := robot.now.monotonic_s - arrivals[-1]) > SILENT_S:
        reasons[GAME] = SILENCE.format(silent_s)
    if not reasons:  # a single message may be an old one of a frozen node
        return ok("the game reports, and its processes run", settled=len(arrivals) > 1)
    ids = {one["node"]: one["started"][2] for one in _configurations(robot)}
    summary = listed(f"{name}: {reason}" for name, reason in reasons.items())
    number = next((ids[name] for name in reasons if name in ids), None)
    return bad(summary, START_AGAIN, "" if number is None else f"kill -9 {number}")


def _check_configuration(robot: Observations) -> Finding:
    nodes = sorted(_configurations(robot), key=lambda one: (one["node"] != GAME, one["node"]))
    if not nodes:
        if not robot.has(GAME):
            return unknown("no node of the game to compare")
        remedy = "restart the game; nodes of the original game publish no configuration"
        return unknown(robot.silence(CONFIGURATIONS.name), remedy, settled=False)
    first, maps = nodes[0], [one["map"] for one in nodes if one["map"] is not None]
    ours = next(iter(maps), None) if robot.map is None else robot.map.hash[:12]
    wrong = []
    for one in nodes:
        fields = differences(one["configuration"], first["configuration"])
        if one["map"] not in (None, ours):
            fields["map"] = one["map"], ours
        if fields:
            words = listed(f"{name} {own}, here {other}" for name, (own, other) in fields.items())
            wrong.append(f"{one['node']} plays by {words}")
    if not wrong:
        return ok(f"{count(len(nodes), 'node')} by {first['hash']}{f' on map {ours}' if maps else ''}")
    remedy = "start all nodes with the same --map, --preset, --execution and --set"
    if robot.map is not None and len(set(maps)) == 1 and ours not in maps:
        remedy = f"ask with the map that they play on, --map FILE_OR_NAME; else {remedy}"
    here = "" if robot.map is None else f" (map here: {robot.map.name})"
    return bad("; ".join(wrong) + here, remedy, robot.start_game)


def _check_game(robot: Observations) -> Finding:
    state, condition = robot.get(STATE), robot.get(DIAGNOSTICS) or {}
    words, troubles = [state or robot.silence(STATE.name)], troubles_of(condition)
    if state is None and not condition:
        if not robot.has(GAME) and not robot.has(SELECTOR):
            return unknown("no game is in progress")
        return unknown(words[0], "wait: the first start compiles for about a minute", settled=False)
    if serious := [kind for kind in REMEDIES if kind in troubles]:
        remedy, command = REMEDIES[serious[0]], ""
        if serious[0] == NO_ODOMETRY and robot.virtual:
            remedy, command = RESTART_GAME, robot.start_game
        elif serious[0] == POSE_JUMPED:
            command = robot.game_command("continue")
        return bad("; ".join([*words, *(troubles[kind] for kind in serious)]), remedy, command)
    if not condition:
        words.append(robot.silence(DIAGNOSTICS.name))
    elif condition.get("policy") is None:
        words.append(f"goal selector {condition.get('selector', 'unknown')}")
    else:
        words += [
            f"policy {condition['policy']}",
            *(["a shadow: it drives nothing"] if condition.get("shadow") else []),
        ]
    counted = [f"{kind} ({condition['troubles'][kind]})" for kind in troubles if kind != "no Nav2"]
    faults = [fault for name, fault in _FAULTS.items() if condition.get(name) is False]
    summary = ", ".join([*words, *faults, *([f"troubles: {listed(counted)}"] if counted else [])])
    settled = state is not None and bool(condition)
    if settled and not faults and not counted:
        return ok(summary)
    log = "see its log for details: pacman_game.log in the folder that ros up names"
    return unknown(summary, log if counted else "see the lines above", settled=settled)


#: Facts of the goal selector's diagnostics that should be true, and what is wrong if one is false.
_FAULTS = {"active": "the goal selector is not active", "nav2": "Nav2 does not answer it"}
_PLAYS = (CONFIGURATIONS,)
_REPORTS = PROCESSES, DIAGNOSTICS, CONFIGURATIONS
CHECKS = (
    Check("Nav2", "Does exactly one node serve navigate_to_pose?", _check_navigator),
    Check(
        "Nav2's nodes", "Are the nodes of localization and navigation active?", _check_lifecycle, (*STATES.values(),)
    ),
    *(Check(topic, f"Do both costmaps subscribe to {topic}?", partial(_check_cloud, topic)) for topic in CLOUDS),
    Check("game's nodes", "Does each node of the game run exactly once?", _check_game_nodes, _PLAYS),
    Check("game's reports", "Does the game report, and do all its processes run?", _check_reports, _REPORTS),
    Check("configuration", "Do all nodes have the same configuration and map?", _check_configuration, _PLAYS),
    Check("game", "What is the state of the game?", _check_game, (STATE, DIAGNOSTICS)),
)
