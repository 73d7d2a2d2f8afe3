"""A running game of a robot for the operator's page: the interface ``Game`` over ROS.

Requests run in the caller's thread, through the referee's services and the public topics.
"""

import logging
import math
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import rclpy
from geometry_msgs.msg import PointStamped
from msgspec.structs import replace
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter

from pacman_env.policies.registry import policy_names
from pacman_env.ros import topics
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import GAME, full_namespace
from pacman_env.ros.message_conversion import pose_message, uncertain_pose_message
from pacman_env.ros.observer import own_context
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_page.ros_driving import PERIOD_S, RosDriving
from pacman_env.ros.operator_page.ros_view import RosView
from pacman_env.ros.process import event_executor
from pacman_env.ros.supervisor.checks import examine
from pacman_env.ros.supervisor.checks.check import BAD, OK
from pacman_env.ros.supervisor.doctor import Doctor
from pacman_env.web import page_messages
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import IN_PROGRESS, Refused, Scene
from pacman_env.web.page_messages import Message
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

_LOG = logging.getLogger(__name__)
_POLL_S = 0.02  # between two evaluations of a condition
_FIND_S = 0.5  # between searches for the game
_THERE_S = 2.0  # longest wait for a service
_ANSWER_S = 5.0
_PLACED_S = 2.0  # longest wait for a ghost to be placed
_PLACED_M = 0.5
_CHECKS_S = 6.0  # observation time for the readiness list
_SET_PARAMETERS = topics.Service(f"{GAME}/set_parameters", "rcl_interfaces/SetParameters")


def _wait_for(condition: Callable[[], object], limit_s: float) -> bool:
    """Return True if the condition becomes true within ``limit_s``."""
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(_POLL_S)
    return True


