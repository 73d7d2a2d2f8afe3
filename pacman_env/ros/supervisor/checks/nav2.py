"""Checks of Nav2: its action server, its nodes, and whether its costmaps subscribe to the ghosts."""

from __future__ import annotations

from collections.abc import Mapping

from ...discovery import COSTMAPS
from ..game_nodes import SIMULATOR
from .check import Check, Finding, Observations, Request, listed
from .remedies import localize, nav2

CLOUDS = ("clyde_obstacle", "clyde_trail")
#: Nodes that Nav2's launch files for Jazzy bring up by these two managers (nav2_bringup 1.3.13, f4108e5).
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


class Navigator(Check):
    name, question = "Nav2", "Does exactly one node serve navigate_to_pose?"

    def answer(self, robot: Observations) -> Finding:
        servers = robot.publishers.get(robot.full("navigate_to_pose/_action/status"), ())
        if len(servers) > 1:
            summary = f"{len(servers)} serve navigate_to_pose: {listed(servers)}"
            return self.bad(summary, "end all but one: each goal goes to both")
        if servers:
            return self.ok(f"navigate_to_pose is served by {servers[0]}")
        summary = f"no server of navigate_to_pose discovered {robot.within}"
        return self.silent(robot, summary, "start Nav2", nav2(robot))


class Lifecycle(Check):
    name, question = "Nav2's nodes", "Are the nodes of localization and navigation active?"
    sources = (*MANAGERS.values(), *STATES.values())

    def answer(self, robot: Observations) -> Finding:
        if robot.virtual:
            return self.unknown("simulated: they are not there, and not needed")
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
            return self.bad(summary, "start them up; the launch file's log says why they were not", command)
        if silent:
            summary = f"{' and '.join(silent)} not answering {robot.within}; active: {active or 'none known'}"
            command = nav2(robot) if silent == ["lifecycle_manager_navigation"] else localize(robot)
            return self.unknown(summary, "if it does not run, start it", command, settled=False)
        return self.ok(f"localization and navigation are active: {active}".removesuffix(": "))


class Cloud(Check):
    def __init__(self, topic: str) -> None:
        self.name, self.question = topic, f"Do both costmaps subscribe to {topic}?"

    def answer(self, robot: Observations) -> Finding:
        topic, subscribers = self.name, robot.subscribers_of(self.name)
        if robot.virtual:
            simulator = robot.full(SIMULATOR)
            if simulator in subscribers:
                return self.ok(f"{simulator} subscribes to it, in place of the costmaps")
            if topic != CLOUDS[0]:
                return self.unknown("simulated: what Clyde leaves behind is cleared without it")
            return self.silent(robot, f"no subscription of {simulator} discovered {robot.within}", "")
        missing = [name for name in COSTMAPS if robot.full(f"{name}/{name}") not in subscribers]
        if not missing:
            return self.ok(f"{' and '.join(COSTMAPS)} subscribe to it")
        summary = f"no subscription of {' and '.join(missing)} discovered {robot.within}"
        others = [robot.full(f"{costmap}/{topic}") for costmap in COSTMAPS]  # where the name in their file is relative
        if others := [name for name in others if robot.subscribers_of(name)]:
            summary += f", but of {listed(others)}, which no node publishes"
        remedy = "Nav2 does not see Clyde: launch it with the game's config/nav2.yaml, from the checkout"
        return self.silent(robot, summary, remedy, nav2(robot))


CHECKS: tuple[Check, ...] = (Navigator(), Lifecycle(), *map(Cloud, CLOUDS))
