"""Names, colours, lights and sounds for the page, sent in the first message."""

from typing import Any

from pacman_env.game.events import FEEDBACK, LIGHTS, SOUNDS
from pacman_env.game.ghosts import GHOSTS
from pacman_env.game.lights import light_colour
from pacman_env.game.sounds import frequency_hz
from pacman_env.web.control import ROBOT, ghost_role

STATES = {
    "menu": "In the menu",
    "returning_home": "Driving home",
    "starting": "Starting",
    "running": "Running",
    "dying": "Caught",
    "complete": "Complete",
}
RESULTS = {
    "complete": "All pellets collected",
    "cleared": "No pellet left",
    "caught": "Caught",
    "timeout": "Time limit reached",
}
CANDIDATE_KINDS = {"pellet": "Pellet", "refuge": "Refuge", "hold": "Hold"}


def vocabulary() -> dict[str, Any]:
    ghosts = {
        ghost_role(number): {"name": ghost.name.capitalize(), "colour": ghost.colour}
        for number, ghost in enumerate(GHOSTS)
    }
    return {
        "roles": {ROBOT: {"name": "Robot", "colour": None}, **ghosts},
        "states": STATES,
        "results": RESULTS,
        "kinds": CANDIDATE_KINDS,
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