class RosGame:
    """:class:`~pacman_env.web.game_interface.Game` played by the nodes in the namespace of ``node``.

    Its node calls :meth:`update` every ``PERIOD_S``. The readiness list compares the robot's map with
    ``map``, from ``map_file``. ``wait_for`` returns True if a condition becomes true within a time, s; requests wait
    with it in the caller's thread.
    """

    source: Literal["simulator", "ros"] = "ros"

    def __init__(
        self,
        node: PageNode,
        map: OccupancyMap | None = None,
        map_file: str = "",
        wait_for: Callable[[Callable[[], object], float], bool] = _wait_for,
    ) -> None:
        self.node, self._wait_for = node, wait_for
        namespace, domain = node.get_namespace(), node.context.get_domain_id()
        self._where = f"{namespace}, ROS domain {domain}"
        self._make_doctor = partial(Doctor, namespace, domain, map, map_file, node.sim, _CHECKS_S)
        self._why = self._lidar = False
        self._found_s = 0.0
        self._closed = threading.Event()
        self._doctors = threading.Lock()
        self._view = RosView(node, self._where)
        self.driving = driving = RosDriving(node)
        self.stop, self.release, self.leave = driving.stop, driving.release, driving.leave
        self.news = node.news.after
        services = (topics.START_GAME, topics.RESET_GAME, topics.CONTINUE, _SET_PARAMETERS)
        self._services = {service.name: service.client(node) for service in services}
        outputs = (topics.CLICKED_POINT, topics.INITIAL_POSE, topics.BASE_CLYDE_SPEED)
        self._out = {topic.name: topic.publisher(node) for topic in outputs}

    def close(self) -> None:
        """End a drive by hand. A stopped robot stays stopped, and the game continues."""
        self._closed.set()
        self.driving.end_drive()

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
                self.driving.require_not_stopped()
                if self.node.game.state not in (None, "menu"):
                    raise Refused(IN_PROGRESS)
                self.driving.end_drive()
                self._trigger(topics.START_GAME)
            case page_messages.Reset():
                self._trigger(topics.RESET_GAME)
            case page_messages.Setup():
                self._set_up(message)
            case page_messages.ClydeSpeed(mps=mps):
                self._out[topics.BASE_CLYDE_SPEED.name].publish(topics.BASE_CLYDE_SPEED.type(data=mps))
            case page_messages.PlaceClyde(x=x, y=y, ghost=ghost):
                self._place(x, y, ghost)
            case page_messages.SetPose(x=x, y=y, heading=heading):
                stamp = self.node.get_clock().now().to_msg()
                self._out[topics.INITIAL_POSE.name].publish(uncertain_pose_message(x, y, heading, stamp))
            case page_messages.Continue():
                self._trigger(topics.CONTINUE)
            case page_messages.Role(role=role):
                self.driving.assume(person, role)
                return {"words": ""}
            case page_messages.Drive(v=v, omega=omega):
                self._require_game()
                self.driving.drive(person, v, omega, self._view.scene.facts)
            case page_messages.Event(word=word, what=what):
                self._require_game()
                self.driving.show(what, word)
            case page_messages.Arm(on=on):
                self.driving.arm(person if on else None)
            case page_messages.Ready():
                return self._ready()
            case page_messages.Stories():
                return []
            case _:
                raise Refused(f"{type(message).__name__}: only in the simulator")
        return None

    def update(self) -> None:
        node, now = self.node, self.node.monotonic()
        self.driving.beat()
        node.watch(why=self._why, lidar=self._lidar)
        if now - self._found_s >= _FIND_S:
            self._found_s = now
            self._view.update_scene()
        self._view.update_frame(self.driving.stopped, self._lidar)

    def _require_game(self) -> None:
        if not self._view.game_is_there:
            raise Refused(f"no game is found in {self._where}: start it by pacman-env ros up")

    def _trigger(self, service: topics.Service) -> None:
        answer = self._call(service, service.type.Request())
        if not answer.success:
            raise Refused(str(answer.message))

    def _call(self, service: topics.Service, request: Any) -> Any:
        client = self._services[service.name]
        if not self._wait_for(client.service_is_ready, _THERE_S):
            raise Refused(f"{GAME} is not there: no answer on {service.name} in {self._where}")
        answer = client.call_async(request)
        if not self._wait_for(answer.done, _ANSWER_S):
            client.remove_pending_request(answer)
            raise Refused(f"{GAME} has not answered within {_ANSWER_S:g} s: check whether the request was carried out")
        if answer.exception() is not None:
            raise Refused(f"{GAME}: {answer.exception()}")
        return answer.result()

    def _set_up(self, setup: page_messages.Setup) -> None:
        """Change the policy, which is possible in the menu; ignore a second policy and refuse everything else."""
        if setup.policy is None or replace(setup, id=0, policy=None, second=None) != page_messages.Setup():
            raise Refused("on a robot only the policy can be changed here; set all else with pacman-env ros up")
        parameters = [Parameter("policy", value=setup.policy).to_parameter_msg()]
        result = self._call(_SET_PARAMETERS, _SET_PARAMETERS.type.Request(parameters=parameters)).results[0]
        if not result.successful:
            raise Refused(str(result.reason))

    def _place(self, x: float, y: float, ghost: int) -> None:
        self._require_game()
        if self.node.game.state != "menu":
            raise Refused("Clyde can be placed only in the menu: press Reset first")
        if ghost != 0:
            raise Refused("on a robot only Clyde can be placed")
        stamped = pose_message(x, y, 0.0, self.node.get_clock().now().to_msg())
        self._out[topics.CLICKED_POINT.name].publish(PointStamped(header=stamped.header, point=stamped.pose.position))
        ghosts = self.node.game.ghosts
        if not self._wait_for(lambda: 0 in ghosts and math.dist(ghosts[0].pose[:2], (x, y)) < _PLACED_M, _PLACED_S):
            raise Refused("Clyde cannot be there: no place near it is wide enough for a ghost")

    def _ready(self) -> list[dict[str, str]]:
        """Return the findings of ``pacman-env ros doctor``, one run at a time, and the nodes that obey a stop."""
        with self._doctors, self._make_doctor() as doctor:
            doctor.observe(self._closed.is_set)
            findings = examine(doctor.observations())
        rows = [
            {
                "name": one.check,
                "state": "bad" if one.status == BAD else "ok" if one.status == OK or not one.remedy else "warning",
                "words": one.summary,
                "remedy": ": ".join(filter(None, (one.remedy, one.command))),
            }
            for one in findings
        ]
        return [*rows, self.driving.stop_row()]


class OpenGame(RosGame):
    """The game in a robot's namespace, running or not, read by a node with its own context and thread.

    ``domain`` None: ROS_DOMAIN_ID; ``sim``: a simulated robot, on this machine only; ``map``: a file or built-in name.
    Raises ValueError or OSError if one of them cannot be used.
    """

    def __init__(
        self, namespace: str = "robot_15", domain: int | None = None, sim: bool = False, map: str | None = None
    ) -> None:
        namespace, domain = full_namespace(namespace), join(domain, this_machine=sim)
        occupancy = None if map is None else load_map(map)
        self._error = ""  # the last error of the thread
        self._context = own_context(domain)
        node = PageNode(sim, namespace=namespace, context=self._context)
        super().__init__(node, occupancy, map or "")
        node.create_timer(PERIOD_S, self.update, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._executor = event_executor(self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name="page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop receiving, too."""
        if self._closed.is_set():
            return
        super().close()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _spin(self) -> None:
        while not self._closed.is_set():
            try:
                self._executor.spin_once(timeout_sec=0.2)
            except Exception as error:
                words = f"internal error: {type(error).__name__}: {error}"[:300]
                if words != self._error:
                    self._error = words
                    _LOG.exception("the operator's page continues after an error")
                    self.node.news.add(words=words)
