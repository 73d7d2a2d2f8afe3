"""A user's policy whose fault a file names, even while its process runs."""

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.heuristics.simple import Nearest

FAULT_FILE = "PACMAN_TEST_FAULT"  # variable of the environment


class Faulty(Nearest):
    """Chooses the nearest pellet unless it has a fault."""

    name = "faulty"

    def scores(self, situation: Any) -> Any:
        scores = super().scores(situation)
        match Path(os.environ[FAULT_FILE]).read_text():
            case "raises":
                raise LookupError("no such goal")
            case "sleeps":
                time.sleep(3.0)
            case "loops":
                while True:
                    pass
            case "exits":
                sys.exit(7)
            case "ends":
                os._exit(7)
            case "sends half an answer":
                os.write(int(sys.argv[1]), b"half")
                time.sleep(60.0)
            case "sends a wrong answer":
                os.write(int(sys.argv[1]), b"\0\0\0\1\x07")
                time.sleep(60.0)
            case "fills the memory":
                np.empty(5 * 2**30, np.uint8)
        return scores

    def explain(self, situation: Any) -> Any:
        terms = super().explain(situation)
        if Path(os.environ[FAULT_FILE]).read_text() == "explains by place":
            terms[0] = [{**one, (0, 1): 2.0} for one in terms[0]]
        return terms
