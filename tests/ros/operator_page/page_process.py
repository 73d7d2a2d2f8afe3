"""The page as a process of its own, and one who is connected to it as a browser is."""

from __future__ import annotations

import contextlib
import json
import socket
import sys
import urllib.request
from collections.abc import Callable
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.web.frame import Frame, decode
from tests.ros.operator_page.page_game import MAP, START_S, STILL_MPS, STILL_RADPS, Nodes
from tests.ros.system import NAMESPACE, PATIENCE_S, Process


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Page:
    """The process, and one browser: what it has been told."""

    def __init__(self, nodes: Nodes) -> None:
        self.nodes = nodes
        self.port = free_port()
        command = [sys.executable, "-m", "pacman_env.ros.operator_page", "--namespace", NAMESPACE.strip("/"), "--sim"]
        self.process: Process = nodes.system.run("page", [*command, "--map", MAP, "--port", str(self.port)])
        nodes.wait(self._there, "the page", START_S)
        from websockets.sync.client import connect

        self._open = contextlib.ExitStack()
        where = f"127.0.0.1:{self.port}"
        self._socket = self._open.enter_context(connect(f"ws://{where}/ws", origin=f"http://{where}"))
        self.frame: Frame | None = None
        self.told: list[dict[str, Any]] = []
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
            if isinstance(message, bytes):
                self.frame = decode(message)
            else:
                self.told.append(json.loads(message))

    def wait(self, condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
        def looked() -> Any:
            self.read()
            return condition()

        return self.nodes.wait(looked, what, timeout_s)

    def say(self, do: str, **fields: Any) -> None:
        self._socket.send(json.dumps({"do": do, **fields}))

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        self._id += 1
        number = self._id
        self.say(do, id=number, **fields)

        def answer() -> dict[str, Any] | None:
            return next((one for one in self.told if one["kind"] == "answer" and one["id"] == number), None)

        return dict(self.wait(answer, f"the answer to {do}"))

    def words(self) -> list[str]:
        news = [item for one in self.told if one["kind"] == "news" for item in one["items"]]
        return [item["words"] for item in news if "words" in item]

    def scene(self) -> dict[str, Any]:
        """The last."""
        return next((one for one in reversed(self.told) if one["kind"] == "scene"), {})

    def notice(self) -> str:
        return str(self.scene().get("notice", ""))

    def drives(self) -> bool:
        return self.frame is not None and abs(self.frame.velocity[0]) > 0.1

    def kill(self) -> None:
        self.process.popen.kill()
        self.process.popen.wait()
        self.nodes.system.processes.remove(self.process)
        self._open.close()


def condition(nodes: Nodes) -> dict[str, Any]:
    return dict(json.loads((nodes.probe.values(DIAGNOSTICS) or ["{}"])[-1]))


def stands(nodes: Nodes) -> bool:
    twist = nodes.probe.messages(topics.ODOMETRY)[-1].twist.twist
    return abs(twist.linear.x) < STILL_MPS and abs(twist.angular.z) < STILL_RADPS
