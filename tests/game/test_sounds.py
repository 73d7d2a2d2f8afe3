import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.game.events import SOUNDS
from pacman_env.game.sounds import SoundQueue, frequency_hz


def test_every_word_has_a_melody() -> None:
    assert set(SOUNDS) == {"start", "pacman_theme", "pellet", "power pellet", "ghost", "death", "win"}


def test_frequencies_follow_equal_temperament() -> None:
    assert frequency_hz(69) == 440
    assert frequency_hz(57) == 220
    assert frequency_hz(60) == 262
    assert all(0 < frequency_hz(note) < 65536 for sound in SOUNDS.values() for note, _ in sound.melody)


def test_theme_lasts_as_long_as_recorded() -> None:
    assert len(SOUNDS["pacman_theme"].melody) == 29
    assert SOUNDS["pacman_theme"].duration_s == pytest.approx(6.4)


def test_pellet_sound_ends_before_the_next_pellet() -> None:
    assert SOUNDS["pellet"].duration_s < 0.25
    assert all(seconds > 0 for sound in SOUNDS.values() for _, seconds in sound.melody)


def test_win_melody_plays_after_the_pellet_fault_2() -> None:
    queue = SoundQueue(SOUNDS)
    assert queue.request("pellet", 0.0) == "pellet"
    assert queue.request("win", 0.005) is None
    assert queue.ended(0.2) == "win"
    assert queue.ended(2.0) is None


def test_melody_without_reported_end_times_out_fault_12() -> None:
    queue = SoundQueue(SOUNDS)
    queue.request("pacman_theme", 0.0)
    queue.request("win", 1.0)
    assert not queue.overdue(8.3)
    assert queue.overdue(8.5)
    assert queue.ended(8.5) == "win"
    assert queue.overdue(60.0)
    assert queue.ended(60.0) is None
    assert not queue.overdue(90.0)
    assert queue.request("pellet", 90.0) == "pellet"


def test_clock_set_back_does_not_block() -> None:
    queue = SoundQueue(SOUNDS)
    queue.request("pacman_theme", 1000.0)
    assert queue.overdue(3.0)


def test_burst_of_one_word_sounds_once() -> None:
    queue = SoundQueue(SOUNDS)
    assert queue.request("pellet", 1.0) == "pellet"
    queue.ended(1.01)  # refused at once
    assert queue.request("pellet", 1.09) is None
    assert queue.request("win", 1.09) == "win"
    queue.ended(1.1)
    assert queue.request("pellet", 1.11) == "pellet"


def test_pellets_and_repeats_are_skipped_while_sounding() -> None:
    queue = SoundQueue(SOUNDS)
    queue.request("ghost", 0.0)
    assert queue.request("pellet", 0.2) is None
    assert queue.request("ghost", 0.3) is None
    assert queue.ended(1.0) is None


def test_most_important_then_newest_waiting_sound_plays() -> None:
    queue = SoundQueue(SOUNDS)
    queue.request("pellet", 0.0)
    for word in ("ghost", "win", "death", "power pellet", "start"):
        queue.request(word, 0.01)
    assert queue.ended(0.2) == "death"
    assert queue.ended(2.0) is None


@given(st.text().filter(lambda word: word not in SOUNDS))
def test_unknown_sound_is_refused(word: str) -> None:
    with pytest.raises(ValueError, match="not one of"):
        SoundQueue(SOUNDS).request(word, 0.0)


@given(st.lists(st.tuples(st.sampled_from([*sorted(SOUNDS), "ended"]), st.floats(0, 3)), max_size=30))
def test_win_or_death_always_sounds(inputs: list[tuple[str, float]]) -> None:
    queue, now, heard = SoundQueue(SOUNDS), 0.0, []
    for word, pause in inputs:
        now += pause
        if word == "ended" or queue.overdue(now):
            heard.append(queue.ended(now))
        if word != "ended":
            heard.append(queue.request(word, now))
    heard += [queue.ended(now + 20.0), queue.ended(now + 40.0)]
    important = {"win", "death"}
    assert bool(important & set(heard)) == bool(important & {word for word, _ in inputs})
    assert queue.request("pellet", now + 60.0) == "pellet"
