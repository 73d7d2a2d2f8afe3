"""The original's ``audio_node``: what comes while it is busy is ignored, and busy has no time-out."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Duration
from irobot_create_msgs.action import AudioNoteSequence
from irobot_create_msgs.msg import AudioNote, AudioNoteVector
from rclpy.action import ActionClient
from rclpy.node import Node
from std_msgs.msg import String

from tests.ros.original.common import EVENTS, run

#: Word to MIDI notes, each of them so long, s.
MELODIES: dict[str, tuple[tuple[int, ...], float]] = {
    "start": ((60, 64, 67, 72), 0.15),
    "pacman_theme": ((71, 83, 78, 75, 83, 78, 75) * 4 + (83,), 6.4 / 29),
    "pellet": ((79, 84), 0.07),
    "power pellet": ((64, 70, 76, 82), 0.12),
    "ghost": ((84, 79, 88, 91), 0.1),
    "death": ((76, 74, 72, 70, 68, 60, 48), 0.2),
    "win": ((67, 72, 76, 79, 84), 0.2),
}


class AudioNode(Node):
    def __init__(self) -> None:
        super().__init__("audio_node")
        self.busy = False
        self.player = ActionClient(self, AudioNoteSequence, "audio_note_sequence")
        self.create_subscription(String, "game_sound", self.hear, EVENTS)

    def hear(self, message: Any) -> None:
        if self.busy or message.data not in MELODIES or not self.player.server_is_ready():
            return
        self.busy = True
        midi, seconds = MELODIES[message.data]
        length = Duration(nanosec=round(seconds * 1e9))
        notes = [AudioNote(frequency=round(440.0 * 2.0 ** ((m - 69) / 12.0)), max_runtime=length) for m in midi]
        vector = AudioNoteVector(notes=notes, append=False)
        self.player.send_goal_async(AudioNoteSequence.Goal(iterations=1, note_sequence=vector)).add_done_callback(
            lambda answer: self.answered(answer.result())
        )

    def answered(self, goal: Any) -> None:
        if not goal.accepted:
            self.busy = False
            return
        goal.get_result_async().add_done_callback(self.ended)

    def ended(self, result: Any) -> None:
        self.busy = False


def main() -> int:
    return run(AudioNode)
