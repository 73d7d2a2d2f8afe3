"""Compare with well-known environments: ``python -m benchmarks.peers``.

Each library steps in separate processes, in its own venv if a folder for venvs is given, in alternation with ours.
Versions are pinned; libraries that cannot be installed or played are listed with the reason.
"""

import argparse
import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import CORES, ROOT, benchmark, log, median_and_range, turns
from tools.common import names, table

Turn = dict[str, float]  # decisions_per_s and cores
Case = tuple[int, int, int]  # number of a task, games, threads

OURS = "pacman_env"
#: Requirements of each library's venv.
PEERS = {
    "envpool": ("envpool==1.2.5", "gymnasium==1.4.0", "numpy==2.4.6"),
    "vmas": ("vmas==1.5.2", "torch==2.13.0", "gym==0.26.2", "numpy==2.4.6"),
    "mpe2": ("mpe2==1.1.1", "pettingzoo==1.27.0", "gymnasium==1.4.0", "numpy==2.4.6"),
    "jumanji": ("jumanji==1.1.2",),
    "ale-py": ("ale-py==0.12.1", "gymnasium==1.4.0", "numpy==2.4.6"),
    "minigrid": ("minigrid==3.2.0", "gymnasium==1.4.0", "numpy==2.4.6"),
    "highway-env": ("highway-env==1.12.1", "gymnasium==1.4.0", "numpy==2.4.6"),
}
SCRIPT = Path(__file__).with_name("peer_worker.py")
LIMIT_S = 600.0  # limit for an answer; the first one may include compilation
NOTE = """\
A figure is the median of turns that alternate with turns of ours at the same N, after a warm-up; `of ours` is the
median, and the range, of the ratio of two turns. Ours steps in one thread, also when the other has more. `cores` is
CPU time by wall time. The games, the physics, what is observed and how long a decision lasts differ, and with them the
work in a decision. EnvPool's asynchronous mode, and VMAS and Jumanji on a graphics processor, where they are fastest,
are not measured. Speed is no measure of an environment's quality."""


class PeerError(Exception):
    """Raised with the reason, in one line, if a library cannot be installed or played."""


def python_of(name: str, folder: Path) -> Path:
    """Return the interpreter of a library's venv in ``folder``; create the venv if it is missing or outdated."""
    venv = folder.absolute() / name
    python, stamp = venv / "bin" / "python", venv / "installed"
    wanted = hashlib.sha256(repr((platform.python_version(), PEERS[name])).encode()).hexdigest()
    if stamp.exists() and stamp.read_text() == wanted:
        return python
    log(f"installing {', '.join(PEERS[name])} into {venv} ...")
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check", "install", "--quiet"]
    for command in ([sys.executable, "-m", "venv", "--clear", "--without-pip", str(venv)], [*pip, *PEERS[name]]):
        done = subprocess.run(command, env=_environment(bare=True), capture_output=True, text=True)
        if done.returncode:
            lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
            errors = [line for line in lines if line.startswith("ERROR")] or lines or [f"status {done.returncode}"]
            raise PeerError(f"cannot be installed: {errors[-1]}")
    stamp.write_text(wanted)
    return python


def _environment(bare: bool) -> dict[str, str]:
    """Return the variables of a process: with this project first on its path, or without a path for another venv."""
    path = [] if bare else [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}


class Worker:
    """Plays a library's environments, each turn in a separate process, by default with the current Python.

    Raises PeerError for failures of a library, but ValueError for ours, without which nothing is comparable.
    """

    def __init__(self, name: str, map_source: str, python: Path | None = None) -> None:
        self.name = name
        self._command = [python or sys.executable, "-P", SCRIPT, name, map_source]
        self._environment = _environment(bare=python is not None)
        facts = self.turn()
        self.version: str = facts["version"]
        self.tasks: list[dict[str, Any]] = facts["tasks"]  # peer_worker.Task

    def cases(self) -> Iterator[Case]:
        """Yield the cases to measure; all cores only with many games."""
        for number, task in enumerate(self.tasks):
            for size in task["sizes"]:
                for threads in sorted({1, CORES if task["threaded"] and size > 1 else 1}):
                    yield number, size, threads

    def turn(self, *case: float) -> dict[str, Any]:
        """Return the figures of a case and a number of seconds; without arguments, version and tasks."""
        command, env = [*self._command, json.dumps(case)], self._environment
        try:
            done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            answer = {"error": f"no answer within {LIMIT_S:g} s"}
        else:
            last = [line for line in done.stderr.splitlines() if line.strip()][-1:]
            error = {"error": ": ".join([f"ended with status {done.returncode}", *last])}
            answer = json.loads(done.stdout) if done.stdout else error
        if "error" not in answer:
            return answer
        raise ValueError(f"our own environment: {answer['error']}") if self.name == OURS else PeerError(answer["error"])

    def row(self, case: Case, turns: Sequence[Turn]) -> dict[str, Any]:
        """Return the medians of a case's turns, with the description of a decision."""
        number, size, threads = case
        rate, cores = (float(np.median([turn[key] for turn in turns])) for key in ("decisions_per_s", "cores"))
        task = {key: self.tasks[number][key] for key in ("name", "simulated_s", "description")}
        simulated = rate * task["simulated_s"]
        rates = {"decisions_per_s": rate, "simulated_s_per_s": simulated, "cores": cores}
        return {"library": self.name, "version": self.version, **task, "n": size, "threads": threads, **rates}


