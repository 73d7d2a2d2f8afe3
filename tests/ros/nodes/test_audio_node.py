"""Sounds: which melody reaches the loudspeaker, and when."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.game.sounds import MELODIES, SoundQueue, duration_s, frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.messages import seconds_of
from tests.ros.clock import SimulatedClock
from tests.ros.loudspeaker import Loudspeaker

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.audio_node"


@pytest.fixture
def speaker(probe: Probe) -> Iterator[Loudspeaker]:
    with Loudspeaker(probe.node) as speaker:
        yield speaker


def play(probe: Probe, speaker: Loudspeaker, word: str) -> None:
    """Ask until it is played: a pellet is left out while another melody has not ended."""
    before = len(speaker.played)

    def begun() -> bool:
        if len(speaker.played) == before:
            probe.publish(topics.GAME_SOUND, word)
            probe.taken_in(topics.GAME_SOUND, "audio_node")
        return len(speaker.played) > before

    probe.wait_for(begun, what=word)
    assert speaker.played[before:] == [word]


def up(probe: Probe, system: System, speaker: Loudspeaker) -> Process:
    """The node, once it has found the loudspeaker and played."""
    process = system.start(NODE)
    play(probe, speaker, "start")
    speaker.finish()
    speaker.played.clear()
    return process


def test_a_melody_reaches_the_base_note_by_note(probe: Probe, system: System, speaker: Loudspeaker) -> None:
    up(probe, system, speaker)
    probe.publish(topics.GAME_SOUND, " Pacman_Theme")
    probe.wait_for(lambda: speaker.played == ["pacman_theme"], what="the theme")
    goal = speaker.goals[-1]
    assert goal.iterations == 1
    assert not goal.note_sequence.append
    notes = [(note.frequency, seconds_of(note.max_runtime)) for note in goal.note_sequence.notes]
    assert notes == [(frequency_hz(note), pytest.approx(seconds)) for note, seconds in MELODIES["pacman_theme"]]


def test_the_win_melody_plays_after_the_pellet_fault_2(probe: Probe, system: System, speaker: Loudspeaker) -> None:
    up(probe, system, speaker)
    play(probe, speaker, "pellet")
    probe.publish(topics.GAME_SOUND, "win")
    probe.taken_in(topics.GAME_SOUND, "audio_node")
    probe.spin(0.3)
    assert speaker.played == ["pellet"]
    speaker.finish()
    probe.wait_for(lambda: speaker.played == ["pellet", "win"], what="the win melody")


def test_a_melody_that_never_ends_blocks_only_for_a_while_fault_12(
    probe: Probe, system: System, speaker: Loudspeaker
) -> None:
    system.start(NODE, use_sim_time=True)
    clock = SimulatedClock(probe, "audio_node")
    play(probe, speaker, "pellet")
    probe.publish(topics.GAME_SOUND, "death")
    probe.taken_in(topics.GAME_SOUND, "audio_node")
    clock.advance(duration_s("pellet") + SoundQueue().patience_s - 0.2)
    assert speaker.played == ["pellet"]
    clock.advance(0.5)
    probe.wait_for(lambda: speaker.played == ["pellet", "death"], what="the next melody")
    speaker.finish(-2)  # the end of the first comes after all: it is not that of the second
    probe.spin(0.3)
    probe.publish(topics.GAME_SOUND, "pellet")
    probe.taken_in(topics.GAME_SOUND, "audio_node")
    probe.spin(0.3)
    assert speaker.played == ["pellet", "death"]


def test_a_refused_melody_and_unknown_words_do_not_block_the_next(
    probe: Probe, system: System, speaker: Loudspeaker
) -> None:
    process = up(probe, system, speaker)
    speaker.refuse = True
    probe.publish(topics.GAME_SOUND, "ghost")
    probe.wait_for(lambda: "refused" in process.output, what="the refusal to be noticed")
    speaker.refuse = False
    for word in ("beep", "", "x" * 10_000, "beep"):
        probe.publish(topics.GAME_SOUND, word)
    probe.publish(topics.GAME_SOUND, "win")
    probe.wait_for(lambda: speaker.played == ["win"], what="the next melody")
    assert process.output.count("game_sound: ") == 1


def test_without_a_loudspeaker_the_game_goes_on_silently(probe: Probe, system: System) -> None:
    process = system.start(NODE)
    for word in ("pellet", "win", "pellet"):
        probe.publish(topics.GAME_SOUND, word)
    probe.wait_for(lambda: "nobody there to play" in process.output, what="the complaint")
    assert process.stop() == 0
    assert process.output.count("nobody there to play") == 1
