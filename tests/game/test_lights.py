from __future__ import annotations

import math

import pytest
from hypothesis import given
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


def test_every_word_of_the_contract_is_known() -> None:
    ghosts = [f"{ghost} {fate}" for ghost in GHOST_NAMES for fate in ("caught", "killed")]
    plain = ["start", "pellet", "power pellet", "pacman", "game over", "win", "off"]
    assert {*plain, *ghosts, *COLOURS} == set(LIGHTS)
    assert len(COLOURS) == 6
    assert set(GHOST_COLOURS) == set(GHOST_NAMES)


@pytest.mark.parametrize("word", sorted(set(LIGHTS) - {"off"}))
def test_every_ring_has_six_colours_of_eight_bits(word: str) -> None:
    assert LIGHTS[word].rings
    for ring in LIGHTS[word].rings:
        assert len(ring) == 6
        assert all(len(led) == 3 and all(0 <= value <= 255 for value in led) for led in ring)


def test_win_and_killed_lights_do_not_loop_for_ever_fault_3() -> None:
    for word in set(ENDING) - {"start"}:
        assert shown(word, 30.0)[-1] is None, word


@pytest.mark.parametrize("word", ENDING)
def test_an_animation_moves_and_is_over_after_its_time(word: str) -> None:
    duration = LIGHTS[word].duration_s(ShowConfig())
    rings = shown(word, duration)
    assert None not in rings
    assert len(set(rings)) > 1
    ring = LightRing(LIGHTS, ShowConfig())
    ring.command(word, 0.0)
    after = ring.ring(duration)
    assert after is None or after in LIGHTS["pacman"].rings


@pytest.mark.parametrize("colour", sorted(COLOURS))
def test_a_colour_stays_on_all_six(colour: str) -> None:
    assert set(shown(colour, 60.0)) == {(COLOURS[colour],) * 6}


def test_off_leaves_the_ring_to_the_robot_at_once() -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    assert ring.ring(0.0) is None
    assert shown("pacman", 5.0, ring)[-1] is not None
    assert set(shown("off", 5.0, ring)) == {None}


@pytest.mark.parametrize("between", LASTING)
@pytest.mark.parametrize("word", ["pellet", "power pellet", "clyde caught"])
def test_after_a_short_show_the_ring_is_as_it_was_before(word: str, between: str) -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    before = set(shown(between, 5.0, ring))
    ring.command(word, 200.0)
    assert ring.ring(200.0) in LIGHTS[word].rings
    ring.command("pellet", 200.2)  # one show breaks into another
    assert {ring.ring(210.0 + 0.1 * k) for k in range(50)} == before


def test_after_the_start_show_pacman_stays_until_the_end_of_the_round() -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    assert shown("start", 20.0, ring)[-1] in LIGHTS["pacman"].rings
    ring.command("clyde killed", 200.0)
    assert ring.ring(201.0) is not None
    assert ring.ring(206.0) is None


def test_a_clock_set_back_ends_the_show_and_keeps_what_lasts() -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    ring.command("yellow", 1000.0)
    ring.command("win", 1000.0)
    assert ring.ring(3.0) is None
    ring.command("yellow", 1000.0)
    assert ring.ring(3.0) == (COLOURS["yellow"],) * 6


@given(st.text())
def test_an_unknown_word_is_refused_and_changes_nothing(word: str) -> None:
    ring = LightRing(LIGHTS, ShowConfig())
    ring.command("red", 0.0)
    if word not in LIGHTS:
        with pytest.raises(ValueError, match="not one of"):
            ring.command(word, 1.0)
        assert ring.ring(1.0) == (COLOURS["red"],) * 6


@given(st.lists(st.tuples(st.sampled_from(sorted(LIGHTS)), st.floats(0, 10)), max_size=20))
def test_some_time_after_any_words_only_what_lasts_is_shown(commands: list[tuple[str, float]]) -> None:
    ring, now = LightRing(LIGHTS, ShowConfig()), 0.0
    for word, pause in commands:
        ring.command(word, now)
        now += pause
        ring.ring(now)
    lasting = [None] + [r for word in LASTING if word != "off" for r in LIGHTS[word].rings]
    assert ring.ring(now + 60.0) in lasting
