"""Compare rounds of the browser's game in Node with the same rounds in Python: ``python -m tests.browser_game.proof``.

Python plays each round twice: with the mathematical functions of this machine, and with those of the browser's module.
"""

import ctypes
import hashlib
import json
import platform
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import msgspec
import numpy as np
from numba.core.registry import cpu_target

from pacman_env.web.orders import FOLLOW, Moves
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import PLAY, Choices, Rules
from tools.browser_game import page
from tools.browser_game.__main__ import PLACES, build
from tools.common import ROOT

MAPS = "house", "loop", "maze", "open_plan", "generated"
LINE_UPS = (  # ghosts and their speed, m/s
    (("arcade", "wander"), 0.15),
    (("arcade",), 0.25),
    (("chase", "wander", "wander"), 0.15),
    (("chase", "chase", "wander"), 0.3),
    (("wander", "wander", "arcade", "chase"), 0.1),
)
_FUNCTIONS = "sin", "cos", "sincos", "atan2", "exp", "log", "pow", "hypot", "tanh"  # those of kernels
_COMPARED = 120  # ticks, of 0.5 s
_HERE = Path(__file__).parent


def rounds(count: int) -> list[dict[str, Any]]:
    """Return rounds for rounds.mjs: all line-ups on a map, then on the next one."""
    result = []
    for seed in range(count):
        ghosts, mps = LINE_UPS[seed % len(LINE_UPS)]
        place = MAPS[seed // len(LINE_UPS) % len(MAPS)]
        place = f"{place}-{seed % 20}" if place == "generated" else place
        result.append({"place": place, "seed": seed, "ghosts": ghosts, "clyde_mps": mps, "power": True})
    return result


def with_orders(one: dict[str, Any], places: int, most: int = 60) -> dict[str, Any]:
    """Return a round with random orders of people to the robot and to the ghosts; the first ghost is placed before."""
    draw = random.Random(one["seed"])
    ghosts = [number for number in range(len(one["ghosts"])) if number == 0 or draw.random() < 0.5]
    orders, tick = [], 0
    for _ in range(most):
        tick += draw.randint(1, 12)
        by_hand = {"velocity": [round(draw.uniform(-0.1, 0.3), 2), round(draw.uniform(-1.0, 1.0), 2)]}
        robot = draw.choice(
            [{}, {"robot": True}, {"robot": True, "goal": draw.randrange(9)}, {"robot": True, **by_hand}]
        )
        cells = {number: draw.choice([None, FOLLOW, draw.randrange(places)]) for number in ghosts}
        orders.append([tick, {**robot, "ghosts": cells}])
    return one | {"played": ghosts, "moves": {"placed": {0: [1.0, 1.0]}, "orders": orders}}


def build_page(some: Sequence[dict[str, Any]], folder: Path) -> None:
    """Build the page with the maps of some rounds, rounds.mjs, and the library of ``in_python``.

    The page offers all maps; the others cannot be loaded.
    """
    places = sorted({one["place"] for one in some} | {"house"})
    build(folder / "game", ROOT / "build" / "browser_game", places)
    page.write(folder, PLACES)
    shutil.copy(_HERE / "rounds.mjs", folder / "game")
    (folder / "package.json").write_text('{"type": "module"}')
    code, library = folder / "libm.c", folder / "libm.so"
    functions = f"void *functions[] = {{{', '.join(_FUNCTIONS)}}};"
    code.write_text(f"#define _GNU_SOURCE\n#include <math.h>\n{functions}\nint main(void) {{}}\n")
    target = f"--target={platform.machine()}-linux-musl"
    options = "-O2", "-w", "-static", "-fPIC", "-pie", "-rdynamic", target
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *options, code, "-o", library], check=True)
    content = library.read_bytes()  # a program, because Zig adds these functions to no library
    flags = content.index(struct.pack("<Q", 0x6FFFFFFB)) + 8  # DT_FLAGS_1, which forbids to load a program
    library.write_bytes(content[:flags] + bytes(8) + content[flags + 8 :])


