"""View of a robot's game for the page: whether a game runs, its scene and its frames, from the node's state."""

import contextlib
import math
from typing import Any, cast

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace

from pacman_env.config import Config, make_config, parse_settings
from pacman_env.game.round import State
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, PAGE, SIMULATOR
from pacman_env.ros.message_conversion import Position
from pacman_env.ros.operator_page.page_node import FRESH_S, PageNode, PublishedGame
from pacman_env.ros.selector import reasons
from pacman_env.ros.supervisor.checks.check import RESTART_GAME
from pacman_env.web.caught_ghosts import CaughtGhosts
from pacman_env.web.frame import Frame, thinned
from pacman_env.web.game_interface import Scene
from pacman_env.web.vocabulary import scene_facts


class RosView:
    """Scene and newest frame of the game at ``where``; ends of processes are added to the node's news."""

    def __init__(self, node: PageNode, where: str) -> None:
        self.scene = Scene(1, {"map": None, "preparing": True})
        self.frame: Frame | None = None  # None: neither a game nor a robot
        self.game_is_there = False
        self._node, self._where, self._news = node, where, node.news
        self._scene_key: object = None
        self._pellet_ids: list[int] = []
        self._encoded, self._number = "", 0
        self._config, *_ = _rules(None)
        self._caught = CaughtGhosts(self._config.power.return_s, self._config.power.ghost_points)
        self._lamps: dict[str, str] = {}  # see ``_processes``
        self._ended: set[str] = set()  # processes that ran and do not run now

    def update_scene(self) -> None:
        """Check which processes run, tell people of changes, and replace the scene if it has changed."""
        node, game, picture = self._node, self._node.game, self._node.robot.map
        exists = node.count_publishers(topics.GAME_STATE.name) > 0
        if self.game_is_there and not exists:
            game.state, game.condition = None, {}
        self.game_is_there = exists
        if not node.count_publishers(topics.PROCESSES.name):
            game.started = {}  # ``ros up`` has ended
        self._tell_ends()
        self._config, preset, settings = _rules(game.configuration.get("rules"))
        self._caught.return_s = self._config.power.return_s
        self._caught.first_points = self._config.power.ghost_points
        pellets = _pellets(game)
        facts = {
            **_facts(node, pellets, self._config),
            "preset": preset,
            "settings": settings,
            "notice": "" if exists else f"no game is found in {self._where}: is 'pacman-env ros up' running there?",
            "processes": self._lamps,
        }
        key = facts, list(pellets), picture
        if key != self._scene_key:
            self._scene_key, self._pellet_ids = key, list(pellets)
            self.scene = Scene(self.scene.revision + 1, facts, b"" if picture is None else picture.png)

    def _tell_ends(self) -> None:
        """Tell people of a process that has ended or runs again, unless its game tells them why."""
        lamps, game = _processes(self._node, self.game_is_there), self._node.game
        told = {*game.started.get("processes", {}).values(), *game.troubles.values()}
        for name, why in lamps.items():
            if why and self._lamps.get(name) == "":
                self._ended.add(name)
                if why not in told:
                    self._news.add(words=f"{name}: {why}")
                told.add(why)
            elif not why and name in self._ended:
                self._ended.remove(name)
                self._news.add(words=f"{name} runs again")
        self._lamps = lamps

    def update_frame(self, stopped: bool, lidar: bool) -> None:
        if not (self.game_is_there or self._node.robot.alive):
            if self.frame is not None:  # once: the next robot's latched messages may precede its odometry
                self._node.robot.clear()
                self._node.game.clear()
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
        goal: Any = game.condition.get("pursued")
        pursues = isinstance(goal, int) and 0 <= goal < candidates and game.state != "menu"
        begins_s = game.began_s + self._config.show.start_s
        scores = [game.scores.get(k, math.nan) for k in range(candidates + 1)] if candidates else []
        return Frame(
            state=cast(State, game.state or "menu"),
            revision=self.scene.revision,
            number=0,
            time_s=round(game.round_time_s, 2),
            score=game.score or 0,
            collected=game.pellets_collected or 0,
            spawned=game.pellets_spawned or 0,
            round=game.round or 1,
            goal=goal if pursues else -1,
            stopped=stopped,
            over=bool(game.result),
            true=robot.true,
            believed=robot.believed,
            velocity=robot.velocity,
            ring=robot.ring,
            begins_in_s=UNSET if game.state != "starting" else round(max(0.0, begins_s - robot.clock_s), 2),
            **self._ghosts(),
            alive=np.array([one in game.pellets for one in self._pellet_ids], dtype=np.bool_),
            scores=np.array(scores, dtype=np.float64),
            plan=thinned(robot.plan),
            scan=robot.scan if lidar else np.zeros(0),
        )

    def _ghosts(self) -> dict[str, Any]:
        """Return the frame's fields of the ghosts."""
        game, numbers = self._node.game, sorted(self._node.game.ghosts)
        places = np.array([game.ghosts[k].pose[:2] for k in numbers], dtype=np.float64).reshape(-1, 2)
        if not game.power_pellets:
            return {"ghosts": places}
        times = game.harmless_until_s
        until_s = np.array([times[k] if k < len(times) else (0.0, 0.0) for k in numbers]).reshape(-1, 2)
        left = len(game.power_pellets & game.pellets.keys())
        fields = self._caught.update(places, until_s, self._node.robot.clock_s, left)
        return fields | {"ghosts_caught": game.ghosts_caught or 0}


