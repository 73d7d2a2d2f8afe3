"""The scene of a round in the simulator: all that a page has to know to draw its frames."""

from __future__ import annotations

from dataclasses import replace

import cv2

from pacman_env.web.game import Scene
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.roles import ghost_role
from pacman_env.web.rules import Rules

_COMPILING = "Preparing the first round. On a new computer the rules are compiled once, which takes a minute or two."
PREPARING = Scene(1, {"map": None, "preparing": True, "notice": _COMPILING})


def scene_of(played: PlayedRound, rules: Rules, revision: int) -> Scene:
    """As docs/web_protocol.md has it."""
    occupancy, config = played.assets.occupancy, played.config
    xy = played.assets.goal_xy.round(4).tolist()
    pellets = played.assets.pellets
    facts = {
        "map": {
            "name": rules.map,
            "url": f"/map/{revision}.png",
            "resolution": occupancy.resolution,
            "width": occupancy.grey.shape[1],
            "height": occupancy.grey.shape[0],
            "origin": list(occupancy.origin),
            "hash": occupancy.hash,
        },
        "home": played.assets.grid.home.tolist(),
        "pellets": xy[:pellets],
        "refuges": xy[pellets:],
        "candidates": xy,
        "first_refuge": pellets,
        "ghosts": [
            {
                "role": ghost_role(k),
                "behaviour": behaviour,
                "catch_m": config.execution.death_radius_m,
            }
            for k, behaviour in enumerate(rules.ghosts)
        ],
        "robot": {"radius_m": config.robot.radius_m, "speed_mps": config.robot.speed_mps},
        "wheels_mps": config.robot.wheel_speed_mps,
        "turn_radps": config.robot.omega_radps,
        "policy": rules.policy,
        "second": rules.second,
        "preset": rules.preset,
        "seed": played.seed,
        "level": played.level,
        "settings": dict(rules.settings),
        "clyde_speed_mps": config.clyde.speed_mps,
        "link": link_to(played, rules),
        "preparing": False,
    }
    return Scene(revision, facts, cv2.imencode(".png", occupancy.grey)[1].tobytes())


def link_to(played: PlayedRound, rules: Rules) -> str:
    """The link to a round; empty where names and numbers alone do not bring it back."""
    if played.placed or played.by_person or played.ghost_roles:
        return ""
    named = rules if played.level is None else replace(rules, level=played.level)
    return named.link(played.seed, played.config.clyde.speed_mps)
