"""Node ``sim_robot``: the simulated robot with the robot's interface, instead of base, lidar, AMCL and Nav2.

It sets the pace of time, receives velocities, poses, lights and faults, and steps the world
(``sim/robot_simulation.py``). Without ``navigation`` it is only a TurtleBot 4's base and lidar (``sim_base.py``),
for a real Nav2.
"""

import dataclasses
import json
import math
import sys
import time
from collections.abc import Iterable, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import String

from ...config import located
from ...sim.robot_simulation import SimulatedRobot
from ...world.navigation.localization import Pose
from .. import topics
from ..configured_node import ConfiguredNode, process, process_words
from ..discovery import publishers, stay_on_this_machine
from ..message_conversion import BadMessage, pose_of, process_of, started
from ..node import parameter
from ..process import run
from .sim_actions import Notes
from .sim_base import Base, InitialPose
from .sim_faults import OF_LOCALIZATION, OF_NAVIGATION, Faults, fault_of, fault_words
from .sim_nav2 import Nav2StandIn
from .sim_sensors import Sensors

NAME = "sim_robot"
LIGHT_RING_SHOWN = topics.Topic("sim/lightring", "std_msgs/String", topics.COMMANDS)  # JSON: override_system, leds
AUDIO_SHOWN = topics.Topic("sim/audio", "std_msgs/String", topics.COMMANDS)  # JSON: playing, iterations, notes
FAULT = topics.Topic("sim/fault", "std_msgs/String", topics.EVENTS)  # see sim_faults.py
FAULTS_NOW = topics.Topic("sim/faults", "std_msgs/String", topics.LATCHED)  # JSON: list of faults

FASTEST = 10.0
CATCH_UP_S = 0.5  # wall time; a longer delay is skipped
AT_ONCE = 10  # most steps between two receptions of messages
#: Topics that a base publishes in the robot's namespace; topic that only another simulation publishes.
BASE, CLOCK = (topics.ODOMETRY.name, topics.SCAN.name), (topics.CLOCK.name,)
OTHERS_S = 1.0  # wall time between searches for other robots
ONE_CLOCK = "give one of them another domain"
RATES_HZ = (20, 40, 50, 100)  # of odometry; the periods are whole ms and divide all periods of the configuration
BASE_HZ = 50  # without navigation: several messages per period of Nav2's controller
AT_HOME = "home"
START_NS = 1_000_000_000  # first simulated time, because a stamp of zero means "no time"


def _pose(text: str, name: str) -> Pose | None:
    if not text.strip():
        return None
    try:
        x, y, heading = (float(word) for word in text.split(","))
    except ValueError:
        raise ValueError(f"parameter {name} = {text!r}: must be x,y,heading") from None
    return x, y, heading


