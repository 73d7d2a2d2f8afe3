"""Describe a game to the page in the words that simulated games and a robot's game share.

The first message has names, colours, lights and sounds; a scene has places, ghosts and robot.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

from pacman_env.game.ends import CAUGHT, COMPLETE, ENDS, RUNNING
from pacman_env.game.events import FEEDBACK, LIGHTS, SOUNDS
from pacman_env.game.ghosts import GHOSTS
from pacman_env.game.goals import goal_name
from pacman_env.game.lights import light_colour
from pacman_env.game.power import BLINKING, FRIGHTENED
from pacman_env.game.sounds import frequency_hz
from pacman_env.web.roles import ROBOT, ghost_role

STATES = {
    "menu": "In the menu",
    "returning_home": "Driving home",
    "starting": "Starting",
    "running": "Running",
    "dying": ENDS[CAUGHT].name.capitalize(),
    "complete": ENDS[COMPLETE].name.capitalize(),
}
#: In the simulator the robot is placed at home.
SIMULATED_STATES = STATES | {"returning_home": "Preparing the next round"}
RESULTS = {end.word: end.meaning.capitalize() for end in ENDS[RUNNING + 1 :]}

#: By term of a policy: plain name, unit, and the amount of the unit that the term's value 1 means.
TERMS = {
    "score": ("score", "", 1),
    "probability": ("probability", "%", 100),
    "value": ("expected reward", "", 1),
    "path_robot": ("robot's path", "m", 5),
    "path_clyde": ("ghost's path", "m", 5),
    "time_margin": ("ghost later by", "s", 20),
    "caught_soon": ("catch within 5 s", "%", 100),
    "caught": ("catch within 10 s", "%", 100),
    "approached": ("ghost within 0.8 m", "%", 100),
    "closest_mean": ("closest ghost", "m", 3),
    "distance": ("distance", "m", 1),
    "clyde_risk": ("ghost near it", "m", 1),
    "direction_penalty": ("towards a ghost", "m", 1),
    "total": ("total cost", "m", 1),
    "safe": ("away from ghosts", "", 1),
    "skipped": ("ghost on it", "", 1),
    "threatening": ("ghost threatens", "", 1),
}


def vocabulary(source: Literal["simulator", "ros"] = "simulator") -> dict[str, Any]:
    ghosts = {
        ghost_role(number): {"name": ghost.name.capitalize(), "colour": ghost.colour}
        for number, ghost in enumerate(GHOSTS)
    }
    return {
        "roles": {ROBOT: {"name": "Robot", "colour": None}, **ghosts},
        "states": STATES if source == "ros" else SIMULATED_STATES,
        "results": RESULTS,
        "terms": TERMS,
        "events": {
            word: {
                "light": answer.light and answer.light.word,
                "sound": answer.sound and answer.sound.word,
                "motion": answer.motion,
            }
            for word, answer in sorted(FEEDBACK.items())
        },
        "lights": {word: light_colour(LIGHTS[word]) for word in sorted(LIGHTS)},
        "sounds": {word: [(frequency_hz(note), s) for note, s in SOUNDS[word].melody] for word in sorted(SOUNDS)},
    }


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
