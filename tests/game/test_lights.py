import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import ShowConfig
from pacman_env.game.events import LIGHTS
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.lights import COLOURS, GHOST_COLOURS, LightRing, Ring

ENDING = sorted(word for word, light in LIGHTS.items() if light.duration_s(ShowConfig()) < math.inf)
LASTING = sorted(set(LIGHTS) - set(ENDING))


def shown(word: str, seconds: float, ring: LightRing | None = None) -> list[Ring | None]:
    """Every ring seen from the command on, ten times a second."""
    ring = ring or LightRing(LIGHTS, ShowConfig())
    ring.command(word, 100.0)
    return [ring.ring(100.0 + 0.1 * k) for k in range(int(seconds * 10))]


def test_every_word_has_a_light() -> None:
    ghosts = [f"{ghost} {fate}" for ghost in GHOST_NAMES for fate in ("caught", "killed")]
    plain = ["start", "pellet", "power pellet", "pacman", "game over", "win", "off"]
    assert {*plain, *ghosts, *COLOURS} == set(LIGHTS)
    assert len(COLOURS) == 6
    assert set(GHOST_COLOURS) == set(GHOST_NAMES)


def test_every_ring_has_six_colours_of_eight_bits() -> None:
    for word in set(LIGHTS) - {"off"}:
        assert LIGHTS[word].rings
        for ring in LIGHTS[word].rings:
            assert np.array(ring, np.uint8).shape == (6, 3), word


@pytest.mark.parametrize("word", ENDING)
def test_animation_ends_after_its_time_fault_3(word: str) -> None:
    if word != "start":
        assert shown(word, 30.0)[-1] is None  # fault 3 of the original: it looped for ever
    duration = LIGHTS[word].duration_s(ShowConfig())
    rings = shown(word, duration)
    assert None not in rings
    assert len(set(rings)) > 1
    ring = LightRing(LIGHTS, ShowConfig())
    ring.command(word, 0.0)
    after = ring.ring(duration)
    assert after is None or after in LIGHTS["pacman"].rings


def test_colour_stays_until_off() -> None:
    for colour, led in COLOURS.items():
        assert set(shown(colour, 60.0)) == {(led,) * 6}
    ring = LightRing(LIGHTS, ShowConfig())
    assert ring.ring(0.0) is None
    assert shown("pacman", 5.0, ring)[-1] is not None
    assert set(shown("off", 5.0, ring)) == {None}


@pytest.mark.parametrize("between", LASTING)
@pytest.mark.parametrize("word", ["pellet", "power pellet", "clyde caught"])
def test_ring_returns_to_what_lasted_after_show(word: str, between: str) -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    before = set(shown(between, 5.0, ring))
    ring.command(word, 200.0)
    assert ring.ring(200.0) in LIGHTS[word].rings
    ring.command("pellet", 200.2)  # one show breaks into another
    assert {ring.ring(210.0 + 0.1 * k) for k in range(50)} == before


def test_pacman_light_lasts_from_start_to_end() -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    assert shown("start", 20.0, ring)[-1] in LIGHTS["pacman"].rings
    ring.command("clyde killed", 200.0)
    assert ring.ring(201.0) is not None
    assert ring.ring(206.0) is None


def test_clock_set_back_ends_the_show_only() -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    ring.command("yellow", 1000.0)
    ring.command("win", 1000.0)
    assert ring.ring(3.0) is None
    ring.command("yellow", 1000.0)
    assert ring.ring(3.0) == (COLOURS["yellow"],) * 6


@settings(max_examples=20)
@given(st.text())
def test_unknown_word_is_refused_and_changes_nothing(word: str) -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    ring.command("red", 0.0)
    if word not in LIGHTS:
        with pytest.raises(ValueError, match="not one of"):
            ring.command(word, 1.0)
        assert ring.ring(1.0) == (COLOURS["red"],) * 6


@given(st.lists(st.tuples(st.sampled_from(sorted(LIGHTS)), st.floats(0, 10)), max_size=20))
def test_only_lasting_lights_remain_after_any_words(commands: list[tuple[str, float]]) -> None:
    ring, now = LightRing(LIGHTS, ShowConfig()), 0.0
    for word, pause in commands:
        ring.command(word, now)
        now += pause
        ring.ring(now)
    lasting = [None] + [r for word in LASTING if word != "off" for r in LIGHTS[word].rings]
    assert ring.ring(now + 60.0) in lasting