class SimRobot(ConfiguredNode):
    """Node of the simulated robot; unless ``paced``, the caller steps it by :meth:`step` instead of a timer."""

    def __init__(self, *, paced: bool = True, **options: Any) -> None:
        super().__init__(NAME, with_map=True, **options)
        config = self.config
        seed = parameter(self, "seed", 0, "random seed of the robot", 0, 2**63 - 1)
        home = parameter(self, "home", "", "start pose x,y,heading, m and rad; empty: as in the game")
        localized = parameter(self, "set_initial_pose", True, "AMCL starts with home; false: it waits for initialpose")
        self._speed = parameter(self, "speed", 1.0, "simulated per wall time; needs use_sim_time", 0.1, FASTEST)
        navigates = parameter(self, "navigation", True, "simulate Nav2; false: only the base, for a real Nav2")
        text = "simulate AMCL; false: neither amcl_pose nor map to odom, and the odometry drifts"
        self._localizes = parameter(self, "localization", True, text)
        map_out = parameter(self, "map_out", True, "publish the map; false: a map_server publishes it")
        text = f"rate of odometry, tf and clock: {', '.join(map(str, RATES_HZ))}; 0: 20, without navigation {BASE_HZ}"
        rate_hz = parameter(self, "odometry_hz", 0, text, 0, RATES_HZ[-1]) or (RATES_HZ[0] if navigates else BASE_HZ)
        text = f"pose x,y,heading of the docked robot, m and rad, or {AT_HOME}: it starts docked; empty: no dock"
        dock = parameter(self, "dock", "", f"without navigation: {text}")
        charge = parameter(self, "charge", 1.0, "without navigation: charge of the battery at the start", 0.0, 1.0)
        stamped = parameter(self, "stamped_cmd_vel", True, "cmd_vel is TwistStamped, as on Jazzy; false: Twist")
        faults = parameter(self, "fault", "", "faults from the start, separated by semicolons (see sim/fault)")
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        if self._speed != 1.0 and not self._simulated:
            raise ValueError(f"parameter speed = {self._speed}: needs use_sim_time, for the clock to run faster")
        if rate_hz not in RATES_HZ:
            raise ValueError(f"parameter odometry_hz = {rate_hz}: must be 0 or one of {', '.join(map(str, RATES_HZ))}")
        if rate_hz != RATES_HZ[0]:
            config = config.with_fields(physics_step_s=1.0 / rate_hz)
        if navigates and not self._localizes:
            raise ValueError("parameter localization = false: needs navigation = false, too")
        at, is_localized = _pose(home, "home"), localized and self._localizes
        robot = SimulatedRobot(self.map, config, seed, home=at, localized=is_localized, drifts=not self._localizes)
        self.robot = robot
        robot.compile_kernels()  # meanwhile other nodes are discovered
        self._starting = True
        if reason := self._other_robot():
            raise ValueError(reason)
        self.step_ns = round(config.physics_step_s * 1e9)
        self._scan_steps = round(config.localization.scan_period_s / config.physics_step_s)
        self._start_ns = START_NS if self._simulated else time.time_ns()
        self._began = time.monotonic()  # wall time of step 0
        self._faults: Faults = {}
        self._faults_out = FAULTS_NOW.publisher(self)
        place = robot.pose if dock == AT_HOME else _pose(dock, "dock")
        self._body = Nav2StandIn(self, robot) if navigates else Base(self, robot, place, charge)
        self._initial_pose = InitialPose(self, robot) if localized and not self._localizes else None
        self._audio = AUDIO_SHOWN.publisher(self)
        self._notes = Notes(self, robot, lambda what: self._audio.publish(String(data=json.dumps(what))))
        self._clock_out = topics.CLOCK.publisher(self) if self._simulated else None
        if self._simulated:
            self._own_clock()
        self._sensors = Sensors(self, robot, self._stamp(), alone=not navigates, map_out=map_out)
        self._lightring = LIGHT_RING_SHOWN.publisher(self)
        self._lights = ""
        velocity = topics.CMD_VEL if stamped else dataclasses.replace(topics.CMD_VEL, type_name="geometry_msgs/Twist")
        self.listen(velocity, self._on_velocity, "bad velocity")
        if self._localizes:
            self.listen(topics.INITIAL_POSE, self._on_initial_pose, "bad initial pose")
        self.listen(topics.LIGHT_RING, self._on_lights, "bad lights")
        self.listen(FAULT, lambda message: self._apply_faults([message.data]), "bad fault")
        self._apply_faults(filter(str.strip, faults.split(";")))
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        if paced:
            self.create_timer(config.physics_step_s / self._speed, self.tick, clock=wall)
        self.create_timer(OTHERS_S, self._check_others, clock=wall)
        x, y, heading = robot.pose
        self.get_logger().info(f"{robot.occupancy.name}: robot at ({x:.2f}, {y:.2f}, {heading:.2f}), seed {seed}")

    def _own_clock(self) -> None:
        self._owner = {"namespace": self.get_namespace(), "started": process()}
        self.listen(topics.CLOCK_OWNER, self._on_clock_owner, "bad clock owner")
        self._owner_out = topics.CLOCK_OWNER.publisher(self)
        self._owner_out.publish(String(data=json.dumps(self._owner)))

    def _other_robot(self) -> str:
        """Return the reason why a simulated robot must not run here; empty if it may."""
        place = self.get_namespace()
        if bases := publishers(self, BASE):
            return f"a robot's base answers in {place}: {', '.join(bases)}; a simulated one must not drive it"
        if self._simulated and self._starting and (clocks := publishers(self, CLOCK)):
            return f"another clock runs in this ROS domain: {', '.join(clocks)}; {ONE_CLOCK}"
        return ""

    def _check_others(self) -> None:
        self._starting = False
        if reason := self._other_robot():
            self.refuse(reason)

    def _on_clock_owner(self, message: Any) -> None:
        """Refuse to run if an earlier simulated robot publishes the time in this domain, in any namespace."""
        other = process_of(message)
        if other["started"] < started(self._owner):
            place = str(other.get("namespace"))[:100]
            self.refuse(f"another clock runs in this ROS domain: {place}/{NAME}, {process_words(other)}; {ONE_CLOCK}")

    # Time

    def _now_ns(self) -> int:
        (ahead_s,) = self._faults.get("clock_jump", (0.0,))
        return max(self._start_ns + self.robot.steps * self.step_ns + round(ahead_s * 1e9), 1)

    def _stamp(self, ahead_ns: int = 0) -> Any:
        seconds, nanoseconds = divmod(self._now_ns() + ahead_ns, 1_000_000_000)
        return Time(sec=seconds, nanosec=nanoseconds)

    def tick(self) -> None:
        """Step the world to the present wall time (times the speed), at most ``AT_ONCE`` steps."""
        step_s = self.step_ns * 1e-9 / self._speed
        behind = math.floor((time.monotonic() - self._began) / step_s) - self.robot.steps
        most = max(round(CATCH_UP_S / step_s), 1)
        lost = behind - most
        if lost > 0:
            self.once.warning("too slow", f"too slow for {self._speed:g} times wall time: {lost} steps left out")
            self._began += lost * step_s
            if not self._simulated:  # stamps follow the wall clock
                self._start_ns += lost * self.step_ns
        for _ in range(min(behind, most, AT_ONCE)):
            self.step()

    def step(self) -> None:
        robot = self.robot
        self._body.step()
        self._notes.step()
        stamp = self._stamp()
        if self._clock_out is not None:
            self._clock_out.publish(ClockMessage(clock=stamp))
        with_scan = robot.steps % self._scan_steps == 0
        turns = not self._body.docked  # a TurtleBot 4 stops the lidar on its dock
        silent = "base_silent" in self._faults
        self._sensors.publish(self._stamp, with_scan=with_scan, lidar_turns=turns, base_silent=silent)
        if with_scan:
            self._body.publish(stamp)
            if self._initial_pose is not None:
                self._initial_pose.publish_if_due(stamp)
            self._notes.send_feedback()

    # Messages

    def _on_velocity(self, message: Any) -> None:
        if "base_silent" in self._faults:
            return  # the silent process also passes velocities to the base
        twist = getattr(message, "twist", message)
        with located("cannot drive", BadMessage, ValueError):
            self._body.command(twist.linear.x, twist.angular.z)

    def _on_initial_pose(self, message: Any) -> None:
        pose = pose_of(message)
        if "pose_lost" in self._faults:
            raise BadMessage("the pose is lost, by a fault")
        self.robot.set_initial_pose(pose)

    def _on_lights(self, message: Any) -> None:
        leds = [[led.red, led.green, led.blue] for led in message.leds]
        text = json.dumps({"override_system": message.override_system, "leds": leds})
        if text != self._lights:
            self._lights = text
            self._lightring.publish(String(data=text))

    # Faults

    def _apply_faults(self, texts: Iterable[str]) -> None:
        """Begin or end faults; raises BadMessage at the first fault that is impossible, which changes nothing."""
        for text in texts:
            with located(f"fault {text!r}", BadMessage, ValueError):
                name, numbers = fault_of(text)
                now = {other: values for other, values in self._faults.items() if name not in ("", other)}
                if numbers is not None:
                    self._begin_fault(name, numbers)
                    now[name] = numbers
            self._change_faults(now)
        words = fault_words(self._faults)
        self._faults_out.publish(String(data=json.dumps(words)))
        self.get_logger().info(f"faults: {', '.join(words) or 'none'}")

    def _begin_fault(self, name: str, numbers: tuple[float, ...]) -> None:
        """Apply the immediate effect of a fault; raises ValueError if the fault is impossible."""
        if name in OF_NAVIGATION and not isinstance(self._body, Nav2StandIn):
            raise ValueError("needs the simulated Nav2 (parameter navigation)")
        if name in OF_LOCALIZATION and not self._localizes:
            raise ValueError("needs the simulated AMCL (parameter localization)")
        if name == "clock_jump" and not self._simulated:
            raise ValueError("needs use_sim_time")
        if name == "wheels_slip":
            self.robot.slip(*numbers)
        if name == "kidnap":
            x, y, heading = numbers
            self.robot.kidnap((x, y, heading))
            self._sensors.publish_origin(self._stamp())

    def _change_faults(self, now: Faults) -> None:
        previous, self._faults = self._faults, now
        self._body.set_faults(now)
        changed = {name for name in previous.keys() | now.keys() if previous.get(name) != now.get(name)}
        if changed & {"pose_lost", "pose_jump", "base_silent"} or changed & {"kidnap", "wheels_slip"} - now.keys():
            without = now.keys() & {"pose_lost", "base_silent"}  # AMCL needs odometry
            self.robot.localizing = self._localizes and not without
            x, y, heading = now.get("pose_jump", (0.0, 0.0, 0.0))
            self.robot.shift_belief((x, y, heading))


def main(argv: Sequence[str] | None = None) -> int:
    stay_on_this_machine()
    return run(SimRobot, NAME, argv)


if __name__ == "__main__":
    sys.exit(main())
