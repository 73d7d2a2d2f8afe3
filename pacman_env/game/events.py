"""Table of events with their lights, sounds and motions, and motions as functions of time (Algorithm 6).

``lights.py`` and ``sounds.py`` show lights and play sounds. A motion is a turn on the spot for a few seconds at most.
"""

import math
from dataclasses import dataclass
from typing import Literal

from ..config import ShowConfig
from .lights import BLACK, FRAME_S, GHOST_COLOURS, OFF, PLAIN_LIGHTS, RED, WHITE, YELLOW, Light, all_six, turning, wave
from .sounds import Sound, even

Motion = Literal["spin", "shake", "stop"]

#: Before a shake the robot stops, which takes 0.34 s from 0.306 m/s: wheels that alternate at their largest
#: acceleration do not brake, and the robot would roll on for 0.3 m during the shake.
STAND_S = 0.5
_EDGE_S = 1e-9  # tolerance, because sums of periods hit the times at which the side changes


def killed_by(ghost: str) -> str:
    """Return the word of the event in which a ghost catches the robot."""
    return f"{ghost} killed"


@dataclass(frozen=True)
class Feedback:
    light: Light | None = None
    sound: Sound | None = None
    motion: Motion | None = None


# Shared by several events.
_START_LIGHT = Light("start", turning((YELLOW, *GHOST_COLOURS.values(), BLACK)), "start_s", "pacman")
_GAME_OVER_LIGHT = Light("game over", wave(RED), "death_s", "off")
_DEATH_SOUND = Sound("death", even((76, 75, 74, 73, 72, 70, 68, 65, 60, 48), 0.14, 0.50), 3)
_GHOST_SOUND = Sound("ghost", even((84, 79, 88, 83, 91), 0.08, 0.20), 1)
_THEME = (  # own tune, as long as the original recording: 29 notes in 6.4 s
    *even((69, 76, 73, 81, 76, 73, 69), 0.20, 0.40),
    *even((71, 78, 74, 83, 78, 74, 71), 0.20, 0.40),
    *even((69, 76, 73, 81, 76, 73, 69), 0.20, 0.40),
    *even((68, 71, 74, 76, 80, 83, 80, 81), 0.15, 0.55),
)

#: Feedback by event word (Milestone 3, Algorithm 6). In ``<ghost> killed`` the robot dies, in ``<ghost> caught`` the
#: ghost.
FEEDBACK: dict[str, Feedback] = {
    "start": Feedback(_START_LIGHT, Sound("start", even((60, 64, 67, 72, 67, 72), 0.12, 0.30), 2)),
    "start theatrical": Feedback(_START_LIGHT, Sound("pacman_theme", _THEME, 2), "spin"),
    "pellet": Feedback(
        Light("pellet", (all_six(WHITE), all_six(YELLOW)), 2 * FRAME_S),
        Sound("pellet", ((79, 0.07), (84, 0.07)), 0),
    ),
    "power pellet": Feedback(
        Light("power pellet", (all_six(YELLOW), all_six(WHITE)), 3.0),
        Sound("power pellet", even((64, 70, 76, 70, 76, 82), 0.10, 0.20), 1),
    ),
    "death": Feedback(_GAME_OVER_LIGHT, _DEATH_SOUND, "shake"),
    "game over": Feedback(_GAME_OVER_LIGHT, _DEATH_SOUND, "shake"),
    "win": Feedback(
        Light("win", (*turning((YELLOW, BLACK, WHITE) * 2), all_six(WHITE), all_six(YELLOW)), 6.0, "off"),
        Sound("win", even((67, 72, 76, 79, 76, 79, 84), 0.14, 0.60), 3),
    ),
    "reset": Feedback(OFF, None, "stop"),
    **{
        f"{ghost} caught": Feedback(Light(f"{ghost} caught", (all_six(colour), all_six(YELLOW)), 2.0), _GHOST_SOUND)
        for ghost, colour in GHOST_COLOURS.items()
    },
    **{
        killed_by(ghost): Feedback(Light(killed_by(ghost), wave(colour), "death_s", "off"), _DEATH_SOUND, "shake")
        for ghost, colour in GHOST_COLOURS.items()
    },
}
#: Lights by word.
LIGHTS = {light.word: light for light in (*PLAIN_LIGHTS, *(answer.light for answer in FEEDBACK.values())) if light}
SOUNDS = {answer.sound.word: answer.sound for answer in FEEDBACK.values() if answer.sound}


def angular_velocity(motion: Motion, elapsed_s: float, show: ShowConfig) -> float | None:
    """Return the turn rate in rad/s at ``elapsed_s``, or None if the motion is over or the clock was set back.

    The spin lasts as long as the start show, the shake as long as the death show. The shake starts with a pause of
    ``STAND_S``. Its first and last swings are half swings, so that it goes equally far to both sides.
    """
    if motion == "spin":
        return show.spin_radps if 0 <= elapsed_s < show.start_s else None
    if motion == "stop" or not 0 <= elapsed_s < show.death_s:
        return None
    if elapsed_s + _EDGE_S < STAND_S:
        return 0.0
    swings = math.floor((elapsed_s - STAND_S + _EDGE_S) / show.swing_s + 0.5)
    return show.spin_radps if swings % 2 == 0 else -show.spin_radps
