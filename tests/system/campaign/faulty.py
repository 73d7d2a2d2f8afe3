"""A policy that drives far; it fails as long as the file ``$FAULTY_POLICY`` contains hangs, sleeps or raises."""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.heuristics.simple import Nearest

FILE = "FAULTY_POLICY"
SLEEP_S = 3.0
_REHEARSED = 20  # calls in which it never fails


class Faulty(Nearest):
    name = "faulty"
    calls = 0

    def scores(self, situation: Any) -> Any:
        self.calls += 1
        file = Path(os.environ[FILE])
        if self.calls > _REHEARSED and file.exists():
            fault = file.read_text()
            file.with_suffix(".begun").touch()
            if fault == "raises":
                raise LookupError("no such goal")
            time.sleep(SLEEP_S if fault == "sleeps" else 3600.0)
        scores = super().scores(situation)
        return np.where(np.isfinite(scores), -scores, -np.inf)  # the farthest: a robot that is not stopped drives on
