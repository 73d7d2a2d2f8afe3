"""Run a student's file and send its answers to the grader, as plain data: ``python child.py FILE SOCKET LIMIT_S``.

student.py is the other end of the socket. Nothing here decides about points, so a file that changes this process can
only send wrong answers. A message is a JSON object and numeric arrays.
"""

import contextlib
import importlib.util
import json
import linecache
import re
import resource
import socket
import struct
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pacman_env import BasePolicy, Situation, make_config
from pacman_env.episodes.rollout import open_games
from pacman_env.evaluation.rounds.scenarios import open_scenario
from pacman_env.policies.policy_calls import PolicyError, choose, reset, scores

MAP = "house"
LENGTHS = struct.Struct("<QQ")  # bytes of the object and of the arrays
MOST_BYTES = 2**28
MOST_TEXT = 2000
Message = tuple[dict[str, Any], list[np.ndarray]]


def packed(facts: dict[str, Any], arrays: Sequence[np.ndarray] = ()) -> bytes:
    """Return a message as bytes; raises TypeError for arrays that contain no numbers."""
    for array in arrays:
        if array.dtype.kind not in "biufc":
            raise TypeError(f"expected numbers, got an array of {array.dtype}")
    head = json.dumps({**facts, "arrays": [(array.dtype.str, array.shape) for array in arrays]}).encode()
    body = b"".join(array.tobytes() for array in arrays)
    return LENGTHS.pack(len(head), len(body)) + head + body


def unpacked(head: bytes, body: bytes) -> Message:
    """Return a message; raises an exception if it does not come from :func:`packed`."""
    facts, arrays, at = json.loads(head), [], 0
    for code, shape in facts.pop("arrays"):
        if (dtype := np.dtype(code)).kind not in "biufc":
            raise TypeError(f"expected numbers, got an array of {dtype}")
        arrays.append(np.ndarray(shape, dtype, body, at).copy())
        at += arrays[-1].nbytes
    return facts, arrays


def receive(channel: socket.socket, may_wait: Callable[[], bool] = lambda: True) -> Message:
    """Return the next message; raises EOFError if the channel is closed, TimeoutError if it ``may_wait`` no longer."""

    def read(size: int) -> bytes:
        if size > MOST_BYTES:
            raise ValueError(f"expected an answer of at most {MOST_BYTES} bytes, got {size}")
        data = bytearray()
        while len(data) < size:
            try:
                part = channel.recv(min(size - len(data), 2**20))
            except TimeoutError:
                if may_wait():
                    continue
                raise
            if not part:
                raise EOFError
            data += part
        return bytes(data)

    head, body = LENGTHS.unpack(read(LENGTHS.size))
    return unpacked(read(head), read(body))


