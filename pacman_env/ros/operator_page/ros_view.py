"""What is shown of a robot's game: whether it is there, its scene and its frames, from what the node has received."""

from __future__ import annotations

import json
from typing import cast

import numpy as np

from pacman_env.ros import topics
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_page.scenes import facts_of, pellets_of_scene
from pacman_env.web.frame import Frame, State, thinned
from pacman_env.web.game import Scene
from pacman_env.web.news import News


class RosView:
    """The scene and the newest frame.

    Args:
        node: has received what they are made of.
        where: the game is, in words.
        news: that the game came, or is gone, is added to it.
    """

    def __init__(self, node: PageNode, where: str, news: News) -> None:
        self.scene = Scene(1, {"map": None, "preparing": True})
        self.frame: Frame | None = None  # None: neither a game nor a robot is there
        self.game_is_there: bool | None = None  # None: nobody has looked yet
        self._robot_gone = True  # neither referee nor robot
        self._node, self._where, self._news = node, where, news
        self._scene_key = ""
        self._pellet_ids: list[int] = []
        self._encoded, self._number = "", 0
        self._notice = ""  # what a page shows in the place of a game

    def find_game(self) -> bool:
        """Look whether a referee is there; returns whether it has gone."""
        node = self._node
        there = node.count_publishers(node.resolve_topic_name(topics.GAME_STATE.name)) > 0
        was, self.game_is_there = self.game_is_there, there
        self._notice = "" if there else f"no game is heard in {self._where}: is 'pacman-env ros up' running there?"
        gone = bool(was and not there)
        if there and not was:
            self._news.add(words=f"the game in {self._where} is there")
        elif gone:
            self._news.add(words=f"the game is gone: {self._notice}")
            node.game.state = None
        robot_gone = not there and not node.robot.alive
        if robot_gone and not self._robot_gone:  # once: what is latched of the next robot may come before its odometry
            node.forget_robot()
        self._robot_gone = robot_gone
        return gone

    def update_scene(self) -> None:
        """Another scene, where it has changed."""
        node = self._node
        ids, _ = pellets_of_scene(node.game)
        facts = {**facts_of(node), "notice": self._notice}
        picture = node.robot.map
        key = json.dumps([facts, ids, id(picture)])
        if key == self._scene_key:
            return
        revision = self.scene.revision % 65535 + 1
        if facts["map"] is not None:
            facts["map"]["url"] = f"/map/{revision}.png"
        self._scene_key, self._pellet_ids = key, ids
        self.scene = Scene(revision, facts, b"" if picture is None else picture.png)

    def update_frame(self, stopped: bool, lidar: bool) -> None:
        """Another frame, where what it shows has changed."""
        if not (self.game_is_there or self._node.robot.alive):
            self.frame, self._encoded = None, ""
            return
        encoded = self._framed(0, stopped, lidar).encode()
        if encoded != self._encoded:
            self._encoded, self._number = encoded, self._number + 1
            self.frame = self._framed(self._number, stopped, lidar)

    def _framed(self, number: int, stopped: bool, lidar: bool) -> Frame:
        robot, game = self._node.robot, self._node.game
        numbers = game.numbers
        candidates = len(game.candidates.get("places", ()))
        scores = np.full(candidates + 1 if candidates else 0, np.nan)
        for candidate, score in game.scores.items():
            if candidate < len(scores):
                scores[candidate] = score
        ghosts = [game.ghosts[k] for k in sorted(game.ghosts)]
        return Frame(
            state=cast(State, game.state or "menu"),
            revision=self.scene.revision,
            number=number,
            time_s=round(game.round_time_s, 2),
            speed=round(robot.rate, 1),
            score=int(numbers.get("score", 0)),
            collected=int(numbers.get("collected", 0)),
            spawned=int(numbers.get("spawned", 0)),
            round=int(numbers.get("round", 1)),
            goal=game.goal if game.goal < candidates else -1,
            stopped=stopped,
            over=bool(game.result),
            true=robot.true,
            believed=robot.believed,
            velocity=robot.velocity,
            ring=robot.ring,
            ghosts=np.array(ghosts, dtype=np.float64).reshape(-1, 2),
            alive=np.array([one in game.pellets for one in self._pellet_ids], dtype=np.bool_),
            scores=scores,
            plan=thinned(robot.plan),
            scan=robot.scan if lidar else np.zeros(0),
        )
