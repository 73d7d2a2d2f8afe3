from pacman_env.game.events import FEEDBACK, LIGHTS, SOUNDS
from pacman_env.game.ghosts import GHOST_NAMES


def words(event: str) -> tuple[str | None, str | None, str | None]:
    """The words of its light, its sound and its motion."""
    answer = FEEDBACK[event]
    return answer.light and answer.light.word, answer.sound and answer.sound.word, answer.motion


def test_every_event_has_feedback() -> None:
    plain = ["start", "start theatrical", "pellet", "power pellet", "death", "game over", "win", "reset"]
    assert set(FEEDBACK) == {*plain, *(f"{g} {fate}" for g in GHOST_NAMES for fate in ("caught", "killed"))}


def test_every_event_names_a_known_light_and_sound() -> None:
    for answer in FEEDBACK.values():
        assert answer.light is not None
        assert LIGHTS[answer.light.word] == answer.light
        assert answer.sound is None or SOUNDS[answer.sound.word] == answer.sound


def test_feedback_is_that_of_algorithm_6() -> None:
    assert words("start theatrical") == ("start", "pacman_theme", "spin")
    for pellet in ("pellet", "power pellet"):
        assert words(pellet) == (pellet, pellet, None)
    assert words("death") == words("game over") == ("game over", "death", "shake")
    assert words("win") == ("win", "win", None)
    assert words("reset") == ("off", None, "stop")
    for ghost in GHOST_NAMES:  # only one that kills shakes the robot
        assert words(f"{ghost} killed") == (f"{ghost} killed", "death", "shake")
        assert words(f"{ghost} caught") == (f"{ghost} caught", "ghost", None)
