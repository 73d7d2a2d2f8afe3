"""Node ``audio_node``: plays sound words with the Create 3's loudspeaker (Algorithm 8)."""

import sys
import uuid
from functools import partial
from typing import Any

from irobot_create_msgs.msg import AudioNote, AudioNoteVector
from rclpy.duration import Duration
from unique_identifier_msgs.msg import UUID

from pacman_env.game.events import SOUNDS
from pacman_env.game.sounds import SoundQueue, frequency_hz

from .. import topics
from ..configured_node import ConfiguredNode
from ..message_conversion import word_of
from ..process import run

NAME = "audio_node"
_TICK_S = 0.1
_ACTION = topics.PLAY_NOTES


class AudioNode(ConfiguredNode):
    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._queue = SoundQueue(SOUNDS)
        self._number = 0  # number of the current melody; answers about earlier melodies are ignored
        self._player = _ACTION.client(self)
        self.listen(topics.GAME_SOUND, self._on_sound, "bad sound")
        self.create_timer(_TICK_S, self._tick)

    def _on_sound(self, message: Any) -> None:
        self._play(self._queue.request(word_of(message, SOUNDS), self.now_s()))

    def _tick(self) -> None:
        if self._queue.overdue(self.now_s()):
            self.once.warning("no end", f"{_ACTION.name}: the end of a melody was never reported")
            self._over(self._number)

    def _play(self, word: str | None) -> None:
        if word is None:
            return
        self._number += 1
        if not self._player.server_is_ready():
            self.once.warning("no loudspeaker", f"{_ACTION.name}: no action server to play {word!r}")
            self._over(self._number)
            return
        self.once.over("no loudspeaker")
        notes = [
            AudioNote(frequency=frequency_hz(note), max_runtime=Duration(nanoseconds=round(seconds * 1e9)).to_msg())
            for note, seconds in SOUNDS[word].melody
        ]  # replaces the current melody
        goal = _ACTION.type.Goal(iterations=1, note_sequence=AudioNoteVector(notes=notes, append=False))
        sent = self._player.send_goal_async(goal, goal_uuid=UUID(uuid=list(uuid.uuid4().bytes)))
        sent.add_done_callback(partial(self._on_answer, self._number))

    def _on_answer(self, number: int, answer: Any) -> None:
        if answer.exception() is not None or not answer.result().accepted:
            self.once.warning("refused", f"{_ACTION.name}: a melody was refused")
            self._over(number)
            return
        answer.result().get_result_async().add_done_callback(lambda result: self._over(number))

    def _over(self, number: int) -> None:
        if number == self._number:
            self._play(self._queue.ended(self.now_s()))


main = partial(run, AudioNode, NAME)

if __name__ == "__main__":
    sys.exit(main())
