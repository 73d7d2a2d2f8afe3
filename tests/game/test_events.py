from __future__ import annotations

from pacman_env.game.events import FEEDBACK, Feedback
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.lights import LIGHTS
from pacman_env.game.sounds import MELODIES


def test_every_word_of_the_contract_is_answered() -> None:
    plain = ["start", "start theatrical", "pellet", "power pellet", "death", "game over", "win", "reset"]
    assert set(FEEDBACK) == {*plain, *(f"{g} {fate}" for g in GHOST_NAMES for fate in ("caught", "killed"))}


def test_every_light_and_sound_is_one_that_exists() -> None:
    for answer in FEEDBACK.values():
        assert answer.light in LIGHTS
        assert answer.sound is None or answer.sound in MELODIES


def test_the_answers_are_those_of_algorithm_6() -> None:
    assert FEEDBACK["start theatrical"] == Feedback("start", "pacman_theme", "spin")
    assert FEEDBACK["pellet"] == Feedback("pellet", "pellet")
    assert FEEDBACK["power pellet"] == Feedback("power pellet", "power pellet")
    assert FEEDBACK["death"] == FEEDBACK["game over"] == Feedback("game over", "death", "shake")
    assert FEEDBACK["win"] == Feedback("win", "win")
    assert FEEDBACK["reset"] == Feedback("off", None, "stop")


def test_a_ghost_that_kills_shakes_the_robot_and_one_that_is_caught_does_not() -> None:
    for ghost in GHOST_NAMES:
        assert FEEDBACK[f"{ghost} killed"] == Feedback(f"{ghost} killed", "death", "shake")
        assert FEEDBACK[f"{ghost} caught"] == Feedback(f"{ghost} caught", "ghost")
