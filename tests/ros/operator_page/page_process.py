"""A whole game in processes, the page as one more, and a connection to it as a browser's."""

from __future__ import annotations

import contextlib
import json
import socket
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.messages import seconds_of
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR
from pacman_env.web.frame import Frame
from tests.ros.game_processes import GameProcesses
from tests.ros.system import NAMESPACE, PATIENCE_S, Probe, Process, System
from tests.web.frames import decode

MAP = "loop"
START_S = 240.0  # the first nodes may have to compile
STILL_MPS, STILL_RADPS = 0.005, 0.02
SETTINGS = ["clyde.speed_mps=0.02", "show.start_s=1", "show.death_s=1"]
OWN: dict[str, dict[str, Any]] = {
    SIMULATOR: {"speed": 3.0},
    SELECTOR: {"policy": "nearest", "home": "[0.0, 0.0, 0.0]", "diagnostics_rate": 5.0},
}


@contextlib.contextmanager
def free_port() -> Iterator[int]:
    """A port that no other program is given meanwhile; the page can still be bound to it."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the page's server has it
        one.bind(("127.0.0.1", 0))
        yield int(one.getsockname()[1])


class Nodes(GameProcesses):
    """All nodes of a game, and the page."""

    def __init__(self, probe: Probe, system: System) -> None:
        super().__init__(probe, system, MAP, SETTINGS, OWN)
        self.pages: list[Page] = []  # at most one, which tests pass on
        probe.record(topics.CMD_VEL, topics.ODOMETRY, topics.OPERATOR_STOP, topics.GAME_STATE, topics.DIAGNOSTICS)

    def page(self) -> Page:
        """The page that an earlier test has left, or a new one."""
        if not self.pages:
            self.pages.append(Page(self))
        return self.pages[0]

    def close(self) -> None:
        for page in self.pages[:]:
            page.kill()
        self.kill_all()

    def first_still(self, topic: topics.Topic, twist: Callable[[Any], Any], since: float) -> float | None:
        """When a topic first said after an instant that nothing turns; ``time.monotonic`` s."""
        for heard in self.probe.heard(topic):
            it = twist(heard.message)
            if heard.at > since and abs(it.linear.x) < STILL_MPS and abs(it.angular.z) < STILL_RADPS:
                return heard.at
        return None

    def measured(self, stop: Callable[[], object]) -> float:
        """From a call to the first zero velocity on the wire, s; the robot stands when this returns."""
        self.probe.forget()
        began = time.monotonic()
        stop()
        at = self.wait(lambda: self.first_still(topics.CMD_VEL, lambda m: m.twist, began), "zero velocity")
        self.wait(lambda: self.first_still(topics.ODOMETRY, lambda m: m.twist.twist, began), "a standstill")
        return at - began

    def condition(self) -> dict[str, Any]:
        """What the goal selector said of itself last."""
        return dict(json.loads((self.probe.values(topics.DIAGNOSTICS) or ["{}"])[-1]))

    def stands(self) -> bool:
        """By the last odometry."""
        twist = self.probe.messages(topics.ODOMETRY)[-1].twist.twist
        return abs(twist.linear.x) < STILL_MPS and abs(twist.angular.z) < STILL_RADPS

    def pass_s(self, seconds: float) -> None:
        """Let so much simulated time pass, by the odometry: for what must not happen meanwhile."""

        def last_s() -> float:
            return seconds_of(self.probe.messages(topics.ODOMETRY)[-1].header.stamp)

        self.wait(lambda: self.probe.messages(topics.ODOMETRY), "odometry")
        end_s = last_s() + seconds
        self.wait(lambda: last_s() >= end_s, f"{seconds:g} s of simulated time")

    def start_all_once(self) -> None:
        """The game is up, whichever test came first."""
        if not self.processes:
            self.start_all()
        ready = {"active": True, "nav2": True}
        self.wait(lambda: ready.items() <= self.condition().items(), "the goal selector", START_S)


class Page:
    """The process, and what it has sent to one browser."""

    def __init__(self, nodes: Nodes) -> None:
        self.nodes = nodes
        self._open = contextlib.ExitStack()
        self.port = self._open.enter_context(free_port())
        words = ["--namespace", NAMESPACE.strip("/"), "--sim", "--map", MAP, "--port", str(self.port)]
        self.process: Process = nodes.system.fork("page", "pacman_env.ros.operator_page.__main__", *words)
        nodes.wait(self._there, "the page", START_S)
        from websockets.sync.client import connect

        where = f"127.0.0.1:{self.port}"
        self._socket = self._open.enter_context(
            connect(f"ws://{where}/ws", origin=f"http://{where}", close_timeout=0.2)  # a killed page does not answer
        )
        self.frame: Frame | None = None
        self.texts: list[dict[str, Any]] = []
        self._id = 0

    def _there(self) -> bool:
        assert self.process.popen.poll() is None, self.process.output
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/health", timeout=5) as answer:
                return bool(json.load(answer)["ok"])
        except OSError:
            return False

    def read(self) -> None:
        """What has come."""
        while True:
            try:
                message = self._socket.recv(timeout=0)
            except TimeoutError:
                return
            text = json.loads(message)
            if text["kind"] == "frame":
                self.frame = decode(message)
            else:
                self.texts.append(text)

    def wait(self, condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
        def looked() -> Any:
            self.read()
            return condition()

        return self.nodes.wait(looked, what, timeout_s)

    def send(self, do: str, **fields: Any) -> None:
        self._socket.send(json.dumps({"do": do, **fields}))

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        self._id += 1
        number = self._id
        self.send(do, id=number, **fields)

        def answer() -> dict[str, Any] | None:
            return next((one for one in self.texts if one["kind"] == "answer" and one["id"] == number), None)

        return dict(self.wait(answer, f"the answer to {do}"))

    def words(self) -> list[str]:
        news = [item for one in self.texts if one["kind"] == "news" for item in one["items"]]
        return [item["words"] for item in news if "words" in item]

    def scene(self) -> dict[str, Any]:
        """The last."""
        return next((one for one in reversed(self.texts) if one["kind"] == "scene"), {})

    def notice(self) -> str:
        return str(self.scene().get("notice", ""))

    def drives(self) -> bool:
        return self.frame is not None and abs(self.frame.velocity[0]) > 0.1

    def until_it_drives(self) -> None:
        """The robot drives in a round, not home after one: where a round has ended meanwhile, in the next one."""

        def drives() -> bool:
            if self.frame is not None and self.frame.state == "menu" and not self.frame.stopped:
                self.ask("start")
            return self.frame is not None and self.frame.state == "running" and self.drives()

        self.wait(drives, "the robot to drive")

    def kill(self) -> None:
        self.process.popen.kill()
        self.process.popen.wait()
        self.nodes.system.processes.remove(self.process)
        self.nodes.pages.remove(self)
        self._open.close()
