"""All nodes of a simulated game as processes of their own, which tests kill and start again."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pacman_env.ros.supervisor.game_nodes import GAME, SELECTOR, SIMULATOR, module_of
from tests.ros.system import PATIENCE_S, Probe, Process, System

T = TypeVar("T")
WITH_MAP = (SIMULATOR, "pellet_manager", "clyde_ghost_node", SELECTOR)


class GameProcesses:
    """Starts and kills the nodes; the test takes the operator's part.

    Args:
        probe: hears and says everything.
        system: of the processes.
        map: as ``map_yaml`` takes it.
        settings: of every node.
        own: further parameters, by node.
    """

    def __init__(
        self, probe: Probe, system: System, map: str, settings: list[str], own: Mapping[str, Mapping[str, Any]]
    ) -> None:
        self.probe, self.system, self.map = probe, system, map
        self.processes: dict[str, Process] = {}
        self._settings, self._own = settings, own

    def start(self, name: str) -> None:
        own = {**self._own.get(name, {}), **({"map_yaml": self.map} if name in WITH_MAP else {})}
        self.processes[name] = self.system.start(module_of(name), use_sim_time=True, settings=self._settings, **own)

    def start_all(self) -> None:
        for name in (SIMULATOR, *GAME, SELECTOR):
            self.start(name)

    def kill(self, name: str) -> None:
        """End a process as a crash does it: without last messages."""
        process = self.processes.pop(name)
        process.popen.kill()
        process.popen.wait()
        self.system.processes.remove(process)

    def kill_all(self) -> None:
        for name in list(self.processes):
            self.kill(name)

    def wait(self, condition: Callable[[], T], what: str, timeout_s: float = PATIENCE_S) -> T:
        return self.probe.wait_for(condition, timeout_s, what)
