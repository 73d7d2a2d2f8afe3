"""What a fault in lock-step leaves behind, and whom it concerns."""

from __future__ import annotations

from pathlib import Path

import rclpy
from rclpy.context import Context

from pacman_env.ros import topics
from pacman_env.ros.lock_step.stepper import LockStep
from tests.ros import session
from tests.ros.session import Observer


def test_killed_robot_comes_back_as_one_node(domain: int, tmp_path: Path) -> None:
    with session.game(tmp_path, settings=("show.start_s=1.0",)) as game:
        game.record(topics.GAME_STATE)
        assert game.call(topics.START_GAME).success
        game.wait_for(lambda: "running" in game.values(topics.GAME_STATE))
        game.advance(2.0)
        for _ in range(2):
            game.game.kill("sim_robot")
            assert "sim_robot" not in game.observer.get_node_names()
            game.advance(10.0)  # it looks for others with its name meanwhile
            assert game.observer.get_node_names().count("sim_robot") == 1


def test_joined_node_loses_no_packets(domain: int, tmp_path: Path) -> None:
    with session.game(tmp_path) as game:
        beside = game.game.join(Observer)
        counts = {"joined": 0, "robot's": 0}

        def count(name: str) -> None:
            counts[name] += 1

        game.game.subscribe(beside, lambda: topics.ODOMETRY.subscription(beside, lambda _: count("joined")))
        game.game.subscribe(
            game.observer, lambda: topics.ODOMETRY.subscription(game.observer, lambda _: count("robot's"))
        )
        game.game.losses.begin("sim_robot", 50.0, game.now_s)
        game.advance(20.0)
        assert counts["joined"] == 400
        assert 150 < counts["robot's"] < 250


def test_request_is_observed_in_order_without_server(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as nodes:
        heard: list[str] = []
        game, observer = nodes.game, nodes.observer
        topics.GAME_EVENT.subscription(observer, lambda message: heard.append(message.data))
        game.observe_requests(observer, f"{session.NAMESPACE}/game/start", lambda request: heard.append("start"))
        client = topics.START_GAME.client(observer)
        event = topics.GAME_EVENT.publisher(observer)

        def do() -> None:
            event.publish(topics.GAME_EVENT.type(data="before"))
            client.call_async(topics.START_GAME.type.Request())
            event.publish(topics.GAME_EVENT.type(data="after"))

        game.within(observer, do)
        assert heard == ["before", "start", "after"]


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
