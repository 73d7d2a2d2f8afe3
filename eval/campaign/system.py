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
from pacman_env.ros.standstill import STOOD_STILL
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

from .schedule import LEASE_S

FIRST_POLICY = "nearest"  # of the goal selector, until a game asks for its own
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


def write_middleware_profile(path: Path, speed: float) -> Path:
    """FastDDS's own times, divided by the clock's speed as all others: the lease of 20 s, announcements and heartbeats.

    A node that is away for as long as it was drawn, divided likewise, is then forgotten when it would be on a robot.
    """
    announcement_s, heartbeat_s = 3.0, 3.0

    def duration(tag: str, seconds: float) -> str:
        whole, part = divmod(round(seconds / speed * 1e9), 10**9)
        return f"<{tag}><sec>{whole}</sec><nanosec>{part}</nanosec></{tag}>"

    path.write_text(f"""<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="campaign_participant" is_default_profile="true">
    <rtps><builtin><discovery_config>
      {duration("leaseAnnouncement", announcement_s)}
      {duration("leaseDuration", LEASE_S)}
    </discovery_config></builtin></rtps>
  </participant>
  <data_writer profile_name="campaign_writer" is_default_profile="true">
    <times>{duration("heartbeatPeriod", heartbeat_s)}</times>
  </data_writer>
</profiles>
""")
    return path


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
        self._proc = proc
        self._files: list[Path] = []
        self.watch((*processes, os.getpid()))
        self._waited: dict[Path, float] = {}
        self._streak: defaultdict[Path, float] = defaultdict(float)
        self._looked_s = time.monotonic()
        self.lags: list[tuple[int, float]] = []

    def watch(self, processes: Collection[int]) -> None:
        """Look at these, too."""
        files = [self._proc / str(process) / "schedstat" for process in processes]
        self._files += [file for file in files if file not in self._files]

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
            REFEREE: {"state_file": str(folder / "game_controller.json")},
        }
        self._setup = GameSetup(
            map_yaml, FIRST_POLICY, sim=True, speed=speed, preset=preset, settings=tuple(settings), extra=extra
        )
        self.folder, self.speed = folder, speed
        self._read: dict[Path, int] = {}  # bytes of the logs
        self.said: list[str] = []  # by the process group
        self.killed: set[str] = set()  # nodes whose death is no trouble
        self._troubles: list[str] = []

    def __enter__(self) -> System:
        from pacman_env.ros.supervisor.up import environment

        from .recorder import Recorder

        surroundings = {**os.environ, **environment(self._setup, None)}
        self._processes = ProcessGroup(self._setup.command, self.folder, surroundings, self.said.append)
        self.recorder = Recorder(full_namespace(self._setup.namespace))
        try:
            for name in self._setup.first_nodes:
                self._processes.start(name)
            if not self.recorder.wait_for(
                lambda: self._processes.status(WAIT) is not None or self.tend(), START_WALL_S
            ):
                raise Lost(f"the robot is not localized: {self._processes.last_words(SIMULATOR)}")
            if self._troubles:
                raise Lost("; ".join(self._troubles))
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

    def tend(self) -> list[str]:
        """Have nodes that died started again; those that were found dead now. To be called often."""
        try:
            dead = self._processes.tend()
        except Lost as lost:
            self._troubles.append(str(lost))
            return []
        for name in dead:
            thawed = f"{name} ended with status {STOOD_STILL}: "  # as it has to, after a standstill
            if name in self.killed or any(line.startswith(thawed) for line in self.said):
                self.killed.discard(name)
                expected = f"{name} ended with status -9: ", thawed
                self.said[:] = [line for line in self.said if not line.startswith(expected)]
            else:
                self._troubles.append(f"{name} ended")
        return dead

    def ids(self) -> dict[str, int]:
        """The processes of the nodes."""
        return self._processes.ids()

    def troubles(self) -> list[str]:
        """Processes that have ended unexpectedly, and bad lines in the logs, since the last call."""
        self.tend()
        found = self._troubles + self.said
        self._troubles.clear()
        self.said.clear()
        for path in sorted(self.folder.glob("*.log")):
            text = path.read_bytes()
            new = text[self._read.get(path, 0) :].decode(errors="replace")
            self._read[path] = len(text)
            found += [f"{path.stem}: {line}" for line in bad_lines(new)]
        return found

    def lateness(self) -> Lateness:
        """Of its processes, from now on."""
        return Lateness(self.ids().values())
