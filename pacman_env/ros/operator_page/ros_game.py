"""A running game of a robot as the operator's page sees it: the interface ``Game`` over ROS.

A node with a context and a thread of its own listens (``heard.py``) and makes frames and scenes of what it has heard;
what people ask for is done in the thread that asks, by the referee's services and the topics that anybody may use. In
a lock-step game the node is one of the game's, and has no thread: a timer is the wheels' as well. A
stop goes three ways at once: zero velocity from a thread that does nothing else (``wheels.py``), the end of every goal
that Nav2 pursues, and the word that the nodes obey until the release (``operator_stop.py``).
"""

from __future__ import annotations

import json
import logging
import math
import threading
from typing import Any, Literal, cast

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Header

from pacman_env import __version__
from pacman_env.game.events import FEEDBACK
from pacman_env.game.lights import LIGHTS
from pacman_env.game.sounds import MELODIES
from pacman_env.policies.registry import policy_names
from pacman_env.ros import topics
from pacman_env.ros.messages import twist_message
from pacman_env.ros.operator_page.heard import Heard
from pacman_env.ros.operator_page.scenes import facts_of, pellets_of_scene
from pacman_env.ros.operator_page.wheels import PERIOD_S, Wheels
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.selector.goal_scores import WHY
from pacman_env.ros.supervisor.doctor import Doctor
from pacman_env.ros.supervisor.game_nodes import QUIET, REFEREE, SELECTOR
from pacman_env.ros.supervisor.readiness import BAD, OK, find
from pacman_env.ros.surroundings import current
from pacman_env.web import messages
from pacman_env.web.frame import Frame, State, thinned
from pacman_env.web.game import Refused, Scene
from pacman_env.web.messages import Message
from pacman_env.web.news import News
from pacman_env.web.vocabulary import vocabulary
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

_LOG = logging.getLogger(__name__)
_PERIOD_S = 0.05  # between two frames
_LOOK_S = 0.5  # between two looks at who is there
_THERE_S = 2.0  # for a service that is asked
_ANSWER_S = 5.0
_PLACED_S = 2.0  # for a ghost that was placed
_PLACED_M = 0.5
_CHECKS_S = 6.0  # for the readiness list
_CANCEL_AGAIN_S = 0.2  # while stopped and a goal still runs
_LONGEST_SHOW_S = 30.0
_NOWHERE = (math.nan, math.nan)
_SET_PARAMETERS = topics.Service(f"{SELECTOR}/set_parameters", "rcl_interfaces/SetParameters")


