"""The processes that prepare a game before its first node starts; imports no compiler.

They check what can be known to be wrong, compile what has not been compiled on this machine yet, and prepare the map
(``warm_up.py``).
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

from pacman_env.engine.cache_folder import mark
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR, GameSetup
from pacman_env.ros.supervisor.processes import BAD_START, end
from pacman_env.world.maps.occupancy import load_map

GHOSTS = "clyde_ghost_node"
CHECKED = "checked"  # the first line of the first process


@dataclass(frozen=True)
class Part:
    """What one process compiles: for some nodes, with a policy."""

    nodes: tuple[str, ...]
    policy: str = ""

    @property
    def mark(self) -> Path | None:
        """The file that exists once it is done; None where nothing is kept."""
        kind = Path(self.policy).suffix.lstrip(".") or self.policy
        return mark(f"warm-{'-'.join(self.nodes)}-{kind or 'none'}")


def parts(setup: GameSetup) -> list[Part]:
    """List the parts that are not compiled yet; none where nothing can be kept."""
    robot = [Part((SIMULATOR,))] if setup.sim else []
    wanted = [Part((SELECTOR,), setup.policy), *robot, Part((GHOSTS,))]
    return [part for part in wanted if part.mark is not None and not part.mark.exists()]


def map_mark(setup: GameSetup) -> Path | None:
    """Return the file that exists once the map is prepared."""
    return mark(f"warm-map-{load_map(setup.map).hash[:12]}-{setup.config().hash}")


class Preparation:
    """The processes: the first checks the setup and compiles one half of the parts, the second compiles the other."""

    def __init__(self, setup: GameSetup, report: Callable[[str], None]) -> None:
        self._setup, self._report = setup, report
        compiled = parts(setup)
        selector = [part for part in compiled if SELECTOR in part.nodes]
        self._others = [part for part in compiled if part not in selector]
        names = [node for part in compiled for node in part.nodes]
        self.words = f"compiling (once): {', '.join(names)}" if names else ""
        self._running = [self._start(selector, check=True)]

    def _start(self, compiled: list[Part], check: bool) -> Popen[str]:
        asked = json.dumps([check, [[part.nodes, part.policy] for part in compiled]])
        command = [sys.executable, "-m", "pacman_env.ros.supervisor.warm_up", asked, self._setup.as_json()]
        return Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, text=True, start_new_session=True)

    def check(self) -> None:
        """Wait until what can be known to be wrong has been checked, then begin with the other half.

        ValueError for what is wrong: nothing has been compiled then.
        """
        first = self._running[0]
        if not (first.stdout and first.stdout.readline()):
            first.wait()
            self.done()
        if self._others:
            self._running.append(self._start(self._others, check=False))

    def done(self) -> bool:
        """Return whether all is prepared; ValueError for what is wrong with the setup."""
        for process in [one for one in self._running if one.poll() is not None]:
            self._running.remove(process)
            _, errors = process.communicate()
            if process.returncode == BAD_START:
                raise ValueError(errors.strip().rpartition("\n")[2])  # after warnings
            if process.returncode:  # the nodes compile for themselves, and report what is wrong
                self._report(f"compiling ended with status {process.returncode}")
        return not self._running

    def close(self) -> None:
        end({str(process.pid): process for process in self._running}, 2.0)
        for process in self._running:
            process.communicate()
        self._running.clear()
