"""Checks of what can be discovered: ROS, domain, namespace, and the robot's base."""

from __future__ import annotations

from ..game_nodes import SIMULATOR
from .check import Check, Finding, Observations, count, listed
from .remedies import FIREWALL, RESTART, other_domain, up

_RANGE, _LOCAL, _SERVER = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_DISCOVERY_SERVER"
#: Beside domain and range, what decides in the environment which nodes are discovered.
_VARIABLES = (
    *(_SERVER, "ROS_SUPER_CLIENT", "ROS_STATIC_PEERS", "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE"),
)
_REACHES = {"LOCALHOST": "this machine only", "OFF": "nobody", "SUBNET": "this machine and its network"}
_TRUE = ("1", "true", "yes", "on")


class Ros(Check):
    name, question = "ROS", "Which nodes can be discovered from here?"
    needs_robot = False

    def answer(self, robot: Observations) -> Finding:
        variables = {name: value for name, value in robot.environment.items() if value}
        local = variables.get(_LOCAL, "").lower() in _TRUE
        reach = "LOCALHOST" if local else variables.get(_RANGE, "SUBNET").upper()
        missing = [name for name in (_SERVER, "RMW_IMPLEMENTATION") if name not in variables]
        summary = "; ".join(
            [
                f"domain {robot.domain}, {robot.middleware or 'unknown middleware'}, sees {_REACHES.get(reach, reach)}",
                *(f"{name}={variables[name]}" for name in _VARIABLES if name in variables),
                *([f"not set: {', '.join(missing)}"] if missing else []),
            ]
        )
        if reach == "OFF":
            return self.bad(summary, "let it see others", f"export {_RANGE}=SUBNET")
        if _SERVER in variables and variables.get("ROS_SUPER_CLIENT", "").lower() not in _TRUE:
            remedy = "with a discovery server only a super client sees all nodes"
            return self.unknown(summary, remedy, "export ROS_SUPER_CLIENT=True")
        return self.ok(summary)


class Domain(Check):
    name, question = "domain", "Is any node in the ROS domain?"
    needs_robot = False

    def answer(self, robot: Observations) -> Finding:
        if robot.nodes:
            return self.ok(f"{count(len(robot.nodes), 'node')} discovered in domain {robot.domain}")
        remedy = (
            "robot and this machine: one network, one ROS_DOMAIN_ID (turtlebot4-setup on the robot), no firewall; "
            "where a network drops multicast, the discovery server of turtlebot4-setup"
        )
        if robot.environment.get(_RANGE, "").upper() == "LOCALHOST":
            remedy = f"unset {_RANGE}, which is LOCALHOST; {remedy}"
        return self.silent(robot, f"no node discovered in domain {robot.domain} {robot.within}", remedy, FIREWALL)


class Namespace(Check):
    name, question = "namespace", "Are nodes in the robot's namespace?"
    needs_robot = False

    def answer(self, robot: Observations) -> Finding:
        if robot.own:
            return self.ok(f"{count(len(robot.own), 'node')} in {robot.namespace}")
        summary = f"no node discovered in {robot.namespace} {robot.within}"
        if not robot.nodes:
            return self.unknown(summary, settled=False)
        ends = [topic.rpartition("/") for topic, nodes in robot.publishers.items() if nodes]
        robots = {where or "/" for where, _, last in ends if last == "odom" and "/_" not in where}  # _: of a Create 3
        others = sorted(robots or {name.rpartition("/")[0] or "/" for name in robot.nodes})
        nearest = others[0].strip("/") or "/"
        remedy = f"did you mean --namespace {nearest}? else set the robot's in turtlebot4-setup"
        return self.bad(f"{summary}; others in {listed(others)}", remedy, settled=False)


class Base(Check):
    name, question = "base", "Does exactly one robot publish odometry?"

    def answer(self, robot: Observations) -> Finding:
        simulator, bases = robot.full(SIMULATOR), robot.publishers_of("odom")
        real = sorted({*bases, *robot.publishers_of("scan")} - {simulator})
        if robot.in_simulation and real:
            summary = f"a simulated robot, {simulator}, and a real one, {listed(real)}: the game drives both"
            remedy = "stop the simulated one (Ctrl-C) and start it in a domain of its own"
            return self.bad(summary, remedy, f"{up(robot)} --domain-id {other_domain(robot.domain)}")
        if len(bases) > 1:
            remedy = "two robots in one namespace: set another for one of them in turtlebot4-setup"
            return self.bad(f"{len(bases)} nodes publish {robot.full('odom')}: {listed(bases)}", remedy)
        if bases:
            return self.ok(f"{'simulated, ' if robot.in_simulation else ''}{bases[0]}")
        summary = f"no publisher of {robot.full('odom')} discovered {robot.within}"
        return self.silent(robot, summary, "on the robot", RESTART)


CHECKS: tuple[Check, ...] = (Ros(), Domain(), Namespace(), Base())
