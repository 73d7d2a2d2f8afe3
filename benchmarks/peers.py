"""Well-known environments beside ours: ``python -m benchmarks.peers``.

Each library steps in processes of its own, in its own venv if a folder for venvs is given, and ours does the same in
turns with it. Versions are pinned; what cannot be installed or played is named with the reason.
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

Turn = dict[str, float]  # decisions_per_s and cores

OURS = "pacman_env"
#: By library: what its venv gets.
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
LIMIT_S = 600.0  # for an answer; the first may have to wait for kernels
NOTE = """\
Compared: how fast random actions are answered, each with an observation and a reward, ended episodes begun anew, after
a warm-up; a figure is the median of turns that alternate with turns of ours at the same N. Ours steps in one thread,
also beside those with more; MPE2, HighwayEnv, ALE and MiniGrid have no batches of their own. `of ours`: the median, and
the range, of the ratio of two turns side by side. `cores`: CPU time by wall time; below 1 per thread something else had
the processor, or a thread waited.
Not compared: the games, the physics, what is observed and how long a decision lasts differ, as listed above, and with
them the work in a decision. Simulated seconds are no common measure either: one of an emulated console, one of discs in
the plane and one of a robot with its navigation have little in common, and grids have none. EnvPool's asynchronous
mode, and VMAS and Jumanji on a graphics processor, where they are fastest, are not measured. Speed is no measure of an
environment's quality."""


class PeerError(Exception):
    """A library that cannot be installed or played, and why, in one line."""


