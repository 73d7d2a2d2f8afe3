"""Firefox by WebDriver BiDi over its own websocket: Playwright drives only a Firefox that it has built."""

import base64
import json
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import connect

from tests.waiting import PATIENCE_S

FIREFOX = ("firefox-esr", "firefox")
_OFFLINE = """
user_pref("app.normandy.enabled", false);
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("media.autoplay.default", 0);
user_pref("network.captive-portal-service.enabled", false);
user_pref("network.connectivity-service.enabled", false);
user_pref("services.settings.server", "data:,#remote-settings-dummy/v1");
"""


class Firefox:
    """A new Firefox without a screen, as a context manager; ``errors`` and ``urls`` are those of its pages."""

    def __init__(self, program: str) -> None:
        self._program = program
        self.errors: list[str] = []
        self.urls: list[str] = []
        self._count = 0

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            folder = opened.enter_context(tempfile.TemporaryDirectory(prefix="firefox-", ignore_cleanup_errors=True))
            (Path(folder) / "user.js").write_text(_OFFLINE)
            command = [self._program, "--headless", "--remote-debugging-port=0", "--no-remote", "--profile", folder]
            process = opened.enter_context(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
            opened.callback(process.terminate)
            assert process.stderr is not None
            address = next(line for line in process.stderr if "BiDi listening on" in line).split()[-1]
            self._socket = opened.enter_context(connect(address + "/session", max_size=None, proxy=None))
            self.send("session.new", capabilities={})
            self.send("session.subscribe", events=["log.entryAdded", "network.beforeRequestSent"])
            self.context = self.send("browsingContext.getTree")["contexts"][0]["context"]
            self._opened = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def send(self, method: str, **parameters: Any) -> Any:
        """Return the result of a command of BiDi."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while (message := json.loads(self._socket.recv(PATIENCE_S))).get("id") != self._count:
            event = message.get("params", {})
            if message.get("method") == "network.beforeRequestSent":
                self.urls.append(event["request"]["url"])
            elif event.get("level") == "error":
                self.errors.append(event["text"])
        assert message["type"] == "success", f"{method}: {message}"
        return message["result"]

    def open(self, url: str, width: int = 1280, height: int = 800) -> None:
        self.send("browsingContext.setViewport", context=self.context, viewport={"width": width, "height": height})
        self.send("browsingContext.navigate", context=self.context, url=url, wait="complete")

    def value(self, expression: str) -> Any:
        """Return the value of an expression, or of its promise."""
        target, text = {"context": self.context}, f"(async () => JSON.stringify(await ({expression})))()"
        answer = self.send("script.evaluate", expression=text, target=target, awaitPromise=True, userActivation=True)
        assert answer["type"] == "success", f"{expression}: {answer['exceptionDetails']['text']}"
        return json.loads(answer["result"].get("value", "null"))

    def wait(self, expression: str) -> Any:
        """Return the value of an expression as soon as it is true."""
        end = time.monotonic() + PATIENCE_S
        while not (value := self.value(expression)):
            assert time.monotonic() < end, f"never: {expression}"
            time.sleep(0.025)
        return value

    def press(self, selector: str) -> None:
        self.value(f"document.querySelector({json.dumps(selector)}).click()")

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.send("browsingContext.captureScreenshot", context=self.context)["data"]))
