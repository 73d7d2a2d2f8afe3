"""Processes that prepare a game before its first node starts; imports no compiler.

They check the setup as far as possible, compile code that is not in the cache yet, and prepare the map
(``prepare_game.py``).
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

from pacman_env.engine.cache_folder import mark
from pacman_env.ros.game_nodes import SELECTOR, SIMULATOR, GameSetup
from pacman_env.ros.supervisor.processes import BAD_START, end
from pacman_env.world.maps.occupancy import load_map

GHOSTS = "clyde_ghost_node"
CHECKED = "checked"  # what the first process prints once the setup is checked


@dataclass(frozen=True)
class PreparationJob:
    """Code to compile in one process: for these nodes, with the policy if the goal selector is one of them."""

    nodes: tuple[str, ...]
    policy: str = ""

    @property
    def mark(self) -> Path | None:
        """Return the file that exists once the code is compiled; None if compiled code cannot be stored."""
        kind = Path(self.policy).suffix.lstrip(".") or self.policy
        return mark(f"warm-{'-'.join(self.nodes)}-{kind or 'none'}")


def jobs(setup: GameSetup) -> list[PreparationJob]:
    """List the jobs that are not compiled yet; none if compiled code cannot be stored."""
    robot = [PreparationJob((SIMULATOR,))] if setup.sim else []
    needs = [PreparationJob((SELECTOR,), setup.policy), *robot, PreparationJob((GHOSTS,))]
    return [job for job in needs if job.mark is not None and not job.mark.exists()]


def map_mark(setup: GameSetup) -> Path | None:
    """Return the file that exists once the map is prepared; None if the cache folder cannot be written."""
    return mark(f"warm-map-{load_map(setup.map).hash[:12]}-{setup.config().hash}")


class Preparation:
    """Two processes: the first checks the setup and compiles for the selector, the second for the other nodes."""

    def __init__(self, setup: GameSetup, report: Callable[[str], None]) -> None:
        self._setup, self._report = setup, report
        missing = jobs(setup)
        selector = [job for job in missing if SELECTOR in job.nodes]
        self._others = [job for job in missing if job not in selector]
        names = [node for job in missing for node in job.nodes]
        self.words = f"compiling (once): {', '.join(names)}" if names else ""
        self._running = [self._start(selector, check=True)]

    def _start(self, work: list[PreparationJob], check: bool) -> Popen[str]:
        request = json.dumps([check, [[job.nodes, job.policy] for job in work]])
        command = [sys.executable, "-m", "pacman_env.ros.supervisor.prepare_game", request, self._setup.as_json()]
        return Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, text=True, start_new_session=True)

    def check(self) -> None:
        """Wait until the first process has checked the setup, then start the second.

        Raises ValueError if the setup is wrong; then nothing has been compiled.
        """
        first = self._running[0]
        if not (first.stdout and first.stdout.readline()):
            first.wait()
            self.done()
        if self._others:
            self._running.append(self._start(self._others, check=False))

    def done(self) -> bool:
        """Return True if everything is prepared; raises ValueError if the setup is wrong."""
        for process in [one for one in self._running if one.poll() is not None]:
            self._running.remove(process)
            _, errors = process.communicate()
            if process.returncode == BAD_START:
                raise ValueError(errors.strip().rpartition("\n")[2])  # the last line, after warnings
            if process.returncode:  # the nodes will compile the code themselves and report the error
                self._report(f"compiling ended with status {process.returncode}")
        return not self._running

    def close(self) -> None:
        end({str(process.pid): process for process in self._running}, 2.0)
        for process in self._running:
            process.communicate()
        self._running.clear()
