"""Whole games in lock-step: the same seed is the same game; kills, losses and what they leave behind."""

import random
import time
from pathlib import Path

import rclpy
from rclpy.context import Context

from benchmarks.transcript import Transcript
from pacman_env.ros import topics
from pacman_env.ros.lock_step.lock_step_game import RESTART_S
from pacman_env.ros.lock_step.stepper import LockStep
from tests.map_parts import part_of_map
from tests.ros import session
from tests.ros.lock_step.losses import MessageLosses
from tests.ros.session import Observer

SHOWS = ("show.start_s=1.0", "show.death_s=1.0")


def played(folder: Path, seed: int, is_slow: bool = False) -> tuple[int, str, list[str]]:
    """Play one game with power pellets; return how many messages were handled, their hash, and the states.

    On a slow machine each step takes some real time, now more, now less.
    """
    folder.mkdir()
    ground = part_of_map("house", 3.0).save(folder / "ground.yaml")
    settings = (*SHOWS, "power.pellets=2", "clyde.ghosts=wander,arcade")
    with session.game(folder, ground, seed=seed, settings=settings) as game:
        game.record(topics.GAME_STATE)
        transcript = Transcript(game.game)
        assert game.call(topics.START_GAME).success
        game.clear()

        def is_over() -> bool:
            time.sleep(0.004 * random.random() if is_slow else 0.0)
            return "menu" in game.values(topics.GAME_STATE)

        game.wait_for(is_over, 900, "the end of the game")
        return transcript.messages, transcript.hexdigest(), game.values(topics.GAME_STATE)


def test_same_seed_is_same_game_message_for_message(domain: int, tmp_path: Path) -> None:
    first, other = played(tmp_path / "idle", 3), played(tmp_path / "other", 4)
    again = played(tmp_path / "slow", 3, is_slow=True)
    assert first == again
    assert first[2][-2:] == ["returning_home", "menu"]
    assert first[1] != other[1]


def test_killed_robot_comes_back_as_one_node_after_restart(domain: int, tmp_path: Path) -> None:
    with session.game(tmp_path, settings=("show.start_s=1.0",)) as game:
        game.record(topics.GAME_STATE)
        assert game.call(topics.START_GAME).success
        game.wait_for(lambda: "running" in game.values(topics.GAME_STATE))
        game.advance(2.0)
        for _ in range(2):
            game.game.kill("sim_robot")
            game.advance(RESTART_S - 0.1)
            assert "sim_robot" not in game.observer.get_node_names()
            game.advance(10.0)  # it looks for others with its name meanwhile
            assert game.observer.get_node_names().count("sim_robot") == 1


def test_spared_node_loses_no_packets(domain: int, tmp_path: Path) -> None:
    with session.game(tmp_path) as game:
        beside = game.game.join(Observer)
        counts = {"joined": 0, "robot's": 0}

        def count(name: str) -> None:
            counts[name] += 1

        game.game.subscribe(beside, lambda: topics.ODOMETRY.subscription(beside, lambda _: count("joined")))
        game.game.subscribe(
            game.observer, lambda: topics.ODOMETRY.subscription(game.observer, lambda _: count("robot's"))
        )
        losses = MessageLosses(game.game, 0, *(one for one in game.game.members if one.node is beside))
        losses.begin("sim_robot", 50.0)
        game.advance(20.0)
        assert counts["joined"] == 400
        assert 150 < counts["robot's"] < 250


def test_nodes_alone_meet_no_other_process(domain: int) -> None:
    game = LockStep(alone=True)
    context = Context()
    try:
        game.add(Observer, ["--ros-args", "-r", "__ns:=/alone"])
        rclpy.init(context=context)
        other = rclpy.create_node("other", context=context)
        third = rclpy.create_node("third", context=context)
        member = game.member("observer")
        assert member is not None
        assert member.node.get_node_names() == ["observer"]
        assert sorted(other.get_node_names()) == ["other", "third"]
        for node in (other, third):
            node.destroy_node()
    finally:
        game.close()
        context.try_shutdown()