class RosGame:
    """A :class:`~pacman_env.web.game.Game` that the nodes of a namespace play.

    Args:
        namespace: of the robot, with its slash.
        domain: ROS domain, which this process has joined.
        sim: a simulated robot, on this machine alone.
        map: the game's map, for the readiness list to compare with the robot's; None: it is not compared.

    Raises:
        MapError, OSError: the map cannot be read.
    """

    source: Literal["simulator", "ros"] = "ros"

    def __init__(self, namespace: str, domain: int, sim: bool = False, map: str | None = None) -> None:
        self._where, self._domain, self._sim = namespace, domain, sim
        self._map_file = map or ""
        self._occupancy: OccupancyMap | None = None if map is None else load_map(map)
        self._news = News()
        self._scene = Scene(1, {"map": None, "preparing": True})
        self._scene_key = ""
        self._pellet_ids: list[int] = []
        self._frame: Frame | None = None
        self._encoded, self._number = "", 0
        self._seat: str | None = None
        self._armed: str | None = None  # by whom
        self._shows_until_s = 0.0  # a motion that an operator has asked for
        self._why = self._lidar = False
        self._there: bool | None = None  # the referee; None: nobody has looked yet
        self._state: str | None = None
        self._looked_s = self._cancelled_s = 0.0
        self._error = ""  # the last
        self._notice = ""  # what a page shows in the place of a game
        self._closed = threading.Event()
        self._doctors = threading.Lock()
        self._surroundings = current()
        lock_step = self._surroundings.lock_step
        self._context: Context | None = None if lock_step else _context(domain)
        options = {} if lock_step else {"namespace": namespace, "context": self._context}
        self.node = self._node = node = Heard(sim, self._news, **options)
        self._velocity = topics.CMD_VEL.publisher(node)
        self._wheels = Wheels(self._publish_velocity, self._surroundings.monotonic, own_thread=not lock_step)
        self._canceller = topics.NAVIGATE_TO_POSE.cancel_client(node)
        self._motions = [topics.motion_canceller(node, name) for name in topics.MOTIONS]
        self._services = {
            service.name: service.client(node) for service in (topics.START_GAME, topics.RESET_GAME, _SET_PARAMETERS)
        }
        said = (topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND, topics.CLICKED_POINT, topics.BASE_CLYDE_SPEED)
        self._says = {topic.name: topic.publisher(node) for topic in said}
        self._operator = OperatorStop(node, self._on_stop)
        node.create_timer(_PERIOD_S, self._look, clock=self._surroundings.clock())
        if lock_step:
            node.create_timer(PERIOD_S, self._wheels.beat, clock=self._surroundings.clock())
            return
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name="page", daemon=True)
        self._thread.start()

    # What the server asks

    def close(self) -> None:
        """Listen no more. What was driven by hand stands, a stop stays, a game goes on."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._wheels.close()
        if self._context is None:
            return
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def hello(self) -> dict[str, Any]:
        """Words and melodies; of the choices the policies, the rest was chosen when the game was started."""
        nothing: dict[str, Any] = {"maps": [], "presets": [], "behaviours": [], "settings": []}
        return {"version": __version__, "choices": {**nothing, "policies": policy_names()}, **vocabulary()}

    def scene(self) -> Scene:
        """The scene now."""
        return self._scene

    def frame(self) -> Frame | None:
        """How it stands now; None: neither a game nor a robot is heard."""
        return self._frame

    def news(self, after: int) -> list[dict[str, Any]]:
        """What has happened since."""
        return self._news.after(after)

    def watched(self, *, why: bool, lidar: bool) -> None:
        """Scans and reasons are listened to while somebody looks at them."""
        self._why, self._lidar = why, lidar

    def stop(self, person: str) -> None:
        """Zero velocity, no goal, and no other until the release; from any thread."""
        try:
            self._wheels.stop()
        finally:  # each way for itself, whatever becomes of the others
            try:
                self._operator.say(True, person)
            finally:
                self._cancel_goals()

    def release(self, person: str) -> None:
        """The game goes on where it stands."""
        self._operator.say(False, person)

    def left(self, person: str) -> None:
        """What he drove by hand stands, and what he armed is not armed any more."""
        if self._armed == person:
            self._arm(None)
        if self._seat == person:
            self._seat = None
            self._wheels.let_go()

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        """Refused: localization and every node would have to start anew."""
        raise Refused(f"map {name}: a robot's map is chosen when its localization and the game are started")

    def story(self, number: int) -> bytes | None:
        """None: rounds of a robot are recorded by ``pacman-env ros record``."""
        return None

    def tell(self, person: str, message: Message) -> Any:
        """See :meth:`pacman_env.web.game.Game.tell`."""
        match message:
            case messages.Start():
                self._not_stopped()
                self._wheels.let_go()
                return self._call_referee(topics.START_GAME)
            case messages.Reset():
                return self._call_referee(topics.RESET_GAME)
            case messages.Setup():
                return self._set_up(message)
            case messages.ClydeSpeed(mps=mps):
                self._says[topics.BASE_CLYDE_SPEED.name].publish(topics.BASE_CLYDE_SPEED.type(data=mps))
            case messages.PlaceClyde(x=x, y=y, ghost=ghost):
                self._place(x, y, ghost)
            case messages.Stop():
                self.stop(person)
            case messages.Release():
                self.release(person)
            case messages.Seat(who=who):
                return self._sit(person, who)
            case messages.Drive(v=v, omega=omega):
                self._drive(person, v, omega)
            case messages.Event(word=word, what=what):
                self._show(word, what)
            case messages.Arm(on=on):
                self._arm(person if on else None)
            case messages.Ready():
                return self._ready()
            case messages.Stories():
                return []
            case messages.Ping() | messages.Watch() | messages.Control():
                return None
            case messages.Pause():
                raise Refused("a robot's time cannot be held: STOP holds the robot, and Reset ends the round")
            case messages.Speed():
                raise Refused("a robot is as fast as it is; a simulated one is given its speed at the start: --speed")
            case messages.Goal():
                raise Refused("on a robot the policy chooses where to go; by hand it is driven with the arrow keys")
            case messages.Why():
                raise Refused("rounds of a robot are not kept here: record them, and ask by pacman-env ros replay")
            case _:
                raise Refused(f"{type(message).__name__}: not on a robot")
        return None

    # The node's thread

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
                    _LOG.exception("the operator's page goes on after an error")
                    self._news.add(words=words)

    def _look(self) -> None:
        node, now = self._node, self._surroundings.monotonic()
        node.watch(WHY, self._why)
        node.watch(topics.SCAN, self._lidar)
        node.catch_up()
        if now - self._looked_s >= _LOOK_S:
            self._looked_s = now
            self._look_for_game()
            self._set_scene()
        again_s = _CANCEL_AGAIN_S if node.navigating else _LOOK_S  # nobody tells of the base's own motions
        if self._operator.stopped and now - self._cancelled_s >= again_s:
            self._cancel_goals()
        state = node.state
        if state != self._state:
            self._state = state
            if state is not None:
                self._news.add(state=state)
            if state != "menu":  # the game drives
                self._wheels.let_go()
        if not (self._there or node.alive):
            self._frame, self._encoded = None, ""
            return
        frame = self._framed()
        encoded = frame.encode()
        if encoded != self._encoded:
            self._encoded, self._number = encoded, self._number + 1
            self._frame = self._framed(self._number)

    def _look_for_game(self) -> None:
        """Whether a referee is there, who says how the game stands; a change is told."""
        node = self._node
        there = node.count_publishers(node.resolve_topic_name(topics.GAME_STATE.name)) > 0
        where = f"{self._where}, ROS domain {self._domain}"
        was, self._there = self._there, there
        self._notice = "" if there else f"no game is heard in {where}: is 'pacman-env ros up' running there?"
        if there and not was:
            self._news.add(words=f"the game in {where} is there")
        elif was and not there:
            self._news.add(words=f"the game is gone: {self._notice}")
            self._wheels.let_go()
            node.state = None
        if not there and not node.alive:
            node.forget_robot()

    def _set_scene(self) -> None:
        node = self._node
        ids, _ = pellets_of_scene(node)
        facts = {**facts_of(node), "notice": self._notice}
        picture = node.map
        key = json.dumps([facts, ids, id(picture)])
        if key == self._scene_key:
            return
        revision = self._scene.revision % 65535 + 1
        if facts["map"] is not None:
            facts["map"]["url"] = f"/map/{revision}.png"
        self._scene_key, self._pellet_ids = key, ids
        self._scene = Scene(revision, facts, b"" if picture is None else picture.png)

    def _framed(self, number: int = 0) -> Frame:
        node = self._node
        numbers = node.numbers
        candidates = len(node.candidates.get("places", ()))
        scores = np.full(candidates + 1 if candidates else 0, np.nan)
        for candidate, score in node.scores.items():
            if candidate < len(scores):
                scores[candidate] = score
        ghosts = [node.ghosts[k] for k in sorted(node.ghosts)]
        return Frame(
            state=cast(State, node.state or "menu"),
            revision=self._scene.revision,
            number=number,
            time_s=round(node.round_time_s, 2),
            speed=round(node.rate, 1),
            score=int(numbers.get("score", 0)),
            collected=int(numbers.get("collected", 0)),
            spawned=int(numbers.get("spawned", 0)),
            round=int(numbers.get("round", 1)),
            goal=node.goal if node.goal < candidates else -1,
            stopped=self._operator.stopped,
            over=bool(node.result),
            true=node.true,
            believed=node.believed,
            velocity=node.velocity,
            ring=node.ring,
            ghosts=np.array(ghosts, dtype=np.float64).reshape(-1, 2),
            alive=np.array([one in node.shown for one in self._pellet_ids], dtype=np.bool_),
            scores=scores,
            plan=thinned(node.plan),
            scan=node.scan if self._lidar else np.zeros(0),
        )

    # Stop

    def _on_stop(self, stopped: bool, who: str) -> None:
        """The word, from here or from elsewhere."""
        self._news.add(words=f"{'stopped' if stopped else 'released'} by {who}")
        if stopped:
            self._wheels.stop()
            self._cancel_goals()
        else:
            self._wheels.release()

    def _cancel_goals(self) -> None:
        """End every goal that Nav2 pursues and every motion of the base's own, whoever asked for it."""
        self._cancelled_s = self._surroundings.monotonic()
        for canceller in (self._canceller, *self._motions):
            if canceller.service_is_ready():
                canceller.call_async(canceller.srv_type.Request())  # all zero: every goal

    def _publish_velocity(self, v: float, omega: float) -> None:
        self._velocity.publish(twist_message(v, omega, self._node.get_clock().now().to_msg()))

    def _not_stopped(self) -> None:
        if self._operator.stopped:
            raise Refused(f"stopped by {self._operator.who}: release it first")

    # What people ask for

    def _referee(self) -> None:
        if not self._there:
            raise Refused(f"no game is heard in {self._where}: start it by pacman-env ros up")

    def _call_referee(self, service: topics.Service) -> None:
        answer = self._call(service, service.type.Request(), REFEREE)
        if not answer.success:
            raise Refused(str(answer.message))

    def _call(self, service: topics.Service, request: Any, who: str) -> Any:
        """The answer of a service; in the thread of who asks, while the node's thread goes on."""
        client = self._services[service.name]
        if not self._surroundings.wait_for(client.service_is_ready, _THERE_S):
            raise Refused(f"{who} is not there: nobody answers on {service.name} in {self._where}")
        answer = client.call_async(request)
        if not self._surroundings.wait_for(answer.done, _ANSWER_S):
            client.remove_pending_request(answer)
            raise Refused(f"{who} has not answered within {_ANSWER_S:g} s: see whether it was done")
        if answer.exception() is not None:
            raise Refused(f"{who}: {answer.exception()}")
        return answer.result()

    def _set_up(self, setup: messages.Setup) -> None:
        """The policy alone can be changed while the game is up, in the menu; no second one is asked beside it."""
        others = {name for name in setup.__struct_fields__ if name not in ("id", "policy", "second")}
        if setup.policy is None or any(getattr(setup, name) not in (None, False) for name in others):
            raise Refused("on a robot only the policy can be changed here; all else is chosen by pacman-env ros up")
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=setup.policy)
        request = _SET_PARAMETERS.type.Request(parameters=[Parameter(name="policy", value=value)])
        result = self._call(_SET_PARAMETERS, request, SELECTOR).results[0]
        if not result.successful:
            raise Refused(str(result.reason))

    def _place(self, x: float, y: float, ghost: int) -> None:
        self._referee()
        if self._node.state != "menu":
            raise Refused("Clyde is placed in the menu, before a round")
        if ghost != 0:
            raise Refused("on a robot Clyde alone can be placed")
        point = PointStamped(header=Header(stamp=self._node.get_clock().now().to_msg(), frame_id="map"))
        point.point.x, point.point.y = x, y
        self._says[topics.CLICKED_POINT.name].publish(point)

        def there() -> bool:
            at = self._node.ghosts.get(0, _NOWHERE)
            return math.dist(at, (x, y)) < _PLACED_M

        if not self._surroundings.wait_for(there, _PLACED_S):
            raise Refused("Clyde cannot be there: no place near it is wide enough for him")

    def _sit(self, person: str, who: str) -> dict[str, str]:
        if who == "none":
            self.left(person)
        elif who != "robot":
            raise Refused("ghosts are moved by the game here: seats for ghosts are the simulator's")
        elif self._seat not in (None, person):
            raise Refused("somebody else drives")
        else:
            self._seat = person
        return {"words": ""}

    def _drive(self, person: str, v: float, omega: float) -> None:
        """By hand only while nobody else drives: in the menu, without a goal of Nav2's, not stopped."""
        if self._seat != person:
            raise Refused("take the robot's seat first")
        self._not_stopped()
        self._referee()
        if self._node.state != "menu":
            raise Refused("the game drives: by hand in the menu alone; Reset leads there")
        if self._node.navigating:
            raise Refused("Nav2 drives to a goal that somebody has sent it; STOP ends that")
        robot = self._scene.facts
        fastest, turn = float(robot.get("wheels_mps", 0.0)), float(robot.get("turn_radps", 0.0))
        if not self._wheels.drive(min(max(v, -fastest), fastest), min(max(omega, -turn), turn)):
            self._not_stopped()

    def _show(self, word: str, what: str) -> None:
        """A light or a sound; an event is told to the game only when it may move the robot."""
        known: dict[str, Any] = {"event": FEEDBACK, "light": LIGHTS, "sound": MELODIES}
        if word not in known[what]:
            raise Refused(f"{what} {word!r}: there is none")
        self._referee()
        if what != "event":
            topic = topics.GAME_LIGHT if what == "light" else topics.GAME_SOUND
            self._says[topic.name].publish(topic.type(data=word))
            return
        answer = FEEDBACK[word]
        if self._armed and answer.motion in ("spin", "shake"):
            self._not_stopped()
            if self._node.state != "menu" or self._wheels.driven or self._node.navigating:
                raise Refused("somebody else drives: an event moves the robot in the menu alone; disarm first")
            self._shows_until_s = self._surroundings.monotonic() + _LONGEST_SHOW_S
            self._say(topics.GAME_EVENT, word)
            return
        self._news.add(event=word)
        if answer.light is not None:
            self._say(topics.GAME_LIGHT, answer.light)
        if answer.sound is not None:
            self._say(topics.GAME_SOUND, answer.sound)

    def _say(self, topic: topics.Topic, word: str) -> None:
        self._says[topic.name].publish(topic.type(data=word))

    def _arm(self, by: str | None) -> None:
        self._armed = by
        if by is None and self._surroundings.monotonic() < self._shows_until_s and self._node.state == "menu":
            self._say(topics.GAME_EVENT, "reset")  # ends the motion
        self._shows_until_s = 0.0

    def _ready(self) -> list[dict[str, str]]:
        """What ``pacman-env ros doctor`` says, and who obeys a stop; one look at a time."""
        with self._doctors:
            doctor = Doctor(self._where, self._domain, self._occupancy, self._map_file, self._sim, _CHECKS_S)
            try:
                doctor.look(self._closed.is_set)
                found = find(doctor.evidence())
            finally:
                doctor.close()
        rows = [
            {
                "name": one.check,
                "state": "bad" if one.mark == BAD else "ok" if one.mark == OK or not one.cure else "warning",
                "words": one.seen,
                "cure": ": ".join(filter(None, (one.cure, one.command))),
            }
            for one in found
        ]
        return [*rows, self.stop_row()]

    def stop_row(self) -> dict[str, str]:
        """Who obeys a stop, as one row of the readiness list."""
        obey = self._operator.obeyed_by if self._operator.known else []
        if obey:
            words = f"obeyed by {', '.join(obey)}{'; the robot is stopped now' if self._operator.stopped else ''}"
            return {"name": "STOP", "state": "ok", "words": words, "cure": ""}
        cure = "start the game by pacman-env ros up; until then STOP ends Nav2's goals and holds the wheels by itself"
        return {"name": "STOP", "state": "bad", "words": "no node of the game obeys it", "cure": cure}


def _context(domain: int) -> Context:
    """Of the page's own."""
    context = Context()
    no_signals = SignalHandlerOptions.NO
    rclpy.init(args=["--ros-args", *QUIET], context=context, domain_id=domain, signal_handler_options=no_signals)
    return context