def run(libraries: Sequence[str], venvs: Path | None, map_source: str, rounds: int, seconds: float) -> dict[str, Any]:
    """Return the figures of ours on a map, and of ``libraries`` in their venvs, if there is a folder for venvs.

    Each figure takes ``seconds`` in total, divided into ``rounds`` turns.
    """
    if venvs:
        venvs.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    failed = {}
    turns_of_ours: dict[int, list[Turn]] = {}
    own = Worker(OURS, map_source)

    def own_turn(size: int) -> Turn:
        return own.turn(0, size, 1, seconds / rounds)

    for name in libraries:
        try:
            peer = Worker(name, map_source, python_of(name, venvs) if venvs else None)
            for case in peer.cases():
                log(f"{name} {peer.tasks[case[0]]['name']}, N = {case[1]}, threads: {case[2]} ...")
                pairs = turns(rounds, partial(own_turn, case[1]), partial(peer.turn, *case, seconds / rounds))
                turns_of_ours.setdefault(case[1], []).extend(turn for turn, _ in pairs)
                rates = [turn["decisions_per_s"] / ours["decisions_per_s"] for ours, turn in pairs]
                ratio, *around = median_and_range(rates)
                rows.append(peer.row(case, [turn for _, turn in pairs]) | {"ratio": ratio, "ratio_range": around})
        except PeerError as error:
            failed[name] = str(error)
    alone = {case: turns_of_ours.get(case[1]) or [own_turn(case[1]) for _ in range(rounds)] for case in own.cases()}
    rows = [own.row(case, played) for case, played in alone.items()] + rows
    return {"rows": rows, "failed": failed, "rounds": rounds, "venvs": venvs is not None, "cores": CORES}


def show(figures: dict[str, Any]) -> str:
    """Return the figures, the descriptions of decisions, the reasons of missing figures, and the note."""
    rows, decisions = [], {}
    for row in figures["rows"]:
        ratio = "{:.3g} ({:.3g} to {:.3g})".format(row["ratio"], *row["ratio_range"]) if "ratio" in row else ""
        name, rates = f"{row['library']} {row['name']}", (row["decisions_per_s"], row["simulated_s_per_s"])
        rate, real = (f"{one:,.0f}" if one >= 100 else f"{one:.3g}" if one else "-" for one in rates)
        rows.append([name, str(row["n"]), str(row["threads"]), rate, ratio, real, f"{row['cores']:.2f}"])
        lasts = f"{row['simulated_s']:.3g} s" if row["simulated_s"] else "no time"
        decisions[name] = f"- {row['library']} {row['version']} {row['name']}: {lasts}, {row['description']}"
    missing = [f"- not measured: {name}: {reason}" for name, reason in figures["failed"].items()]
    if missing and not figures["venvs"]:
        missing.append("  (--venvs DIR installs them there)")
    text = table(("", "N", "threads", "decisions/s", "of ours", "simulated s/s", "cores"), rows)
    return text + "\n".join(["", "A decision:", *decisions.values(), *missing, "", NOTE])


def _report(arguments: argparse.Namespace) -> dict[str, Any]:
    chosen = list(dict.fromkeys(arguments.names or PEERS))
    figures = run(chosen, arguments.venvs, arguments.map, arguments.rounds, arguments.seconds)
    print(show(figures))
    return figures


main = benchmark(
    "peers",
    __doc__,
    _report,
    "--rounds",
    names("library", PEERS),
    ("--seconds", {"type": float, "default": 6.0, "help": "roughly what each figure may take (%(default)s)"}),
    ("--venvs", {"type": Path, "metavar": "DIR", "help": "install each library there, in a venv of its own, once"}),
)

if __name__ == "__main__":
    sys.exit(main())
