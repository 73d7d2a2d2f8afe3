"""Facts of a scene that a simulated game and a robot's game describe in the same way."""

from collections.abc import Callable, Sequence
from typing import Any

from pacman_env.game.goals import goal_name
from pacman_env.game.power import BLINKING, FRIGHTENED
from pacman_env.web.roles import ghost_role


def scene_facts(
    number: Callable[[str], float],  # value of a field of the configuration
    places: list[list[float]],  # places of the candidates, m: pellets, then refuges
    pellet_ids: Sequence[int],  # ids of the pellets among the candidates
    power_pellets: list[int],  # numbers of the pellets that are power pellets
    behaviours: dict[int, str],  # behaviours of the ghosts by number
) -> dict[str, Any]:
    """Return facts of places, ghosts and robot (docs/dev/web_protocol.md, "scene")."""
    facts = {
        "candidates": places,
        "names": [goal_name(pellet_ids, goal) for goal in range(len(places))],
        "refuges": places[len(pellet_ids) :],
        "first_refuge": len(pellet_ids),
        "ghosts": [
            {"role": ghost_role(k), "behaviour": name, "catch_m": number("execution.death_radius_m")}
            for k, name in behaviours.items()
        ],
        "robot": {"radius_m": number("robot.radius_m"), "speed_mps": number("robot.speed_mps")},
        "wheels_mps": number("robot.wheel_speed_mps"),
        "turn_radps": number("robot.omega_radps"),
    }
    if power_pellets:
        colours = {"frightened": FRIGHTENED, "blinking": BLINKING}
        facts["power"] = {"pellets": power_pellets, "warning_s": number("power.warning_s"), **colours}
    return facts
