"""A running game of a robot for the operator's page: the interface ``Game`` over ROS.

Requests run in the caller's thread, through the referee's services and the public topics. The node has its own context
and thread, except in a lock-step game, to which it belongs.
"""

import logging
import math
import threading
from functools import partial
from typing import Any, Literal

import rclpy
from geometry_msgs.msg import PointStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.context import Context
from std_msgs.msg import Header

from pacman_env.policies.registry import policy_names
from pacman_env.ros import topics
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import REFEREE, SELECTOR, full_namespace
from pacman_env.ros.message_conversion import pose_message
from pacman_env.ros.node import event_executor, own_context
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_page.ros_driving import RosDriving, require_word
from pacman_env.ros.operator_page.ros_view import RosView
from pacman_env.ros.supervisor.checks import examine
from pacman_env.ros.supervisor.checks.check import BAD, OK
from pacman_env.ros.supervisor.doctor import Doctor
from pacman_env.ros.surroundings import current
from pacman_env.web import page_messages
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import IN_PROGRESS, News, Refused, Scene
from pacman_env.web.page_messages import Message
from pacman_env.web.roles import ROBOT
from pacman_env.world.maps.occupancy import load_map

_LOG = logging.getLogger(__name__)
_PERIOD_S = 0.05  # between frames
_FIND_S = 0.5  # between searches for the game
_THERE_S = 2.0  # longest wait for a service
_ANSWER_S = 5.0
_PLACED_S = 2.0  # longest wait for a ghost to be placed
_PLACED_M = 0.5
_CHECKS_S = 6.0  # observation time for the readiness list
_SET_PARAMETERS = topics.Service(f"{SELECTOR}/set_parameters", "rcl_interfaces/SetParameters")
_REFUSALS: dict[type[Message], str] = {
    page_messages.Pause: "a robot cannot be paused: STOP holds the robot, and Reset ends the round",
    page_messages.Speed: "the speed of a robot is fixed; --speed sets the speed of a simulated robot at its start",
    page_messages.Goal: "on a robot the policy chooses the goals; drive by hand with the arrow keys",
    page_messages.Why: "rounds of a robot are not stored here: use pacman-env ros record and ros replay",
}


