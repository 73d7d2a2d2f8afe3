"""A lock-step game on one map, and the recorder that has joined it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pacman_env.ros.lock_step.deliveries import NodeFailed
from pacman_env.ros.lock_step.game import LockStepGame
from pacman_env.ros.standstill import STOOD_STILL
from pacman_env.ros.supervisor.game_nodes import REFEREE, SELECTOR, SIMULATOR, GameSetup
from tests.system.campaign.recorder import GOAL_SERVICE, LateListener, Recorder

FIRST_POLICY = "nearest"  # of the goal selector, until a game asks for its own
READY_S = 30.0
T = TypeVar("T")


class RecordedGame(LockStepGame):
    """The game, in its menu and ready to be started; ``with`` ends it.

    Args:
        map_yaml: of the arena that is played on.
        seed: of robot, ghosts and everything else that is drawn.
        folder: for the referee's file; it holds none of a game before.
        settings: of the configuration, ``name=value``.
        preset: likewise.

    Attributes:
        recorder: the node that records.

    Raises:
        ValueError: a map or configuration that cannot be played.
        NodeFailed: the game does not come up.
    """

    def __init__(
        self, map_yaml: str, seed: int, folder: Path, settings: Sequence[str] = (), preset: str = "robot"
    ) -> None:
        extra: dict[str, dict[str, Any]] = {
            name: {"state_file": str(folder / f"{name}.json")} for name in (REFEREE, SELECTOR)
        }
        setup = GameSetup(map_yaml, FIRST_POLICY, sim=True, preset=preset, settings=tuple(settings), extra=extra)
        super().__init__(setup, seed, alone=True)
        self._looked_at = 0  # of the restarts
        try:
            self.recorder: Recorder = self.join(Recorder)
            self.observe_requests(self.recorder, f"{self.namespace}/{GOAL_SERVICE}", self.recorder.see_goal)
            if not self.until(self.recorder.ready, READY_S):
                raise NodeFailed(f"the game is not ready after {READY_S:g} s: {self.recorder.condition}")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RecordedGame:
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()

    def do(self, do: Callable[[], T]) -> T:
        """Have the recorder do something between two steps; what ``do`` returns."""
        result: T = self.within(self.recorder, do)
        return result

    def tend(self) -> list[str]:
        """After a step: what ``ros up`` does when the goal selector has ended; ends that were not asked for.

        A simulated robot that has ended lists no goals any more, which is recorded.
        """
        new, self._looked_at = self.restarts[self._looked_at :], len(self.restarts)
        if any(name == SIMULATOR for _, name, _ in new):
            self.recorder.no_goals()
        if any(name == SELECTOR for _, name, _ in new):
            self.do(self.recorder.halt)
        return [f"{name} ended with status {status}" for _, name, status in new if status not in (None, STOOD_STILL)]

    def missed_by_a_late_listener(self) -> list[str]:
        """Topics on which a node that comes now does not get what was published last."""
        expected = {r.topic: r.value for r in self.recorder.records}
        listener: LateListener = self.join(LateListener)
        self.remove(next(one for one in self.members if one.node is listener), last_messages=False)
        return [name for name, values in listener.received.items() if expected.get(name) not in values]