def load(path: Path) -> ModuleType:
    """Import a file under a name of its own."""
    spec = importlib.util.spec_from_file_location(name := f"exercise_file_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def explain(error: BaseException, path: Path) -> str:
    """Return what went wrong in the student's file, with the last line of the file that was reached."""
    if isinstance(error, PolicyError) and error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, NotImplementedError):
        return "not written yet"
    if isinstance(error, Absent):
        return str(error)
    lines = [call.lineno for call in traceback.extract_tb(error.__traceback__) if call.filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines, error = [error.lineno], SyntaxError(error.msg)
    if isinstance(error, PolicyError) and (name := re.search(r":(\w+)'", str(error))):  # scores of a wrong shape, NaN
        code = linecache.getlines(str(path))  # in the encoding that the file declares
        lines = [at for at, line in enumerate(code, 1) if re.match(rf"class {name[1]}\b", line)]
    text = f"{type(error).__name__}: {error}"
    if isinstance(error, ModuleNotFoundError) and error.name in ("torch", "stable_baselines3", "sb3_contrib"):
        text += ": task 5 needs PyTorch, see README.md"
    if not lines:
        return text[:MOST_TEXT]
    return f"{text[:MOST_TEXT]}\n{path.name}, line {lines[-1]}: {linecache.getline(str(path), lines[-1] or 0).strip()}"


class Absent(Exception):
    """Raised if the file lacks a class or function."""


class Answers:
    """The student's file, with the policy or model that it created; each method answers one question."""

    def __init__(self, path: Path) -> None:
        config = make_config()
        batch, _ = open_games(open_scenario(MAP, config), config)
        self._path, self._config, self._maps = path, config, batch.levels
        self._module: ModuleType | None = None
        self._thing: Any = None

    def load(self) -> Message:
        """Import the file."""
        self._module = load(self._path)
        return {}, []

    def bases(self, name: str) -> Message:
        """Return the modules and classes that a class derives from."""
        kind = self._named(name)
        bases = kind.__mro__ if isinstance(kind, type) else ()
        return {"bases": [(base.__module__, base.__qualname__) for base in bases], "text": repr(kind)[:MOST_TEXT]}, []

    def create(self, name: str) -> Message:
        """Create a policy, and return whether it has no state."""
        self._thing = self._named(name)()
        return {"stateless": type(self._thing).reset is BasePolicy.reset}, []

    def reset(self, games: np.ndarray) -> Message:
        """Reset the policy in these games (N,)."""
        reset(self._thing, games, self._config)
        return {}, []

    def scores(self, *arrays: np.ndarray) -> Message:
        """Return the policy's scores (N, C) in a situation."""
        return {}, [scores(self._thing, self._situation(arrays))]

    def select(self, *arrays: np.ndarray) -> Message:
        """Return the policy's candidates (N,) in a situation."""
        return {}, [np.asarray(choose(self._thing, self._situation(arrays)))]

    def call(self, name: str, *arrays: np.ndarray) -> Message:
        """Return the arrays that a function returns, and the situation after the call."""
        got = self._named(name)(situation := self._situation(arrays))
        parts = [np.asarray(part) for part in got] if isinstance(got, tuple) else []
        return {"text": repr(got)[:MOST_TEXT]}, [*situation.arrays(), *parts]

    def train(self, name: str) -> Message:
        """Return whether the model of a function can predict."""
        self._thing = self._named(name)()
        return {"predicts": callable(getattr(self._thing, "predict", None)), "text": repr(self._thing)[:MOST_TEXT]}, []

    def predict(self, observation: np.ndarray, masks: np.ndarray) -> Message:
        """Return the model's actions (N,)."""
        actions = self._thing.predict(observation, action_masks=masks, deterministic=True)[0]
        return {}, [np.asarray(actions)]

    def _named(self, name: str) -> Any:
        if not callable(thing := getattr(self._module, name, None)):
            raise Absent(f"expected a class or function {name!r} in the file, found none")
        return thing

    def _situation(self, arrays: tuple[np.ndarray, ...]) -> Situation:
        return Situation(*arrays, maps=self._maps)


def limit(seconds: float) -> None:
    """Let the system kill this process after some more seconds of processor time."""
    last = int(time.process_time() + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (last, last))
    with contextlib.suppress(OSError):  # if memory runs out, Linux kills this process first
        Path("/proc/self/oom_score_adj").write_text("1000")


def main(path: Path, channel: socket.socket, limit_s: float) -> None:
    """Answer until the grader closes the socket."""
    answers, clock = Answers(path), time.process_time
    limit(limit_s)
    channel.sendall(packed({}))  # ready
    while True:
        try:
            facts, arrays = receive(channel)
        except EOFError:
            return
        try:
            facts, arrays = getattr(answers, facts.pop("question"))(*facts.pop("names"), *arrays, **facts)
            answer = packed({**facts, "processor_s": clock()}, arrays)
        except BaseException as error:  # of the student's code, SystemExit and KeyboardInterrupt included
            try:
                text = explain(error, path)
            except BaseException:  # an exception may be unable to print itself
                text = type(error).__name__
            answer = packed({"error": text})
        channel.sendall(answer)


if __name__ == "__main__":
    main(Path(sys.argv[1]), socket.socket(fileno=int(sys.argv[2])), float(sys.argv[3]))
