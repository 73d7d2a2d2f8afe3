"""What stays the same from frame to frame of a robot's game, as facts for the page."""

from __future__ import annotations

import json
import math
from functools import cache, lru_cache
from typing import Any

from pacman_env.config import EXECUTIONS, PRESETS, Config, differences, make_config
from pacman_env.ros.operator_page.game_state import GameState
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.web.roles import ghost_role

_STANDARD = "robot", "robust"


@cache
def _presets() -> dict[tuple[str, str], dict[str, Any]]:
    """All fields by preset and execution."""
    return {(preset, way): make_config(preset, way).as_dict() for preset in PRESETS for way in EXECUTIONS}


@lru_cache(maxsize=4)
def played_by(text: str) -> tuple[str, dict[str, Any]]:
    """The preset that a configuration, as JSON, is nearest to, and what it has otherwise, by dotted names."""
    configuration, found = json.loads(text), {}
    for (preset, way), fields in _presets().items():
        try:
            changed = {name: there for name, (there, _) in differences(configuration, fields).items()}
        except (TypeError, ValueError, AttributeError):  # of another version
            return "", {}
        found[preset if way == _STANDARD[1] else f"{preset}, {way}"] = changed
    preset = min(found, key=lambda name: len(found[name]))
    return preset, found[preset]


def _number(configuration: dict[str, Any], group: str, name: str, default: float) -> float:
    value = (configuration.get(group) or {}).get(name, default)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else default


def pellets_of_scene(game: GameState) -> tuple[list[int], list[tuple[float, float]]]:
    """Ids and places: first the candidates, as they are numbered, then those that cannot be driven to."""
    places = game.candidates.get("places", ())
    ids = list(game.candidates.get("pellets", ()))
    known = dict(zip(ids, places, strict=False))
    ids += sorted(number for number in game.pellets if number not in known)
    return ids, [known.get(number) or game.pellets[number] for number in ids]


def facts_of(node: PageNode) -> dict[str, Any]:
    """All but the map's address, which has the revision in it."""
    own: Config = make_config(*_STANDARD)
    game = node.game
    configuration, condition = game.configuration, game.condition
    _, pellets = pellets_of_scene(game)
    candidates = list(game.candidates.get("places", ()))
    first_refuge = len(game.candidates.get("pellets", ()))
    behaviours = (configuration.get("clyde") or {}).get("ghosts") or own.clyde.ghosts
    catch_m = _number(configuration, "execution", "death_radius_m", own.execution.death_radius_m)
    preset, settings = played_by(game.configuration_text) if configuration else (None, {})
    home = condition.get("home")
    picture = node.robot.map
    return {
        "map": None
        if picture is None
        else {
            "name": str(condition.get("map") or "map"),
            "resolution": picture.resolution,
            "width": picture.width,
            "height": picture.height,
            "origin": list(picture.origin),
        },
        "home": home if isinstance(home, list) and len(home) == 3 else [0.0, 0.0, 0.0],
        "pellets": [list(place) for place in pellets],
        "candidates": [list(place) for place in candidates],
        "refuges": [list(place) for place in candidates[first_refuge:]],
        "first_refuge": first_refuge,
        "ghosts": [
            {
                "role": ghost_role(number),
                "behaviour": str(behaviours[number])[:100] if number < len(behaviours) else "",
                "catch_m": catch_m,
            }
            for number in sorted(game.ghosts)
        ],
        "robot": {
            "radius_m": _number(configuration, "robot", "radius_m", own.robot.radius_m),
            "speed_mps": _number(configuration, "robot", "speed_mps", own.robot.speed_mps),
        },
        "wheels_mps": _number(configuration, "robot", "wheel_speed_mps", own.robot.wheel_speed_mps),
        "turn_radps": _number(configuration, "robot", "omega_radps", own.robot.omega_radps),
        "policy": str(condition.get("policy") or "")[:200],
        "second": None,
        "preset": preset,
        "seed": None,
        "level": None,
        "settings": settings,
        "clyde_speed_mps": game.numbers.get("clyde_speed", own.clyde.speed_mps),
        "link": "",
        "preparing": picture is None,
    }