def _pellets(game: PublishedGame) -> dict[int, Position]:
    """Return the positions (m) of the pellets by id: first the candidates in their order, then unreachable pellets."""
    positions = dict(zip(game.pellet_ids, game.places, strict=False))
    return positions | {number: game.pellets[number] for number in sorted(game.pellets) if number not in positions}


def _facts(node: PageNode, pellets: dict[int, Position], config: Config) -> dict[str, Any]:
    game, picture, condition = node.game, node.robot.map, node.game.condition
    behaviours = dict(enumerate(config.clyde.ghosts))
    named = {k: behaviours.get(k, "")[:100] for k in sorted(game.ghosts)}
    home = condition.get("home")
    power = [k for k, pellet in enumerate(pellets) if pellet in game.power_pellets]
    return {
        **scene_facts(config.value, [list(place) for place in game.places], game.pellet_ids, power, named),
        "map": None if picture is None else {"name": str(condition.get("map") or "map"), **picture.facts},
        "home": home if isinstance(home, list) and len(home) == 3 else [0.0, 0.0, 0.0],
        "pellets": [list(place) for place in pellets.values()],
        "policy": str(condition.get("policy") or "")[:200],
        "second": None,
        "seed": None,
        "level": None,
        "clyde_speed_mps": config.clyde.speed_mps if game.clyde_speed_mps is None else game.clyde_speed_mps,
        "link": "",
        "preparing": picture is None,
        "alerts": _alerts(node),
        "pose_lost": any(kind in game.troubles for kind in reasons.POSE_REASONS),
    }


def _rules(rules: Any) -> tuple[Config, str | None, dict[str, Any]]:
    """Return configuration, preset and settings of a node's parameters; the defaults if it publishes no valid ones."""
    with contextlib.suppress(ValueError, TypeError, AttributeError):
        preset, execution, settings = rules
        values = parse_settings(settings)
        config = make_config(preset, execution, **values)
        return config, preset if execution == "robust" else f"{preset}, {execution}", values
    return make_config("robot", "robust"), None, {}


def _processes(node: PageNode, game_is_there: bool) -> dict[str, str]:
    """Return for each process why it does not run ("": it runs), as ``ros up`` and the messages tell.

    The texts contain no times in seconds, because each change of a text makes a new scene.
    """
    game, started = node.game, dict(node.game.started.get("processes", {}))
    started.pop(PAGE, None)
    robot = started.pop(SIMULATOR, "") or ("" if node.robot.alive else f"no odometry for {FRESH_S:.0f} s")
    silent = f"no diagnostics for {reasons.SILENT_S:.0f} s" if game.is_silent else "" if game_is_there else "not found"
    processes = {"robot": robot, "game": started.pop(GAME, "") or silent}
    if "policy_ready" in game.condition:
        failing = game.troubles.get(reasons.POLICY_FAILS, "is starting")
        processes["policy"] = silent or ("" if game.condition["policy_ready"] else failing)
    return processes | started


def _alerts(node: PageNode) -> list[dict[str, Any]]:
    """Return the alerts that need a person, also without times in seconds."""
    troubles = node.game.troubles
    remedies = dict(reasons.REMEDIES) | ({reasons.NO_ODOMETRY: RESTART_GAME} if node.sim else {})
    words = troubles | {kind: kind for kind in (reasons.POSE_LOST, reasons.NO_ODOMETRY)}
    return [
        {"kind": kind, "words": words[kind], "remedy": remedy, "asks": kind == reasons.POSE_JUMPED}
        for kind, remedy in remedies.items()
        if kind in troubles
    ]
