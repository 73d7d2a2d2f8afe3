"""A node killed with SIGKILL and started again finds its way back into the running game; all other nodes go on.

One whole system, ten times as fast as time, serves every test; each brings the game to where it needs it.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import statistics
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.config import ClydeConfig
from pacman_env.game.execution import CANCELED
from pacman_env.game.sounds import MELODIES, frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.messages import pellets_of, pose_message, pose_of, seconds_of
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, FAULT, LIGHT_RING_SHOWN
from pacman_env.ros.supervisor.game_nodes import module_of
from tests.ros.system import PATIENCE_S, Probe, System

if TYPE_CHECKING:
    from tests.ros.system import Process

MAP = "loop"
START_S = 240.0  # the first nodes may have to compile
FAR_M = 3.0  # from home
CLYDE_MPS = 0.02  # a robot that stands for as long as its planner is away is not caught meanwhile
NODES: dict[str, dict[str, Any]] = {
    "sim_robot": {"speed": 10.0, "map_yaml": MAP},
    "pellet_manager": {"map_yaml": MAP},
    "clyde_ghost_node": {"map_yaml": MAP},
    # The shows are long enough for a kill in the midst of them on a slow machine.
    "game_controller": {"settings": [f"clyde.speed_mps={CLYDE_MPS}", "show.start_s=15", "show.death_s=30"]},
    "game_event_mapper": {},
    "game_light_node": {},
    "audio_node": {},
    # Not clyde_aware, whose rounds Clyde ends too often; home is the map's.
    "goal_selector": {"map_yaml": MAP, "policy": "lookahead", "home": "[0.0, 0.0, 0.0]"},
}
ACTIVE = {1, 2, 3}  # action_msgs/GoalStatus: accepted, executing, canceling


def unabridged(topic: topics.Topic) -> topics.Topic:
    """A latched topic of which every value is heard."""
    return dataclasses.replace(topic, qos=topics.COMMANDS)


GOALS = unabridged(topics.NAVIGATE_TO_POSE.statuses)

LATCHED = STATE, RESULT, SCORE, ROUND, SPAWNED, COLLECTED, SPEED = [
    unabridged(topic)
    for topic in (
        *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND),
        *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
    )
]
HEARD = (
    *(*LATCHED, topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_STATUS, topics.GAME_LIGHT, topics.PELLET_MARKERS),
    topics.REMOVE_PELLET,
    *(topics.CLYDE_POSE, topics.AMCL_POSE, topics.ODOMETRY, topics.CMD_VEL, GOALS, LIGHT_RING_SHOWN, AUDIO_SHOWN),
)


class Game:
    """All nodes but the operator, who is the test."""

    def __init__(self, probe: Probe, system: System, nodes: Mapping[str, Mapping[str, Any]] = NODES) -> None:
        self.probe, self.system, self.nodes = probe, system, nodes
        self.processes: dict[str, Process] = {}
        self._before: dict[str, Any] = {}  # the last that was heard of a topic before what was heard was forgotten
        probe.record(*HEARD)
        for name in nodes:
            self.start(name)
        self.wait(lambda: self.state == "menu", "the referee", START_S)
        seen = (topics.PELLET_MARKERS, topics.CLYDE_POSE, topics.AMCL_POSE, topics.ODOMETRY)
        self.wait(lambda: all(self.latest(topic) is not None for topic in seen), "pellets, Clyde, the robot", START_S)
        name = f"{system.namespace}/{topics.GAME_LIGHT.name}"
        self.wait(lambda: probe.node.count_subscribers(name) >= 2, "the lights", START_S)
        self.wait(lambda: "policy lookahead" in self.processes["goal_selector"].output, "the planner", START_S)

    def start(self, name: str, *left_out: str) -> None:
        parameters = {key: value for key, value in self.nodes[name].items() if key not in left_out}
        self.processes[name] = self.system.start(module_of(name), use_sim_time=True, **parameters)

    def kill(self, name: str) -> None:
        """As a crash does it: nothing is said."""
        process = self.processes.pop(name)
        process.popen.kill()
        process.popen.wait()
        self.system.processes.remove(process)

    def wait(self, condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
        return self.probe.wait_for(condition, timeout_s, what)

    def latest(self, topic: topics.Topic) -> Any:
        """What was heard last, None: nothing."""
        heard = self.probe.heard(topic)
        return heard[-1].message if heard else self._before.get(topic.name)

    def value(self, topic: topics.Topic) -> Any:
        message = self.latest(topic)
        return None if message is None else message.data

    def forget(self, *forgotten: topics.Topic) -> None:
        """What is heard from now on counts."""
        for topic in forgotten:
            self._before[topic.name] = self.latest(topic)
            self.probe.heard(topic).clear()

    @property
    def state(self) -> str:
        return str(self.value(STATE))

    def until(self, state: str) -> None:
        self.wait(lambda: self.state == state, f"state {state}")

    def collected(self) -> list[int]:
        """Ids reported in this round, in order; a report may be made more than once."""
        words = self.probe.values(topics.GAME_STATUS)
        return [int(word.partition(":")[2]) for word in words if word.startswith("pellet_collected")]

    def shown(self) -> dict[int, tuple[float, float]]:
        return pellets_of(self.latest(topics.PELLET_MARKERS))

    def robot(self) -> tuple[float, float]:
        return pose_of(self.latest(topics.AMCL_POSE))[:2]

    def clyde(self) -> tuple[float, float]:
        return pose_of(self.latest(topics.CLYDE_POSE))[:2]

    def drives(self) -> bool:
        return abs(self.latest(topics.ODOMETRY).twist.twist.linear.x) > 0.02 or abs(self.turn()) > 0.05

    def turn(self) -> float:
        return float(self.latest(topics.ODOMETRY).twist.twist.angular.z)

    def sound(self) -> Any:
        """What the loudspeaker was told last; silence, if it was told nothing yet."""
        return json.loads(self.value(AUDIO_SHOWN) or '{"playing": false}')

    def menu(self) -> None:
        """Nothing goes on; what was heard before is forgotten."""
        assert self.probe.call(topics.RESET_GAME).success
        self.until("menu")
        self.wait(lambda: not self.drives(), "the robot to stand")
        self.forget(*HEARD)

    def begin(self) -> None:
        """A round, as far as the start show."""
        self.menu()
        assert self.probe.call(topics.START_GAME).success
        self.until("starting")

    def play(self, left: int = 5) -> None:
        """A round that runs, with some pellets to go."""
        if self.state != "running" or self.value(SPAWNED) - self.value(COLLECTED) < left:
            self.begin()
        self.until("running")
        self.wait(lambda: self.value(SPAWNED) > 0, "the pellets")

    def away(self) -> bool:
        """Whether the robot is far from home."""
        return math.hypot(*self.robot()) > FAR_M

    def collect(self, more: int) -> None:
        """The round goes on by some pellets, each of which counts once."""
        self.counted()
        had = self.value(SCORE)
        self.wait(lambda: self.value(SCORE) >= had + more, f"{more} pellets more")
        assert self.state == "running"
        self.counted()

    def counted(self) -> None:
        """All that is reported counts: of a pellet, the number comes first and then the score, from 0 in each round."""
        self.wait(
            lambda: self.value(SCORE) == self.value(COLLECTED) == len(set(self.collected())), "each to be counted"
        )

    def killed_in(self, state: str, name: str, reach: Callable[[], None]) -> None:
        """Kill a node while a show goes on, however late this machine lets that be: then it is tried again."""
        for _ in range(5):
            reach()
            self.kill(name)
            self.probe.spin(0.2)  # what it has said before
            if self.state == state:
                return
            self.start(name)
        raise AssertionError(f"the state {state} was over five times before {name} was killed")

    @contextmanager
    def held(self) -> Iterator[None]:
        """The robot goes nowhere, once it has arrived where it drives to: no round ends while a node comes up."""
        self.probe.publish(FAULT, "reject")
        try:
            yield
        finally:
            self.probe.publish(FAULT, "end reject")

    def complete(self) -> tuple[int, int]:
        """The round is over, as the planner says, far from home; its score, and its number."""
        for _ in range(5):  # a round may end before its robot has been that far, and before the planner is heard
            self.play(7)
            self.wait(lambda: self.away() or self.state != "running", "the robot to be away")
            round_ = self.value(ROUND)
            if self.state == "running":
                self.probe.publish(topics.GAME_STATUS, "game_complete")
            self.wait(lambda: self.state != "running", "the end of the round")
            if "dying" not in self.probe.values(STATE):
                break
        result = self.wait(lambda: "Complete" in self.value(RESULT) and self.value(RESULT), "the result")
        return int(result.rpartition(" ")[2]), round_

    def stands_at(self, score: int, round_: int) -> None:
        self.wait(lambda: (self.value(SCORE), self.value(ROUND)) == (score, round_), f"score {score}, round {round_}")

    def die(self) -> None:
        """Clyde is where the robot is, so that the planner sees it."""

        def caught() -> bool:
            self.probe.publisher(topics.CLYDE_POSE).publish(pose_message(*self.robot(), 0.0, self.probe.stamp()))
            return "death_detected" in self.probe.values(topics.GAME_STATUS)

        self.wait(caught, "the death")


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        with System(tmp_path_factory.mktemp("system")) as system, Probe(system) as probe:
            game = Game(probe, system)
            yield game
            for name in list(game.processes):  # how they end in order is tested elsewhere
                game.kill(name)


@pytest.fixture
def game(whole: Game) -> Game:
    """With all its nodes, even if a test before this one has failed halfway."""
    for name in NODES:
        if name not in whole.processes:
            whole.start(name)
    return whole


def test_a_pellet_manager_that_is_back_shows_no_pellet_that_was_collected(game: Game) -> None:
    game.play()
    game.collect(2)
    spawned = game.value(SPAWNED)
    with game.held():
        game.kill("pellet_manager")
        game.forget(topics.PELLET_MARKERS)
        game.start("pellet_manager")
        game.wait(lambda: game.probe.heard(topics.PELLET_MARKERS), "a report")
        game.wait(lambda: not set(game.collected()) & set(game.shown()), "the collected pellets to vanish")
    game.collect(1)
    assert game.value(SPAWNED) == spawned


def test_a_clyde_who_is_back_is_away_from_the_robot_and_walks_as_fast_as_before(game: Game) -> None:
    game.play()
    with game.held():
        game.kill("clyde_ghost_node")
        game.forget(topics.CLYDE_POSE)
        poses = game.probe.heard(topics.CLYDE_POSE)
        game.start("clyde_ghost_node")
        game.wait(lambda: poses, "Clyde")
        moved_on_m = 1.0  # since the pose that Clyde's node has heard
        assert math.dist(game.clyde(), game.robot()) > ClydeConfig().spawn_distance_m - moved_on_m

        def step_m() -> float:
            """Most steps: a late node takes two at once, one that is too late leaves some out."""
            seen = [pose_of(heard.message)[:2] for heard in poses]
            return statistics.median(itertools.starmap(math.dist, itertools.pairwise(seen)))

        game.wait(lambda: len(poses) > 20 and step_m() > 0, "Clyde to walk")
        game.forget(topics.CLYDE_POSE)
        game.wait(lambda: len(poses) > 60, "Clyde's way")
        assert step_m() == pytest.approx(CLYDE_MPS * ClydeConfig().update_period_s, rel=0.1)
        assert game.state == "running"


def test_a_goal_selector_that_is_back_plays_on_and_collects_nothing_twice(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("goal_selector")
    game.start("goal_selector")
    had = len(game.collected())
    game.wait(lambda: len(game.collected()) >= had + 2, "two pellets more")
    assert len(set(game.collected())) == len(game.collected())
    game.collect(0)
    assert "reset_round" not in game.probe.values(topics.GAME_COMMAND)[4:]


def test_a_goal_selector_that_is_back_in_the_menu_stops_what_nav2_still_drives_to(game: Game) -> None:
    game.play()
    game.kill("goal_selector")
    game.menu()
    client = game.probe.action_client(topics.NAVIGATE_TO_POSE)
    places = list(game.shown().values())
    far = max(itertools.combinations(places, 2), key=lambda pair: math.dist(*pair))
    sent: list[Any] = []

    def states_of_ours() -> list[int | None]:
        """The last state heard of each goal; Nav2 lists one that has ended only for a while."""
        heard: dict[bytes, int] = {}
        for message in game.probe.messages(GOALS):
            heard |= {bytes(goal.goal_info.goal_id.uuid): goal.status for goal in message.status_list}
        return [heard.get(bytes(one.result().goal_id.uuid)) for one in sent if one.done()]

    def orphan_cancelled() -> bool:
        """As the goal that the killed node left behind, but there is one at every instant: the robot never arrives."""
        states = states_of_ours()
        if CANCELED in states:
            return True
        heard_of_all = len(states) == len(sent) and None not in states
        near = not ACTIVE & set(states) or math.dist(game.robot(), far[len(sent) % 2 - 1]) < FAR_M
        if heard_of_all and near:
            pose = pose_message(*far[len(sent) % 2], 0.0, game.probe.stamp())
            sent.append(client.send_goal_async(topics.NAVIGATE_TO_POSE.type.Goal(pose=pose)))
        return False

    game.wait(lambda: orphan_cancelled() or game.drives(), "the robot to drive")
    game.start("goal_selector")
    game.wait(orphan_cancelled, "the goal to be cancelled")
    game.wait(lambda: not ACTIVE & set(states_of_ours()) and not game.drives(), "the robot to stand")
    client.destroy()


def test_a_goal_selector_that_is_back_brings_the_robot_home(game: Game) -> None:
    score, round_ = game.complete()
    game.kill("goal_selector")
    game.start("goal_selector", "home")
    game.until("menu")
    game.stands_at(score, round_ + 1)
    # Nothing drives in the menu; where the robot is may be heard after the state.
    game.wait(lambda: math.hypot(*game.robot()) < FAR_M / 2, "the robot at home")


def test_a_referee_who_is_back_goes_on_with_the_round_and_counts_what_was_collected_meanwhile(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("game_controller")
    had = len(game.collected())
    commands = len(game.probe.values(topics.GAME_COMMAND))
    game.wait(lambda: len(game.collected()) > had, "a pellet that nobody counts")
    with game.held():
        game.start("game_controller")
        game.wait(lambda: len(game.probe.values(topics.GAME_COMMAND)) > commands, "the referee")
        game.counted()
    assert game.state == "running"
    game.collect(1)
    assert set(game.probe.values(topics.GAME_COMMAND)[commands:]) == {"enable"}
    assert game.value(SCORE) >= had + 2
    assert game.value(SPEED) == pytest.approx(CLYDE_MPS)


def test_a_referee_who_is_back_hears_of_a_death_that_he_missed(game: Game) -> None:
    game.play(1)
    game.kill("game_controller")
    game.die()
    said = len(game.probe.values(STATE))
    game.start("game_controller")
    game.until("dying")
    assert game.probe.values(STATE)[said:] == ["running", "dying"]
    game.wait(lambda: game.value(RESULT).startswith("Death"), "the result")
    game.until("menu")


def test_a_referee_who_is_back_on_the_way_home_ends_the_round(game: Game) -> None:
    score, round_ = game.complete()
    game.kill("game_controller")
    game.wait(lambda: "home_reached" in game.probe.values(topics.GAME_STATUS), "home, with nobody to hear it")
    game.start("game_controller")
    game.until("menu")
    game.stands_at(score, round_ + 1)


def test_a_referee_who_is_back_in_the_start_show_begins_the_round(game: Game) -> None:
    game.killed_in("starting", "game_controller", game.begin)
    said = len(game.probe.values(STATE))
    game.start("game_controller")
    game.until("running")
    assert game.probe.values(STATE)[said:] == ["starting", "running"]
    game.collect(1)


def test_a_referee_who_is_back_in_the_death_show_sends_the_robot_home(game: Game) -> None:
    def die() -> None:
        game.play(1)
        game.die()
        game.until("dying")

    game.killed_in("dying", "game_controller", die)
    said = len(game.probe.values(STATE))
    game.start("game_controller")
    game.until("menu")
    assert game.probe.values(STATE)[said:] == ["dying", "returning_home", "menu"]
    game.stands_at(0, 1)


def test_a_robot_whose_spin_has_lost_its_node_stands_and_the_node_comes_back_silent(game: Game) -> None:
    def turns(since_s: float) -> bool:
        heard = game.probe.messages(topics.CMD_VEL)
        return any(m.twist.angular.z != 0.0 and seconds_of(m.header.stamp) > since_s for m in heard)

    for _ in range(5):  # in vain where this machine is so late that the show is over meanwhile
        game.begin()
        game.wait(lambda: (turns(0.0) and game.turn() > 1.0) or game.state == "running", "the spin")
        game.kill("game_event_mapper")
        game.wait(lambda: not game.drives() or game.state == "running", "the robot to stand")
        if game.state == "starting":
            break
        game.start("game_event_mapper")
    assert game.state == "starting"  # by the base's own time-out: nobody else has said anything
    stood_s = seconds_of(game.latest(topics.ODOMETRY).header.stamp)
    game.forget(topics.GAME_LIGHT)
    game.start("game_event_mapper")
    game.until("running")
    game.wait(lambda: "pellet" in game.probe.values(topics.GAME_LIGHT), "an event to be shown again")
    assert not turns(stood_s)


def ring(game: Game) -> Any:
    """What the ring was told last; the base's own lights, if it was told nothing yet."""
    return json.loads(game.value(LIGHT_RING_SHOWN) or '{"override_system": false}')