class RosGame:
    """:class:`~pacman_env.web.game_interface.Game` played by the nodes of a namespace (with a leading slash).

    The readiness list compares the robot's map with ``map``; MapError or OSError if ``map`` cannot be read.
    """

    source: Literal["simulator", "ros"] = "ros"

    def __init__(self, namespace: str, domain: int, sim: bool = False, map: str | None = None) -> None:
        self._where = namespace
        occupancy = None if map is None else load_map(map)
        self._make_doctor = partial(Doctor, namespace, domain, occupancy, map or "", sim, _CHECKS_S)
        self._news = News()
        self._why = self._lidar = False
        self._state: str | None = None
        self._found_s = 0.0
        self._error = ""  # the last error of the thread
        self._closed = threading.Event()
        self._doctors = threading.Lock()
        self._surroundings = current()
        lock_step = self._surroundings.lock_step
        self._context: Context | None = None
        options: dict[str, Any] = {}
        if not lock_step:
            self._context = own_context(domain)
            options = {"namespace": namespace, "context": self._context}
        self.node = node = PageNode(sim, self._news, **options)
        self._view = RosView(node, f"{namespace}, ROS domain {domain}", self._news)
        self._driving = driving = RosDriving(node, self._news)
        self.stop, self.release, self.leave = driving.stop, driving.release, driving.leave
        self.news = self._news.after
        services = (topics.START_GAME, topics.RESET_GAME, topics.CONTINUE, _SET_PARAMETERS)
        self._services = {service.name: service.client(node) for service in services}
        outputs = (topics.CLICKED_POINT, topics.INITIAL_POSE, topics.BASE_CLYDE_SPEED)
        self._out = {topic.name: topic.publisher(node) for topic in outputs}
        node.create_timer(_PERIOD_S, self._update, clock=self._surroundings.clock())
        if not lock_step:
            self._executor = event_executor(self._context)
            self._executor.add_node(node)
            self._thread = threading.Thread(target=self._spin, name="page", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop receiving, and end a drive by hand. A stopped robot stays stopped, and the game continues."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._driving.wheels.close()
        if self._context is None:
            return
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def reset_options(self) -> None:
        """Do nothing: a robot's speed is fixed, and events are disarmed when a person leaves."""

    def choices(self) -> dict[str, Any]:
        """Return lists of names by field of a setup; on a robot, a person can choose only the policy."""
        return {"maps": [], "presets": {}, "policies": policy_names(), "behaviours": [], "settings": []}

    def scene(self) -> Scene:
        return self._view.scene

    def frame(self) -> Frame | None:
        return self._view.frame

    def watch(self, *, why: bool, lidar: bool) -> None:
        self._why, self._lidar = why, lidar

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        raise Refused(f"map {name}: a robot's map is chosen when its localization and the game are started")

    def story(self, number: int) -> bytes | None:
        """Return None: rounds of a robot are recorded by ``pacman-env ros record``."""
        return None

    def handle(self, person: str, message: Message) -> Any:
        match message:
            case page_messages.Start():
                self._driving.require_not_stopped()
                if self.node.game.state not in (None, "menu"):
                    raise Refused(IN_PROGRESS)
                self._driving.wheels.end_drive()
                self._call_referee(topics.START_GAME)
            case page_messages.Reset():
                self._call_referee(topics.RESET_GAME)
            case page_messages.Setup():
                self._set_up(message)
            case page_messages.ClydeSpeed(mps=mps):
                self._out[topics.BASE_CLYDE_SPEED.name].publish(topics.BASE_CLYDE_SPEED.type(data=mps))
            case page_messages.PlaceClyde(x=x, y=y, ghost=ghost):
                self._place(x, y, ghost)
            case page_messages.SetPose(x=x, y=y, heading=heading):
                self._set_pose(x, y, heading)
            case page_messages.Continue():
                self._require(self._call(topics.CONTINUE, topics.CONTINUE.type.Request(), SELECTOR))
            case page_messages.Role(role=role):
                self._driving.assume(person, role)
                return {"words": ""}
            case page_messages.Drive(v=v, omega=omega):
                self._driving.roles.require(person, ROBOT)
                self._driving.require_not_stopped()
                self._require_game()
                self._driving.drive(v, omega, self._view.scene.facts)
            case page_messages.Event(word=word, what=what):
                require_word(what, word)
                self._require_game()
                self._driving.show(what, word)
            case page_messages.Arm(on=on):
                self._driving.arm(person if on else None)
            case page_messages.Ready():
                return self._ready()
            case page_messages.Stories():
                return []
            case _:
                raise Refused(_REFUSALS.get(type(message), f"{type(message).__name__}: not on a robot"))
        return None

    def _spin(self) -> None:
        while not self._closed.is_set():
            try:
                self._executor.spin_once(timeout_sec=0.2)
            except Exception as error:
                if self._closed.is_set():
                    return
                words = f"internal error: {type(error).__name__}: {error}"[:300]
                if words != self._error:
                    self._error = words
                    _LOG.exception("the operator's page continues after an error")
                    self._news.add(words=words)

    def _update(self) -> None:
        node, now = self.node, self._surroundings.monotonic()
        node.watch(why=self._why, lidar=self._lidar)
        node.catch_up()
        if now - self._found_s >= _FIND_S:
            self._found_s = now
            if self._view.find_game():
                self._driving.wheels.end_drive()
            self._view.update_scene()
        self._driving.keep_stopped()
        state = node.game.state
        if state != self._state:
            self._state = state
            if state is not None:
                self._news.add(state=state)
            if state != "menu":  # the game drives
                self._driving.wheels.end_drive()
        self._view.update_frame(self._driving.stopped, self._lidar)

    def _require_game(self) -> None:
        if not self._view.game_is_there:
            raise Refused(f"no game is found in {self._where}: start it by pacman-env ros up")

    def _call_referee(self, service: topics.Service) -> None:
        self._require(self._call(service, service.type.Request(), REFEREE))

    def _require(self, answer: Any) -> None:
        if not answer.success:
            raise Refused(str(answer.message))

    def _set_pose(self, x: float, y: float, heading: float) -> None:
        """Publish a pose (m, m, rad) with a covariance, like RViz's 2D Pose Estimate."""
        message = topics.INITIAL_POSE.type()
        stamped = pose_message(x, y, heading, self.node.get_clock().now().to_msg())
        message.header, message.pose.pose = stamped.header, stamped.pose
        message.pose.covariance[0] = message.pose.covariance[7] = 0.25
        message.pose.covariance[35] = (math.pi / 12) ** 2
        self._out[topics.INITIAL_POSE.name].publish(message)

    def _call(self, service: topics.Service, request: Any, node: str) -> Any:
        client = self._services[service.name]
        if not self._surroundings.wait_for(client.service_is_ready, _THERE_S):
            raise Refused(f"{node} is not there: no answer on {service.name} in {self._where}")
        answer = client.call_async(request)
        if not self._surroundings.wait_for(answer.done, _ANSWER_S):
            client.remove_pending_request(answer)
            raise Refused(f"{node} has not answered within {_ANSWER_S:g} s: check whether the request was carried out")
        if answer.exception() is not None:
            raise Refused(f"{node}: {answer.exception()}")
        return answer.result()

    def _set_up(self, setup: page_messages.Setup) -> None:
        """Change the policy, which is possible in the menu; ignore a second policy and refuse everything else."""
        others = {name for name in setup.__struct_fields__ if name not in ("id", "policy", "second")}
        if setup.policy is None or any(getattr(setup, name) not in (None, False) for name in others):
            raise Refused("on a robot only the policy can be changed here; set all else with pacman-env ros up")
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=setup.policy)
        request = _SET_PARAMETERS.type.Request(parameters=[Parameter(name="policy", value=value)])
        result = self._call(_SET_PARAMETERS, request, SELECTOR).results[0]
        if not result.successful:
            raise Refused(str(result.reason))

    def _place(self, x: float, y: float, ghost: int) -> None:
        self._require_game()
        if self.node.game.state != "menu":
            raise Refused("Clyde can be placed only in the menu: press Reset first")
        if ghost != 0:
            raise Refused("on a robot only Clyde can be placed")
        point = PointStamped(header=Header(stamp=self.node.get_clock().now().to_msg(), frame_id="map"))
        point.point.x, point.point.y = x, y
        self._out[topics.CLICKED_POINT.name].publish(point)
        ghosts = self.node.game.ghosts
        if not self._surroundings.wait_for(
            lambda: 0 in ghosts and math.dist(ghosts[0].pose[:2], (x, y)) < _PLACED_M, _PLACED_S
        ):
            raise Refused("Clyde cannot be there: no place near it is wide enough for a ghost")

    def _ready(self) -> list[dict[str, str]]:
        """Return the findings of ``pacman-env ros doctor``, one run at a time, and the nodes that obey a stop."""
        with self._doctors:
            doctor = self._make_doctor()
            try:
                doctor.observe(self._closed.is_set)
                findings = examine(doctor.observations())
            finally:
                doctor.close()
        rows = [
            {
                "name": one.check,
                "state": "bad" if one.status == BAD else "ok" if one.status == OK or not one.remedy else "warning",
                "words": one.summary,
                "remedy": ": ".join(filter(None, (one.remedy, one.command))),
            }
            for one in findings
        ]
        return [*rows, self._driving.stop_row()]


def open_game(
    namespace: str = "robot_15", domain: int | None = None, sim: bool = False, map: str | None = None
) -> RosGame:
    """Open the game in a robot's namespace, running or not; ValueError for an invalid domain or map.

    ``domain`` None: ROS_DOMAIN_ID; ``sim``: a simulated robot, on this machine only; ``map``: a file or built-in name.
    """
    return RosGame(full_namespace(namespace), join(domain, this_machine=sim), sim, map)
