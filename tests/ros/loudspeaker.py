"""The base's loudspeaker, for tests: an action server that plays silently and remembers what it played."""

from typing import Any

from rclpy.action import GoalResponse

from pacman_env.game.events import SOUNDS
from pacman_env.game.sounds import frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode

NAME = "loudspeaker"
_WORDS = {tuple(frequency_hz(note) for note, _ in sound.melody): word for word, sound in SOUNDS.items()}


class Loudspeaker(BaseNode):
    """Accepts every melody; one is over when ``finish`` is called."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
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
        self.played.append(_WORDS[tuple(note.frequency for note in handle.request.note_sequence.notes)])
        self._handles.append(handle)

    def _end(self, handle: Any) -> Any:
        handle.succeed()
        return topics.PLAY_NOTES.type.Result(complete=True, iterations_played=1)
