"""Compare rounds of the browser's game in Node with the same rounds in Python: ``python -m tools.browser_game.proof FOLDER``."""

import argparse
import base64
import hashlib
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import PLAY, Choices, Rules

PLACES = "house", "loop", "maze", "open_plan", "generated"
LINE_UPS = (  # ghosts and their speed, m/s
    (("arcade", "wander"), 0.15),
    (("arcade",), 0.25),
    (("chase", "wander", "wander"), 0.15),
    (("arcade", "chase", "wander", "flee"), 0.2),
    (("wander", "wander", "arcade", "chase"), 0.1),
)
_WATCHED_S = 60.0  # at the beginning of a round, in which positions are compared
_HERE = Path(__file__).parent


def rounds(count: int) -> list[dict[str, Any]]:
    """Return rounds as ``Round`` of round.js plays them: all line-ups on a place, then on the next one."""
    result = []
    for k in range(count):
        (ghosts, mps), place = LINE_UPS[k % len(LINE_UPS)], PLACES[k // len(LINE_UPS) % len(PLACES)]
        place = f"{place}-{k % 20}" if place == "generated" else place
        result.append({"place": place, "seed": k, "ghosts": ghosts, "clyde_mps": mps, "power": True})
    return result


def in_python(one: dict[str, Any]) -> dict[str, Any]:
    """Play a round as the page with a server does; return the same facts as rounds.mjs."""
    name, _, level = one["place"].partition("-")
    rules = Rules(name, int(level) if level else None, ghosts=tuple(one["ghosts"]), settings=PLAY["settings"])
    played = PlayedRound(*Choices().prepare(rules, one["clyde_mps"]), ("ppo",), one["seed"])
    start = time.perf_counter()
    played.finish()
    tick_ms = 1000 * (time.perf_counter() - start) / played.ticks
    rows = []
    for f in played.snapshots:
        assert f.true is not None and f.believed is not None and f.velocity is not None
        scores = np.nan_to_num(f.scores, nan=0.0)
        rows.append([*f.true, *f.believed, *f.velocity, *np.ravel(f.ghosts), f.collected, *scores])
    everything = np.array(rows)
    sha256 = hashlib.sha256(everything.tobytes()).hexdigest()
    choices = [goal for goal, *_ in played.choices]
    return {"outcome": played.end.word, "choices": choices, "sha256": sha256, "tick_ms": tick_ms, "all": everything}


def in_node(folder: Path, some: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Play rounds in Node with a folder that contains the build, and the modules by ``add_modules``."""
    command = ["node", str(folder / "rounds.mjs")]
    done = subprocess.run(command, input=json.dumps(some), capture_output=True, text=True, check=True)
    results: list[dict[str, Any]] = json.loads(done.stdout)
    for one in results:
        one["all"] = np.frombuffer(base64.b64decode(one["all"])).reshape(len(one["choices"]) + 1, -1)
    return results
