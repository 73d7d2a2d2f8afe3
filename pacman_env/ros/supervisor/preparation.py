"""What processes of their own prepare for a game, while nodes start that need nothing of it; imports no compiler.

They check what can be known to be wrong, compile what has not been compiled on this machine yet, and prepare the map
(``warm_up.py``).
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

from pacman_env.engine.cache_folder import mark
from pacman_env.ros.supervisor.game_nodes import COMPOSED, LOCK_STEP, SELECTOR, SIMULATOR, GameSetup
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
    """The parts that are not compiled yet; none where nothing can be kept."""
    robot = [Part((SIMULATOR,))] if setup.sim else []
    wanted = [Part((SELECTOR,), setup.policy), *robot, Part((GHOSTS,))]
    return [part for part in wanted if part.mark is not None and not part.mark.exists()]


def map_mark(setup: GameSetup) -> Path | None:
    """The file that exists once the map is prepared."""
    return mark(f"warm-map-{load_map(setup.map).hash[:12]}-{setup.config().hash}")


class Preparation:
    """The processes, from the start on; ``holds`` says which nodes wait for them."""

    def __init__(self, setup: GameSetup, report: Callable[[str], None]) -> None:
        self._setup, self._report, self._began_s = setup, report, time.monotonic()
        kept = map_mark(setup)
        # The nodes that need the map would otherwise each compute what is not kept of it.
        first = (SELECTOR,) if kept is not None and kept.exists() else (SELECTOR, GHOSTS)
        self._compiling = parts(setup)
        selector = [part for part in self._compiling if SELECTOR in part.nodes]
        self._others = [part for part in self._compiling if part not in selector]
        self._first = self._start(selector, check=True)
        self._running: list[tuple[Popen[str], tuple[str, ...]]] = [(self._first, first)]

    def _start(self, compiled: list[Part], check: bool) -> Popen[str]:
        asked = json.dumps([check, [[part.nodes, part.policy] for part in compiled]])
        command = [sys.executable, "-m", "pacman_env.ros.supervisor.warm_up", asked, self._setup.as_json()]
        return Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, text=True, start_new_session=True)

    def check(self) -> None:
        """Wait until what can be known to be wrong has been checked; ValueError for what is.

        Then begin with the other half of what is to be compiled, in a process of its own.
        """
        assert self._first.stdout is not None
        if not self._first.stdout.readline():
            self._first.wait()
            self._poll()
        if self._others:
            nodes = tuple(node for part in self._others for node in part.nodes)
            self._running.append((self._start(self._others, check=False), nodes))

    def holds(self, name: str) -> bool:
        """Whether a process waits for what is being prepared; ValueError where that shows what is wrong."""
        self._poll()
        if name == LOCK_STEP:
            return bool(self._running)
        return (GHOSTS if name == COMPOSED else name) in self._waiting()

    @property
    def words(self) -> str:
        """What is compiled now; empty if nothing is."""
        self._poll()
        waiting = self._waiting()
        names = [node for part in self._compiling for node in part.nodes if node in waiting]
        return f"compiling (once): {', '.join(names)}" if names else ""

    def close(self) -> None:
        end({", ".join(nodes): process for process, nodes in self._running}, 2.0)
        for process, _ in self._running:
            _close(process)
        self._running.clear()

    def _waiting(self) -> set[str]:
        done = {node for part in self._compiling if part.mark and part.mark.exists() for node in part.nodes}
        return {
            node for process, nodes in self._running for node in nodes if node not in done or process is self._first
        }

    def _poll(self) -> None:
        for process, nodes in list(self._running):
            if (status := process.poll()) is None:
                continue
            self._running.remove((process, nodes))
            words = process.stderr.read().strip().rpartition("\n")[2] if process.stderr else ""  # after warnings
            _close(process)
            if status == BAD_START:
                raise ValueError(words)
            if status:  # the nodes compile for themselves, and report what is wrong
                self._report(f"{', '.join(nodes)}: compiling ended with status {status}")


def _close(process: Popen[str]) -> None:
    for pipe in (process.stdout, process.stderr):
        if pipe is not None:
            pipe.close()