def starts(game: Game) -> bool:
    """Whether the ring shows the lights of a start, which are of more than two colours."""
    return ring(game)["override_system"] and len(set(map(tuple, ring(game)["leds"]))) > 2


def test_a_light_node_that_is_back_in_a_round_shows_what_belongs_to_it(game: Game) -> None:
    game.begin()
    game.wait(lambda: starts(game), "the start's lights")
    game.kill("game_light_node")
    game.forget(LIGHT_RING_SHOWN)
    shown = game.probe.heard(LIGHT_RING_SHOWN)
    yellow, black = [255, 180, 0], [0, 0, 0]

    def mouths() -> set[str]:
        rings = [json.loads(heard.message.data) for heard in shown]
        return {
            str(one["leds"])
            for one in rings
            if one["override_system"] and all(led in (yellow, black) for led in one["leds"])
        }

    with game.held():
        game.start("game_light_node")
        game.wait(lambda: len(mouths()) == 3, "the mouth to open and shut")


def test_a_light_node_that_is_back_in_the_menu_releases_the_ring(game: Game) -> None:
    game.begin()
    game.wait(lambda: starts(game), "the start's lights")
    game.kill("game_light_node")
    game.menu()
    assert ring(game)["override_system"]
    game.start("game_light_node")
    game.wait(lambda: not ring(game)["override_system"], "the ring to be the base's own")


def test_an_audio_node_that_is_back_plays_the_next_sound(game: Game) -> None:
    game.begin()
    game.wait(lambda: game.sound()["playing"], "the theme")
    game.kill("audio_node")
    game.start("audio_node")
    notes = [frequency_hz(note) for note, _ in MELODIES["pellet"]]
    game.wait(lambda: game.sound()["playing"] and [note for note, _ in game.sound()["notes"]] == notes, "a pellet")
