"""Sounds: which melody reaches the loudspeaker, and when."""

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.action import GoalResponse

from pacman_env.game.events import SOUNDS
from pacman_env.game.sounds import PATIENCE_S, frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import seconds_of
from pacman_env.ros.node import BaseNode
from tests.ros.session import Session

LOUDSPEAKER = "loudspeaker"
WORDS = {tuple(frequency_hz(note) for note, _ in sound.melody): word for word, sound in SOUNDS.items()}


class Loudspeaker(BaseNode):
    """An action server that plays silently: it accepts every melody, which is over when ``finish`` is called."""

    def __init__(self, **options: Any) -> None:
        super().__init__(LOUDSPEAKER, **options)
        self.played: list[str] = []  # by word, in order
        self.goals: list[Any] = []
        self.refuse = False
        self._handles: list[Any] = []
        self._server = topics.PLAY_NOTES.server(
            self, self._end, goal_callback=self._answer, handle_accepted_callback=self._begin
        )

    def finish(self, number: int = -1) -> None:
        """The melody with this number, or the last one, is over."""
        self._handles[number].execute()

    def _answer(self, goal: Any) -> GoalResponse:
        return GoalResponse.REJECT if self.refuse else GoalResponse.ACCEPT

    def _begin(self, handle: Any) -> None:
        self.goals.append(handle.request)
        self.played.append(WORDS[tuple(note.frequency for note in handle.request.note_sequence.notes)])
        self._handles.append(handle)

    def _end(self, handle: Any) -> Any:
        handle.succeed()
        return topics.PLAY_NOTES.type.Result(complete=True, iterations_played=1)


@pytest.fixture
def speaker(nodes: Session) -> Loudspeaker:
    """The loudspeaker; the node is there, too."""
    speaker: Loudspeaker = nodes.start(LOUDSPEAKER, Loudspeaker)
    nodes.start("audio_node")
    return speaker


def test_melody_reaches_base_note_by_note(nodes: Session, speaker: Loudspeaker) -> None:
    nodes.publish(topics.GAME_SOUND, " Pacman_Theme")
    assert speaker.played == ["pacman_theme"]
    (goal,) = speaker.goals
    assert goal.iterations == 1
    assert not goal.note_sequence.append
    notes = [(note.frequency, seconds_of(note.max_runtime)) for note in goal.note_sequence.notes]
    assert notes == [(frequency_hz(note), pytest.approx(seconds)) for note, seconds in SOUNDS["pacman_theme"].melody]


def test_win_melody_plays_after_pellet_fault_2(nodes: Session, speaker: Loudspeaker) -> None:
    nodes.publish(topics.GAME_SOUND, "pellet")
    nodes.publish(topics.GAME_SOUND, "win")
    nodes.advance(SOUNDS["pellet"].duration_s)
    assert speaker.played == ["pellet"]
    nodes.within(speaker.finish)
    assert speaker.played == ["pellet", "win"]


def test_endless_melody_blocks_for_a_while_fault_12(nodes: Session, speaker: Loudspeaker) -> None:
    nodes.publish(topics.GAME_SOUND, "pellet")
    nodes.publish(topics.GAME_SOUND, "death")
    nodes.advance(SOUNDS["pellet"].duration_s + PATIENCE_S - 0.05)
    assert speaker.played == ["pellet"]
    nodes.advance(0.2)
    assert speaker.played == ["pellet", "death"]
    nodes.within(lambda: speaker.finish(-2))  # the end of the first comes after all: it is not the second's
    nodes.publish(topics.GAME_SOUND, "pellet")
    nodes.advance(0.3)
    assert speaker.played == ["pellet", "death"]


def test_refused_melody_does_not_block_next(nodes: Session, speaker: Loudspeaker, log: Callable[[], str]) -> None:
    speaker.refuse = True
    nodes.publish(topics.GAME_SOUND, "ghost")
    assert "refused" in log()
    speaker.refuse = False
    nodes.publish(topics.GAME_SOUND, "win")
    assert speaker.played == ["win"]


def test_game_continues_silently_without_loudspeaker(nodes: Session, log: Callable[[], str]) -> None:
    nodes.start("audio_node")
    for word in ("pellet", "win", "pellet"):
        nodes.publish(topics.GAME_SOUND, word)
    assert log().count("no action server to play") == 1
    assert nodes.node("audio_node").once.counts["no loudspeaker"] == 3
    speaker = nodes.start(LOUDSPEAKER, Loudspeaker)
    nodes.publish(topics.GAME_SOUND, "win")
    assert speaker.played == ["win"]
