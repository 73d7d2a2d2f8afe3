"""A node killed and started again finds its way back into the running game; all other nodes go on.

One whole game in lock-step serves every test; each brings it to where it needs it. Times are simulated. That processes
killed with SIGKILL find one another again is in ``test_killed_processes.py``.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.config import ClydeConfig
from pacman_env.game.events import SOUNDS
from pacman_env.game.execution import CANCELED
from pacman_env.game.sounds import frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.messages import pose_of, seconds_of
from pacman_env.ros.simulated_robot.sim_robot import LIGHT_RING_SHOWN
from tests.ros import session
from tests.ros.running_game import CLYDE_MPS, FAR_M, HOME, POLICY, SETTINGS, Game

MAP = "loop"
EXECUTING = 2  # action_msgs/GoalStatus


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("game")
    with session.game(folder, MAP, POLICY, seed=2, settings=SETTINGS, home=HOME) as running:
        yield Game(running, MAP)
        assert running.errors() == []


@pytest.fixture
def game(whole: Game) -> Game:
    """With all its nodes, even if a test before this one has failed halfway."""
    whole.nodes_are_there()
    return whole


def test_a_pellet_manager_that_is_back_shows_no_pellet_that_was_collected(game: Game) -> None:
    game.play()
    game.collect(2)
    spawned = game.value(topics.PELLETS_SPAWNED)
    game.kill("pellet_manager")
    game.forget(topics.PELLET_MARKERS)
    game.start("pellet_manager")
    game.wait(lambda: game.messages(topics.PELLET_MARKERS), "a report")
    game.wait(lambda: not set(game.collected()) & set(game.shown()), "the collected pellets to vanish", 1.0)
    game.collect(1)
    assert game.value(topics.PELLETS_SPAWNED) == spawned


def test_a_clyde_that_is_back_is_away_from_the_robot_and_walks_as_fast_as_before(game: Game) -> None:
    game.play()
    game.kill("clyde_ghost_node")
    game.forget(topics.CLYDE_POSE)
    game.start("clyde_ghost_node")
    game.wait(lambda: game.messages(topics.CLYDE_POSE), "Clyde")
    assert math.dist(game.clyde(), game.robot()) > ClydeConfig().spawn_distance_m
    game.wait(lambda: len(game.messages(topics.CLYDE_POSE)) > 40, "Clyde's way")
    seen = [pose_of(message)[:2] for message in game.messages(topics.CLYDE_POSE)]
    steps_m = [math.dist(*pair) for pair in itertools.pairwise(seen)]
    assert statistics.median(steps_m) == pytest.approx(CLYDE_MPS * ClydeConfig().update_period_s, rel=1e-3)
    assert game.state == "running"


def test_a_goal_selector_that_is_back_plays_on_and_collects_nothing_twice(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("goal_selector")
    game.start("goal_selector")
    had, commands = len(game.collected()), len(game.values(topics.GAME_COMMAND))
    game.wait(lambda: len(game.collected()) >= had + 2, "two pellets more")
    assert len(set(game.collected())) == len(game.collected())
    game.collect(0)
    assert "reset_round" not in game.values(topics.GAME_COMMAND)[commands:]


def test_a_goal_selector_that_is_back_in_the_menu_stops_what_nav2_still_drives_to(game: Game) -> None:
    game.begin()
    game.until("running")
    game.wait(lambda: game.drives() and EXECUTING in game.goals().values(), "the robot to drive")
    (goal,) = [key for key, status in game.goals().items() if status == EXECUTING]
    game.kill("goal_selector")
    assert game.session.call(topics.RESET_GAME).success
    game.until("menu")
    game.session.advance(0.5)
    assert game.drives()
    assert game.goals()[goal] == EXECUTING
    game.start("goal_selector")
    game.wait(lambda: game.goals()[goal] == CANCELED, "the goal to be cancelled", 5.0)
    game.wait(lambda: not game.drives(), "the robot to stand", 2.0)
    assert EXECUTING not in game.goals().values()


def test_a_goal_selector_that_is_back_brings_the_robot_home(game: Game) -> None:
    score, round_ = game.complete()
    game.kill("goal_selector")
    game.start("goal_selector", "home")
    game.until("menu")
    game.stands_at(score, round_ + 1)
    assert math.hypot(*game.robot()) < FAR_M / 2


def test_a_referee_that_is_back_goes_on_with_the_round_and_counts_what_was_collected_meanwhile(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("game_controller")
    had = len(game.collected())
    commands = len(game.values(topics.GAME_COMMAND))
    game.wait(lambda: len(game.collected()) > had, "a pellet that is not counted")
    game.start("game_controller")
    game.wait(lambda: len(game.values(topics.GAME_COMMAND)) > commands, "the referee")
    # The planner repeats every 2 s what was unanswered 2 s before.
    game.wait(game.counted, "the pellet to be counted", 4.1)
    assert game.state == "running"
    game.collect(1)
    assert set(game.values(topics.GAME_COMMAND)[commands:]) == {"enable"}
    assert game.value(topics.SCORE) >= had + 2
    assert game.value(topics.CLYDE_SPEED) == pytest.approx(CLYDE_MPS)


@pytest.mark.daily
def test_a_referee_who_was_killed_counts_all_that_was_collected_meanwhile(game: Game) -> None:
    game.begin()
    game.until("running")
    spawned = game.value(topics.PELLETS_SPAWNED)
    game.collect(1)
    game.kill("game_controller")
    game.wait(lambda: len(game.removed()) >= 3, "pellets that are not counted")
    assert game.value(topics.SCORE) == 1
    game.forget(topics.PELLETS_SPAWNED)
    game.start("game_controller")
    game.wait(lambda: game.state == "returning_home", "the end of the round", 600.0)
    assert game.value(topics.GAME_RESULT) == f"Complete - Score: {spawned}"
    assert game.value(topics.SCORE) == len(game.removed()) == spawned
    assert {value for value in game.values(topics.PELLETS_SPAWNED) if value} == {spawned}


def test_a_referee_that_is_back_learns_of_a_death_that_it_missed(game: Game) -> None:
    game.play(1)
    game.kill("game_controller")
    game.die()
    said = len(game.values(topics.GAME_STATE))
    game.start("game_controller")
    game.until("dying")
    assert game.values(topics.GAME_STATE)[said:] == ["running", "dying"]
    assert game.value(topics.GAME_RESULT).startswith("Death")
    game.until("menu")


def test_a_referee_that_is_back_on_the_way_home_ends_the_round(game: Game) -> None:
    score, round_ = game.complete()
    game.kill("game_controller")
    game.wait(lambda: "home_reached" in game.values(topics.GAME_STATUS), "home, without a referee")
    game.start("game_controller")
    game.until("menu")
    game.stands_at(score, round_ + 1)


def test_a_referee_that_is_back_in_the_start_show_begins_the_round(game: Game) -> None:
    game.begin()
    game.kill("game_controller")
    said = len(game.values(topics.GAME_STATE))
    game.start("game_controller")
    game.until("running")
    assert game.values(topics.GAME_STATE)[said:] == ["starting", "running"]
    game.collect(1)


def test_a_referee_that_is_back_in_the_death_show_sends_the_robot_home(game: Game) -> None:
    game.play(1)
    game.die()
    game.until("dying")
    game.kill("game_controller")
    said = len(game.values(topics.GAME_STATE))
    game.start("game_controller")
    game.until("menu")
    assert game.values(topics.GAME_STATE)[said:] == ["dying", "returning_home", "menu"]
    game.stands_at(0, 1)


def test_a_robot_whose_spin_has_lost_its_node_stands_and_the_node_comes_back_silent(game: Game) -> None:
    def turns(since_s: float) -> bool:
        velocities = [one for one in game.messages(topics.CMD_VEL) if one.twist.angular.z != 0.0]
        return any(seconds_of(one.header.stamp) > since_s for one in velocities)

    game.begin()
    game.wait(lambda: turns(0.0) and game.turn() > 1.0, "the spin")
    game.kill("game_event_mapper")
    game.wait(lambda: not game.drives(), "the robot to stand", 2.0)
    assert game.state == "starting"  # by the base's own time-out: nothing else has stopped it
    stood_s = seconds_of(game.latest(topics.ODOMETRY).header.stamp)
    game.forget(topics.GAME_LIGHT)
    game.start("game_event_mapper")
    game.until("running")
    game.wait(lambda: "pellet" in game.values(topics.GAME_LIGHT), "an event to be shown again")
    assert not turns(stood_s)


def starts(game: Game) -> bool:
    """Whether the ring shows the lights of a start, which are of more than two colours."""
    return game.ring()["override_system"] and len(set(map(tuple, game.ring()["leds"]))) > 2


def test_a_light_node_that_is_back_in_a_round_shows_what_belongs_to_it(game: Game) -> None:
    game.begin()
    game.wait(lambda: starts(game), "the start's lights", 4.0)
    game.kill("game_light_node")
    game.forget(LIGHT_RING_SHOWN)
    yellow, black = [255, 180, 0], [0, 0, 0]

    def mouths() -> set[str]:
        rings = [json.loads(text) for text in game.values(LIGHT_RING_SHOWN)]
        return {
            str(one["leds"])
            for one in rings
            if one["override_system"] and all(led in (yellow, black) for led in one["leds"])
        }

    game.start("game_light_node")
    game.wait(lambda: len(mouths()) == 3, "the mouth to open and shut")


def test_a_light_node_that_is_back_in_the_menu_releases_the_ring(game: Game) -> None:
    game.begin()
    game.wait(lambda: starts(game), "the start's lights", 4.0)
    game.kill("game_light_node")
    game.menu()
    assert game.ring()["override_system"]
    game.start("game_light_node")
    game.wait(lambda: not game.ring()["override_system"], "the ring to be the base's own")


def test_an_audio_node_that_is_back_plays_the_next_sound(game: Game) -> None:
    game.begin()
    game.wait(lambda: game.sound()["playing"], "the theme")
    game.kill("audio_node")
    game.start("audio_node")
    notes = [frequency_hz(note) for note, _ in SOUNDS["pellet"].melody]
    game.wait(lambda: game.sound()["playing"] and [note for note, _ in game.sound()["notes"]] == notes, "a pellet")
