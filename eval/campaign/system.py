"""The processes of a game with a simulated robot, and the recorder beside them, as one thing that starts and stops.

Also what can be seen of the processes from outside: whether they live, what they log, how long they wait for a core.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections import defaultdict
from collections.abc import Collection, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pacman_env.ros.discovery import stay_on_this_machine
from pacman_env.ros.supervisor.game_nodes import (
    REFEREE,
    SELECTOR,
    SIMULATOR,
    STOP_ORDER,
    WAIT,
    GameSetup,
    full_namespace,
)
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup

START_WALL_S = 300.0  # the first system compiles
_BAD_WORDS = re.compile(r"Traceback|Error raised|\[ERROR\]|\[FATAL\]|terminate called|SystemError")


def require_ros() -> None:
    """Raise ValueError where ROS is absent."""
    if find_spec("rclpy") is None:
        raise ValueError("this needs ROS 2 Jazzy: see docs/robot.md")


def confine(folder: Path, domain: int | None) -> None:
    """Keep what this process starts and hears on this machine, in a domain (None: as it is), its logs in a folder."""
    if domain is not None:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
    stay_on_this_machine()
    os.environ["ROS_LOG_DIR"] = str(folder)


def first_domain() -> int:
    """The domain of the first of several systems, unless one is given."""
    return int(os.environ.get("ROS_DOMAIN_ID", "1"))


class Lateness:
    """The waiting of processes, this one included, for a core: how long, wall s, and when, ns.

    Args:
        processes: their ids.
        proc: where Linux tells of processes; where it does not, nobody waited.
    """

    LOOK_S = 0.1
    STARVED = 0.9  # share of a look's time: less is taking turns

    def __init__(self, processes: Collection[int], proc: Path = Path("/proc")) -> None:
        self._files = [proc / str(process) / "schedstat" for process in (*processes, os.getpid())]
        self._waited: dict[Path, float] = {}
        self._streak: defaultdict[Path, float] = defaultdict(float)
        self._looked_s = time.monotonic()
        self.lags: list[tuple[int, float]] = []

    def look(self) -> None:
        """To be called often."""
        passed_s = time.monotonic() - self._looked_s
        if passed_s < self.LOOK_S:
            return
        self._looked_s += passed_s
        for file in self._files:
            with contextlib.suppress(OSError, ValueError, IndexError):
                waited = int(file.read_text().split()[1]) * 1e-9
                more = waited - self._waited.get(file, waited)
                self._waited[file] = waited
                self._streak[file] = self._streak[file] + more if more > self.STARVED * passed_s else 0.0
                if self._streak[file] > 0.0:
                    self.lags.append((time.time_ns(), self._streak[file]))


def bad_lines(text: str) -> list[str]:
    """Lines that no node may log: errors, exceptions that nobody caught, and the middleware's last words."""
    return [line.strip()[:300] for line in text.splitlines() if _BAD_WORDS.search(line)]


class System:
    """All processes of a game over the simulated robot, and the recorder; ``with`` starts and stops them.

    Args:
        map_yaml: of the ground that is played on.
        seed: of robot and ghosts.
        speed: of simulated time.
        folder: for the logs.
        settings: of the configuration, ``name=value``.
        preset: likewise.
    """

    def __init__(
        self,
        map_yaml: str,
        seed: int,
        speed: float,
        folder: Path,
        settings: Sequence[str] = (),
        preset: str = "robot",
    ) -> None:
        extra: dict[str, Any] = {
            SIMULATOR: {"seed": seed},
            "clyde_ghost_node": {"seed": seed},
            REFEREE: {"state_file": ""},
        }
        self._setup = GameSetup(
            map_yaml, "nearest", sim=True, speed=speed, preset=preset, settings=tuple(settings), extra=extra
        )
        self.folder = folder
        self._read: dict[Path, int] = {}  # bytes of the logs
        self.said: list[str] = []  # by the process group

    def __enter__(self) -> System:
        from pacman_env.ros.supervisor.up import environment

        from .recorder import Recorder

        surroundings = {**os.environ, **environment(self._setup, None)}
        self._processes = ProcessGroup(self._setup.command, self.folder, surroundings, self.said.append)
        self.recorder = Recorder(full_namespace(self._setup.namespace))
        try:
            for name in self._setup.first_nodes:
                self._processes.start(name)
            if not self.recorder.wait_for(lambda: self._processes.status(WAIT) is not None, START_WALL_S):
                raise Lost(f"the robot is not localized: {self._processes.last_words(SIMULATOR)}")
            self._processes.dismiss(WAIT)
            self._processes.start(SELECTOR)
            if not self.recorder.wait_for(lambda: self.recorder.ready() or self._processes.tend(), START_WALL_S):
                raise Lost(f"the game does not come up, see {self.folder}")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *failure: object) -> None:
        self.said += [f"{name} did not stop and was killed" for name in self._processes.stop(STOP_ORDER)]
        self.recorder.close()

    def troubles(self) -> list[str]:
        """Processes that have ended, and bad lines in the logs, since the last call."""
        try:
            found = [f"{name} ended" for name in self._processes.tend()]
        except Lost as lost:
            found = [str(lost)]
        found += self.said
        self.said.clear()
        for path in sorted(self.folder.glob("*.log")):
            text = path.read_bytes()
            new = text[self._read.get(path, 0) :].decode(errors="replace")
            self._read[path] = len(text)
            found += [f"{path.stem}: {line}" for line in bad_lines(new)]
        return found

    def lateness(self) -> Lateness:
        """Of its processes, from now on."""
        return Lateness(self._processes.ids().values())