def python_of(name: str, folder: Path) -> Path:
    """The interpreter of a library's venv in ``folder``, which is made if it is not there or has other versions."""
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
    """Of a process: with this project first on its path, or for another venv without any path."""
    found = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if not bare:
        found["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    return found


class Worker:
    """Plays a library's environments with the present Python, if none is given, each turn in a process of its own.

    What a library cannot do is a PeerError; without ours there is nothing to compare with: ValueError.
    """

    def __init__(self, name: str, map_source: str, python: Path | None = None) -> None:
        self.name = name
        self._command = [python or sys.executable, "-P", SCRIPT, name, map_source]
        self._environment = _environment(bare=python is not None)
        facts = self.turn()
        self.version: str = facts["version"]
        self.tasks: list[dict[str, Any]] = facts["tasks"]  # peer_worker.Task

    def title(self, task: int) -> str:
        return f"{self.name} {self.version} {self.tasks[task]['name']}"

    def cases(self) -> Iterator[tuple[int, int, int]]:
        """What is measured: a task's number, how many games, how many threads; all cores only with many games."""
        for number, task in enumerate(self.tasks):
            for size in task["sizes"]:
                for threads in sorted({1, CORES if task["threaded"] and size > 1 else 1}):
                    yield number, size, threads

    def turn(self, *case: float) -> dict[str, Any]:
        """The figures of a task's number, how many games, threads and seconds; without them, version and tasks."""
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


def run(names: Sequence[str], venvs: Path | None, map_source: str, rounds: int, seconds: float) -> dict[str, Any]:
    """All figures: of ours on a map, and of ``names`` in their venvs, if there is a folder for venvs.

    ``rounds`` turns for each figure take ``seconds`` together.
    """
    if venvs:
        venvs.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    failed = {}
    turns_of_ours: dict[int, list[Turn]] = {}
    own = Worker(OURS, map_source)
    steps = {own.title(0): own.tasks[0]}

    def own_turn(size: int) -> Turn:
        return own.turn(0, size, 1, seconds / rounds)

    for name in names:
        try:
            peer = Worker(name, map_source, python_of(name, venvs) if venvs else None)
            for case in peer.cases():
                task, size, threads = case
                steps[peer.title(task)] = peer.tasks[task]
                log(f"{peer.title(task)}, N = {size}, threads: {threads} ...")
                pairs = turns(rounds, partial(own_turn, size), partial(peer.turn, *case, seconds / rounds))
                turns_of_ours.setdefault(size, []).extend(turn for turn, _ in pairs)
                rates = [turn["decisions_per_s"] / ours["decisions_per_s"] for ours, turn in pairs]
                ratio, *around = median_and_range(rates)
                simulated = peer.tasks[task]["simulated_s"] / own.tasks[0]["simulated_s"]
                ratios = {"ratio": ratio, "ratio_range": around, "simulated_ratio": ratio * simulated}
                rows.append(_row(peer, case, [turn for _, turn in pairs]) | ratios)
        except PeerError as error:
            failed[name] = str(error)
    sizes = {size: turns_of_ours.get(size) or [own_turn(size) for _ in range(rounds)] for _, size, _ in own.cases()}
    first = [_row(own, (task, size, threads), sizes[size]) for task, size, threads in own.cases()]
    facts = {"map": map_source, "rounds": rounds, "venvs": venvs is not None, "cores": CORES}
    return {"rows": first + rows, "steps": steps, "failed": failed, **facts}


def _row(worker: Worker, case: tuple[int, int, int], turns: Sequence[Turn]) -> dict[str, Any]:
    task, size, threads = case
    rate, cores = (float(np.median([turn[key] for turn in turns])) for key in ("decisions_per_s", "cores"))
    return {
        "library": worker.name,
        "version": worker.version,
        "task": worker.tasks[task]["name"],
        "n": size,
        "threads": threads,
        "decisions_per_s": rate,
        "simulated_s_per_s": rate * worker.tasks[task]["simulated_s"],
        "cores": cores,
    }


def table(figures: dict[str, Any]) -> str:
    """The figures, what a decision is in each, what was not measured and why, and the note."""
    head = f"{'':<31}{'N':>4}{'threads':>9}{'decisions/s':>13}{'of ours':>32}"
    lines = [
        f"map {figures['map']}, {figures['rounds']} turns of each, {figures['cores']} cores",
        f"{head}{'simulated s/s':>15}{'of ours':>9}{'cores':>7}",
    ]
    for row in figures["rows"]:
        ratio, simulated = "", ""
        if "ratio" in row:
            ratio = "{:.3g} ({:.3g} to {:.3g})".format(row["ratio"], *row["ratio_range"])
            simulated = f"{row['simulated_ratio']:.3g}" if row["simulated_ratio"] else "-"
        name, rate, real = f"{row['library']} {row['task']}", row["decisions_per_s"], row["simulated_s_per_s"]
        lines.append(
            f"{name:<31}{row['n']:>4}{row['threads']:>9}{_rounded(rate):>13}{ratio:>32}"
            f"{_rounded(real):>15}{simulated:>9}{row['cores']:>7.2f}"
        )
    lines += ["", "a decision:"]
    steps = figures["steps"].items()
    for title, task in steps:
        lasts = f"{task['simulated_s']:.3g} s" if task["simulated_s"] else "no time"
        lines.append(f"  {title}: {lasts}, {task['description']}")
    lines += [f"not measured: {name}: {reason}" for name, reason in figures["failed"].items()]
    if figures["failed"] and not figures["venvs"]:
        lines.append("  (--venvs DIR installs them there)")
    return "\n".join([*lines, "", NOTE])


def _rounded(rate: float) -> str:
    return f"{rate:,.0f}" if rate >= 100 else f"{rate:.3g}" if rate else "-"


def _library(name: str) -> str:
    if name not in PEERS:
        raise argparse.ArgumentTypeError(f"unknown library {name!r} (choose from {', '.join(PEERS)})")
    return name


def _report(arguments: argparse.Namespace) -> dict[str, Any]:
    names = list(dict.fromkeys(arguments.libraries or PEERS))
    figures = run(names, arguments.venvs, arguments.map, arguments.rounds, arguments.seconds)
    print(table(figures))
    return figures


main = benchmark(
    "peers",
    __doc__,
    _report,
    "--rounds",
    ("libraries", {"nargs": "*", "metavar": "NAME", "help": f"of {', '.join(PEERS)} (all of them)", "type": _library}),
    ("--seconds", {"type": float, "default": 6.0, "help": "roughly what each figure may take (%(default)s)"}),
    ("--venvs", {"type": Path, "metavar": "DIR", "help": "install each library there, in a venv of its own, once"}),
)

if __name__ == "__main__":
    sys.exit(main())
