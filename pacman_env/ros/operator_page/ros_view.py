"""View of a robot's game for the page: whether a game runs, its scene and its frames, from the node's state."""

import json
import math
from functools import cache, lru_cache, partial
from itertools import product
from typing import Any, cast

import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from pacman_env.config import EXECUTIONS, PRESETS, Config, differences, make_config
from pacman_env.game.round import State
from pacman_env.ros import topics
from pacman_env.ros.game_monitor import NO_RESPONSE
from pacman_env.ros.message_conversion import Position
from pacman_env.ros.operator_page.page_node import PageNode, PublishedGame
from pacman_env.ros.selector.reasons import NO_ODOMETRY, POSE_JUMPED, POSE_LOST, REMEDIES
from pacman_env.ros.supervisor.checks.check import RESTART_GAME, START_AGAIN
from pacman_env.web.caught_ghosts import CaughtGhosts
from pacman_env.web.frame import Frame, thinned
from pacman_env.web.game_interface import News, Scene
from pacman_env.web.vocabulary import scene_facts


class RosView:
    """Scene and newest frame of the game at ``where``; its start and end are added to ``news``."""

    def __init__(self, node: PageNode, where: str, news: News) -> None:
        self.scene = Scene(1, {"map": None, "preparing": True})
        self.frame: Frame | None = None  # None: neither a game nor a robot
        self.game_is_there: bool | None = None  # None: unknown so far
        self._robot_gone = True  # True if there is neither referee nor robot
        self._node, self._where, self._news = node, where, news
        self._scene_key = ""
        self._pellet_ids: list[int] = []
        self._encoded, self._number = "", 0
        power = _defaults().power
        self._caught = CaughtGhosts(power.return_s, power.ghost_points)
        self._notice = ""  # text that the page shows instead of a game

    def find_game(self) -> bool:
        """Check whether there is a referee, and tell people of a change; return True if it has just disappeared."""
        node = self._node
        exists = node.count_publishers(node.resolve_topic_name(topics.GAME_STATE.name)) > 0
        existed, self.game_is_there = self.game_is_there, exists
        self._notice = "" if exists else f"no game is found in {self._where}: is 'pacman-env ros up' running there?"
        disappears = bool(existed and not exists)
        if exists and not existed:
            self._news.add(words=f"the game in {self._where} is running")
        elif disappears:
            self._news.add(words=f"the game is gone: {self._notice}")
            node.game.state = None
        robot_gone = not exists and not node.robot.alive
        if robot_gone and not self._robot_gone:  # once: the next robot's latched messages may precede its odometry
            node.robot.clear()
            node.game.clear()
        self._robot_gone = robot_gone
        return disappears

    def update_scene(self) -> None:
        pellets = _pellets(self._node.game)
        facts = _facts(self._node, pellets) | {"notice": self._notice}
        self._caught.return_s = _number(self._node.game, "power.return_s")
        self._caught.first_points = int(_number(self._node.game, "power.ghost_points"))
        picture = self._node.robot.map
        key = json.dumps([facts, list(pellets), id(picture)])
        if key != self._scene_key:
            self._scene_key, self._pellet_ids = key, list(pellets)
            self.scene = Scene(self.scene.revision + 1, facts, b"" if picture is None else picture.png)

    def update_frame(self, stopped: bool, lidar: bool) -> None:
        if not (self.game_is_there or self._node.robot.alive):
            self.frame, self._encoded = None, ""
            return
        frame = self._frame_now(stopped, lidar)
        encoded = frame.encode()
        if encoded != self._encoded:
            self._encoded, self._number = encoded, self._number + 1
            self.frame = replace(frame, number=self._number)

    def _frame_now(self, stopped: bool, lidar: bool) -> Frame:
        robot, game = self._node.robot, self._node.game
        candidates = len(game.places)
        scores = [game.scores.get(k, math.nan) for k in range(candidates + 1)] if candidates else []
        return Frame(
            state=cast(State, game.state or "menu"),
            revision=self.scene.revision,
            number=0,
            time_s=round(game.round_time_s, 2),
            speed=round(robot.rate, 1),
            score=game.score or 0,
            collected=game.pellets_collected or 0,
            spawned=game.pellets_spawned or 0,
            round=game.round or 1,
            goal=game.goal if game.goal < candidates else -1,
            stopped=stopped,
            over=bool(game.result),
            true=robot.true,
            believed=robot.believed,
            velocity=robot.velocity,
            ring=robot.ring,
            begins_in_s=self._begins_in_s(),
            **self._ghosts(),
            alive=np.array([one in game.pellets for one in self._pellet_ids], dtype=np.bool_),
            scores=np.array(scores, dtype=np.float64),
            plan=thinned(robot.plan),
            scan=robot.scan if lidar else np.zeros(0),
        )

    def _begins_in_s(self) -> float | UnsetType:
        game = self._node.game
        if game.starting_s is None:
            return UNSET
        elapsed_s = self._node.robot.clock_s - game.starting_s
        return round(max(0.0, _number(game, "show.start_s") - elapsed_s), 2)

    def _ghosts(self) -> dict[str, Any]:
        """Return the frame's fields of the ghosts."""
        game, numbers = self._node.game, sorted(self._node.game.ghosts)
        places = np.array([game.ghosts[k].pose[:2] for k in numbers], dtype=np.float64).reshape(-1, 2)
        if not game.power_pellets:
            return {"ghosts": places}
        known = [k for k in numbers if k < len(game.harmless_until_s)]
        until_s = np.zeros((len(numbers), 2))
        until_s[: len(known)] = game.harmless_until_s[known]
        left = len(game.power_pellets & game.pellets.keys())
        fields = self._caught.update(places, until_s, self._node.robot.clock_s, left)
        return fields | {"ghosts_caught": game.ghosts_caught or 0}


