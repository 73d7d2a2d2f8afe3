"""A whole game in processes, on a clear map and with a Clyde who is no danger, and the page's side of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

from pacman_env.ros import topics
from pacman_env.ros.operator_page import open_game
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.ros.supervisor.game_nodes import GAME, SELECTOR, SIMULATOR, module_of
from pacman_env.web import messages
from pacman_env.web.frame import Frame
from tests.ros.system import NAMESPACE, PATIENCE_S, Probe, Process, System

MAP = "loop"
START_S = 240.0  # the first nodes may have to compile
STILL_MPS, STILL_RADPS = 0.005, 0.02
SETTINGS = ["clyde.speed_mps=0.02", "show.start_s=1", "show.death_s=1"]
OWN: dict[str, dict[str, Any]] = {
    SIMULATOR: {"map_yaml": MAP},
    "pellet_manager": {"map_yaml": MAP},
    "clyde_ghost_node": {"map_yaml": MAP},
    SELECTOR: {"map_yaml": MAP, "policy": "nearest", "home": "[0.0, 0.0, 0.0]", "diagnostics_rate": 5.0},
}
T = TypeVar("T")


class Nodes:
    """All nodes of a game, and a probe."""

    def __init__(self, probe: Probe, system: System) -> None:
        self.probe, self.system = probe, system
        self.processes: dict[str, Process] = {}
        probe.record(topics.CMD_VEL, topics.ODOMETRY, topics.OPERATOR_STOP, topics.GAME_STATE, DIAGNOSTICS)

    def start(self, name: str) -> None:
        own = OWN.get(name, {})
        self.processes[name] = self.system.start(module_of(name), use_sim_time=True, settings=SETTINGS, **own)

    def start_all(self) -> None:
        for name in (SIMULATOR, *GAME, SELECTOR):
            self.start(name)

    def kill(self, name: str) -> None:
        """As a crash does it: nothing is said."""
        process = self.processes.pop(name)
        process.popen.kill()
        process.popen.wait()
        self.system.processes.remove(process)

    def wait(self, condition: Callable[[], T], what: str, timeout_s: float = PATIENCE_S) -> T:
        return self.probe.wait_for(condition, timeout_s, what)

    def close(self) -> None:
        for name in list(self.processes):
            self.kill(name)

    def first_still(self, topic: topics.Topic, twist: Callable[[Any], Any], since: float) -> float | None:
        """When a topic first said after an instant that nothing turns; ``time.monotonic`` s."""
        for heard in self.probe.heard(topic):
            it = twist(heard.message)
            if heard.at > since and abs(it.linear.x) < STILL_MPS and abs(it.angular.z) < STILL_RADPS:
                return heard.at
        return None

    def measured(self, stop: Callable[[], object]) -> tuple[float, float]:
        """From a call to the first zero velocity on the wire, and to the wheels' standstill by odometry; s."""
        self.probe.forget()
        began = time.monotonic()
        stop()
        said = self.wait(lambda: self.first_still(topics.CMD_VEL, lambda m: m.twist, began), "zero velocity")
        stood = self.wait(lambda: self.first_still(topics.ODOMETRY, lambda m: m.twist.twist, began), "a standstill")
        return said - began, stood - began


class PageGame(Nodes):
    """With what the server would ask, in this process."""

    def __init__(self, probe: Probe, system: System) -> None:
        super().__init__(probe, system)
        self.page: Any = open_game(NAMESPACE, sim=True, map=MAP)

    def start_all(self) -> None:
        super().start_all()
        self.wait(lambda: self.ready, "the game", START_S)

    def close(self) -> None:
        self.page.close()
        super().close()

    @property
    def ready(self) -> bool:
        frame, facts = self.page.frame(), self.page.scene().facts
        there = frame is not None and frame.believed is not None and len(frame.ghosts) == 1 and frame.alive.any()
        return there and facts["candidates"] and facts["policy"] == "nearest" and self.obeyed

    @property
    def obeyed(self) -> bool:
        rows = self.page._stop_row()
        return all(name in rows["words"] for name in ("goal_selector", "game_event_mapper", "game_controller"))

    @property
    def frame(self) -> Frame:
        frame = self.page.frame()
        assert frame is not None
        return frame

    def tell(self, message: messages.Message) -> Any:
        """As guest-1, once a service knows this page: one that was started just now may drop its answer."""
        return self.page.tell("guest-1", message)

    def words(self, after: int = 0) -> list[str]:
        return [one["words"] for one in self.page.news(after) if "words" in one]

    def news_number(self) -> int:
        return max((one["number"] for one in self.page.news(0)), default=0)

    def menu(self) -> None:
        """Nothing goes on."""
        self.page.release("guest-1")
        self.page.left("guest-1")
        self.tell(messages.Reset())
        self.wait(lambda: self.frame.state == "menu" and not self.frame.stopped, "the menu")
        self.wait(lambda: self.stands, "the robot to stand")

    def round(self) -> None:
        """A round in which the robot drives."""
        if self.page.frame().state != "running":
            self.menu()
            self.tell(messages.Start())
        self.wait(lambda: self.frame.state == "running", "the round")
        self.wait(lambda: self.drives, "the robot to drive")

    @property
    def drives(self) -> bool:
        return abs(self.frame.velocity[0]) > 0.1

    @property
    def stands(self) -> bool:
        v, omega = self.frame.velocity
        return abs(v) < STILL_MPS and abs(omega) < STILL_RADPS

    def stop_measured(self) -> tuple[float, float]:
        """See ``measured``."""
        return self.measured(lambda: self.page.stop("guest-1"))
