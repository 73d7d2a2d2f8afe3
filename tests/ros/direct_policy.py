"""Policies that are asked in the test's own process and answer at once, in place of ``PolicyProcess``."""

from collections import deque
from collections.abc import Callable

import numpy as np

from pacman_env.observations.situation import Situation
from pacman_env.ros.selector.policy_child import ROBOT, UNUSABLE, Answer, Policies, PolicySetup, Question


class DirectPolicy:
    """Answers within ``ask``; a policy that fails is asked again, without a new start."""

    def __init__(self, setup: PolicySetup, report: Callable[[str], None]) -> None:
        self.setup, self._report = setup, report
        self.version, self.ready, self.restarts = "", False, 0
        self.times_ms: deque[float] = deque(maxlen=1000)
        self._answers: deque[Answer] = deque()
        self._number = 0

    @property
    def is_busy(self) -> bool:
        return bool(self._answers)

    def wait(self) -> None:
        try:
            self.policies = Policies(self.setup)
        except UNUSABLE as error:
            raise ValueError(" ".join(str(error).split())) from None
        self.version, self.ready = self.policies.version, True

    def ask(self, player: int, situation: Situation, begins: bool, scores: bool = False, why: bool = False) -> int:
        self._number += 1
        arrays = [np.ascontiguousarray(array).tobytes() for array in situation.arrays()]
        self._answers.append(self.policies.answer(Question(self._number, player, begins, arrays, scores, why)))
        return self._number

    def poll(self, wait_s: float = 0.0) -> Answer | None:
        if not self._answers:
            return None
        answer = self._answers.popleft()
        if answer.error:
            self._report(f"{answer.error}; the robot holds")
        elif answer.player == ROBOT:
            self.times_ms.append(answer.elapsed_ms)
            self._report("")
        return answer

    def close(self) -> None:
        self._answers.clear()
        self.ready = False