def _pellets(game: PublishedGame) -> dict[int, Position]:
    """Return the positions (m) of the pellets by id: first the candidates in their order, then unreachable pellets."""
    positions = dict(zip(game.pellet_ids, game.places, strict=False))
    return positions | {number: game.pellets[number] for number in sorted(game.pellets) if number not in positions}


def _facts(node: PageNode, pellets: dict[int, Position]) -> dict[str, Any]:
    game, picture, condition = node.game, node.robot.map, node.game.condition
    configuration, clyde = game.configuration.get("configuration", {}), _defaults().clyde
    behaviours = (configuration.get("clyde") or {}).get("ghosts") or clyde.ghosts
    named = {k: str(behaviours[k])[:100] if k < len(behaviours) else "" for k in sorted(game.ghosts)}
    preset, settings = preset_of(json.dumps(configuration, sort_keys=True)) if configuration else (None, {})
    home = condition.get("home")
    power = [k for k, pellet in enumerate(pellets) if pellet in game.power_pellets]
    return {
        **scene_facts(partial(_number, game), [list(place) for place in game.places], game.pellet_ids, power, named),
        "map": None if picture is None else {"name": str(condition.get("map") or "map"), **picture.facts},
        "home": home if isinstance(home, list) and len(home) == 3 else [0.0, 0.0, 0.0],
        "pellets": [list(place) for place in pellets.values()],
        "policy": str(condition.get("policy") or "")[:200],
        "second": None,
        "preset": preset,
        "seed": None,
        "level": None,
        "settings": settings,
        "clyde_speed_mps": clyde.speed_mps if game.clyde_speed_mps is None else game.clyde_speed_mps,
        "link": "",
        "preparing": picture is None,
        "alerts": _alerts(node),
    }


@cache
def _defaults() -> Config:
    return make_config("robot", "robust")


def _number(game: PublishedGame, name: str) -> float:
    """Return a number of the robot's configuration, or its default if it is invalid."""
    group, _, key = name.partition(".")
    value = (game.configuration.get("configuration", {}).get(group) or {}).get(key)
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    return float(_defaults().value(name))


def _alerts(node: PageNode) -> list[dict[str, Any]]:
    """Return the alerts that need a person.

    The texts contain no times in seconds, because each change of a text makes a new scene.
    """
    troubles, silent = node.game.troubles, {} if node.game.state is None else node.game.unresponsive
    remedies = {**REMEDIES, **dict.fromkeys(map(NO_RESPONSE.format, silent), START_AGAIN)}
    if node.sim:
        remedies[NO_ODOMETRY] = RESTART_GAME
    return [
        {
            "kind": kind,
            "words": kind if kind in (POSE_LOST, NO_ODOMETRY) else troubles[kind],
            "remedy": remedy,
            "asks": kind == POSE_JUMPED,
        }
        for kind, remedy in remedies.items()
        if kind in troubles
    ]


@lru_cache(maxsize=4)
def preset_of(text: str) -> tuple[str, dict[str, Any]]:
    """Return the preset nearest to a configuration (JSON), and the differences by dotted names."""
    configuration, fields_by_preset = json.loads(text), {}
    for preset, execution in product(PRESETS, EXECUTIONS):
        fields = make_config(preset, execution).as_dict()
        name = preset if execution == "robust" else f"{preset}, {execution}"
        try:
            fields_by_preset[name] = {field: value for field, (value, _) in differences(configuration, fields).items()}
        except (TypeError, ValueError, AttributeError):  # a configuration of another version
            return "", {}
    return min(fields_by_preset.items(), key=lambda pair: len(pair[1]))