def in_python(some: Sequence[dict[str, Any]], libm: Path | None = None) -> list[dict[str, Any]]:
    """Play rounds in a new process, with the functions of ``libm`` if it is given; return results as rounds.mjs."""
    with ProcessPoolExecutor(1, get_context("spawn"), _replace_functions, (libm,)) as pool:
        return list(pool.map(_play, some))


def _replace_functions(libm: Path | None) -> None:
    if libm:
        _ = cpu_target.target_context  # adds this machine's functions
        addresses = (ctypes.c_void_p * len(_FUNCTIONS)).in_dll(ctypes.CDLL(str(libm)), "functions")
        for name, address in zip(_FUNCTIONS, addresses, strict=True):
            llvm.add_symbol(name, address)


def _play(one: dict[str, Any]) -> dict[str, Any]:
    name, _, level = one["place"].partition("-")
    rules = Rules(name, int(level) if level else None, ghosts=tuple(one["ghosts"]), settings=PLAY["settings"])
    people = frozenset(one.get("played", ()))
    played = PlayedRound(*Choices().prepare(rules, one["clyde_mps"]), ("ppo",), one["seed"], people)
    start = time.perf_counter()
    played.replay(msgspec.convert(one.get("moves", {}), Moves, strict=False))
    tick_ms = 1000 * (time.perf_counter() - start) / played.ticks
    columns = "true", "believed", "velocity", "ghosts", "collected", "scores"
    rows = [np.hstack([np.ravel(getattr(frame, name)) for name in columns]) for frame in played.snapshots]
    numbers = np.nan_to_num(rows)
    sha256 = hashlib.sha256(numbers.tobytes()).hexdigest()
    choices = [goal for goal, *_ in played.choices]
    return {"outcome": played.end.word, "choices": choices, "sha256": sha256, "tick_ms": tick_ms, "numbers": numbers}


def in_node(some: Sequence[dict[str, Any]], folder: Path) -> list[dict[str, Any]]:
    """Play rounds in Node with the files of ``build_page``."""
    command = "node", str(folder / "game" / "rounds.mjs")
    done = subprocess.run(command, input=json.dumps(some), stdout=subprocess.PIPE, text=True, check=True)
    results: list[dict[str, Any]] = json.loads(done.stdout)
    return [{**one, "numbers": np.array(one["numbers"])} for one in results]


def main() -> None:
    some = rounds(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build_page(some, folder)
        node = in_node(some, folder)
        python, same = in_python(some), in_python(some, folder / "libm.so")
    rows = defaultdict(list)
    for one, a, b, c in zip(some, python, node, same, strict=True):
        last = min(len(a["numbers"]), len(b["numbers"]))
        gaps = np.abs(a["numbers"][:last] - b["numbers"][:last])
        places = gaps[: _COMPARED + 1, [0, 1, 3, 4, *range(8, 8 + 2 * len(one["ghosts"]))]].max()
        alike = a["choices"] == b["choices"]
        if not alike:
            tick = next((k for k in range(last - 1) if a["choices"][k] != b["choices"][k]), last - 1)
            print(f"{one}: other choice in tick {tick}; x, y: {gaps[tick, :2].max()}, scores: {gaps[tick, 9:].max()}")
        bits = (b["sha256"] == other["sha256"] for other in (a, c))
        key = one["place"].partition("-")[0], ", ".join(one["ghosts"])
        rows[key].append((a["outcome"] == b["outcome"], alike, *bits, places))
    print("| Map | Ghosts | Rounds | Same outcome | Same choices | Same bits | With same functions | 60 s, m |")
    print("|---" * 8 + "|")
    for key, facts in rows.items():
        *counts, places = zip(*facts, strict=True)
        print("|", " | ".join(map(str, (*key, len(facts), *map(sum, counts), f"{max(places):.0e}"))), "|")
    for what, results in (("Python", python), ("with same functions", same), ("Node", node)):
        print(f"{what}: {np.mean([one['tick_ms'] for one in results]):.2f} ms per tick")


if __name__ == "__main__":
    main()
