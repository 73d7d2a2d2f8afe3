"""Ask policies in a child process, which is ended and started again if it is late, raises or dies.

No code of a policy runs in the process of the game, so nothing that a policy does delays a stop.
"""

import contextlib
import math
import multiprocessing
import os
import socket
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.context import ForkProcess

import msgspec
import numpy as np

from pacman_env.config import make_config
from pacman_env.engine.cache_folder import is_compiled
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView
from pacman_env.observations.situation import Situation
from pacman_env.ros.heartbeat import HEART, LONG_S, WAITING, main_thread
from pacman_env.ros.memory import release_memory
from pacman_env.ros.selector import policy_child
from pacman_env.ros.selector.policy_child import ROBOT, SLOW_S, Answer, PolicySetup, Question, encode
from pacman_env.sim.ghost_state import MapGhosts
from pacman_env.world.maps.occupancy import OccupancyMap

_STARTS_S = 250.0  # longest first start, which may compile
_RESTARTS_S = 30.0
_LONGEST_PAUSE_S = 10.0  # before a new start; it doubles with each failure within ``_SOON_S``
_SOON_S = 60.0
_ENDS_S = 0.05  # longest wait for the end of a killed child, or for the rest of an answer
_ROOM = 100  # cells


Child = ForkProcess | subprocess.Popen[bytes]
#: Children that were forked before ROS had threads, and wait for their setup.
_SPARE: list[tuple[Child, Connection]] = []
_ENDING: list[Child] = []  # killed, but not ended within ``_ENDS_S``; each close reaps them


def fork_spare() -> None:
    """Fork the first child, which shares this process's memory; only before ROS is initialized."""
    if is_compiled():  # otherwise a policy that cannot be used is refused before anything is compiled
        _load_kernels()
    release_memory()  # also spares these objects from garbage collection, which would copy their pages
    ours, theirs = _pipe()
    child = multiprocessing.get_context("fork").Process(target=_serve, args=(ours, theirs), daemon=True)
    child.start()
    theirs.close()
    _SPARE.append((child, ours))


def _serve(ours: Connection, theirs: Connection) -> None:
    ours.close()
    os.setsid()
    multiprocessing.current_process().daemon = False  # a policy may start processes, which a daemon may not
    sys.exit(policy_child.serve(theirs))


def _status(child: Child) -> int | None:
    """Return the exit status, negative for a signal; None while the child runs."""
    return child.exitcode if isinstance(child, ForkProcess) else child.poll()


def _load_kernels() -> None:
    """Load the kernels on a small map, because the child then shares their memory and time."""
    room = np.full((_ROOM, _ROOM), 254, np.uint8)
    room[[0, -1]] = room[:, [0, -1]] = 0
    config = make_config()
    assets = map_assets(OccupancyMap.from_pixels("room", room, 0.05, (0.0, 0.0, 0.0)), config)
    RobotView(assets, config).compile_kernels()
    MapGhosts(assets, config, 0).compile_kernels()


def _pipe() -> tuple[Connection, Connection]:
    """Return both ends, of which reads and writes of the first do not block for long."""
    ours, theirs = socket.socketpair()
    for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
        ours.setsockopt(socket.SOL_SOCKET, option, struct.pack("ll", 0, int(_ENDS_S * 1e6)))
    return Connection(ours.detach()), Connection(theirs.detach())


def _started() -> tuple[Child, Connection]:
    ours, theirs = _pipe()
    command = [sys.executable, "-m", policy_child.__name__, str(theirs.fileno())]
    process = subprocess.Popen(command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, start_new_session=True)
    theirs.close()
    return process, ours


class PolicyProcess:
    """Child process with the policies of a setup.

    ``report`` is called with a trouble's text, and with "" once the policy answers again.
    """

    def __init__(self, setup: PolicySetup, report: Callable[[str], None]) -> None:
        self.setup, self._report = setup, report
        self.version = ""
        self.refusal = ""  # why the policies cannot be used
        self.ready = False
        self.restarts = 0
        self.times_ms: deque[float] = deque(maxlen=1000)
        self._open: deque[tuple[float, float]] = deque()  # time and processor time of the child at each open question
        self._number = 0
        self._failures_s: deque[float] = deque(maxlen=8)
        self._due_s = math.inf  # time of the next start
        self._failed = False
        self._start()

    def _start(self) -> None:
        self.process: Child
        self.process, self._pipe = _SPARE.pop() if _SPARE else _started()
        self.ready, self._due_s = False, math.inf
        self._open.append((time.monotonic(), 0.0))  # the answer says that it is ready
        with contextlib.suppress(OSError):  # ``poll`` notices that the child has ended
            self._pipe.send_bytes(encode(self.setup))

    @property
    def is_busy(self) -> bool:
        """True while ``poll`` must be called: a question is open, or the child is starting."""
        return bool(self._open) or not self.ready

    def wait(self) -> None:
        """Wait until the policies can be asked; raises ValueError if they cannot be used. Only in the main thread."""
        deadline = time.monotonic() + _STARTS_S
        while not self.ready:
            HEART.beat(LONG_S)
            self.poll(0.05)
            if self._failed or time.monotonic() > deadline:
                reason = self.refusal or f"policy {self.setup.policy!r}: its process ended at the start"
                self.close()
                raise ValueError(reason)

    def ask(self, player: int, situation: Situation, begins: bool, scores: bool = False, why: bool = False) -> int:
        """Send a question and return its number, only if ``ready``; ``poll`` returns the answers in order."""
        arrays = [np.ascontiguousarray(array).tobytes() for array in situation.arrays()]
        self._number += 1
        self._open.append((time.monotonic(), main_thread(self.process.pid or 0)[1]))
        with contextlib.suppress(OSError):  # ``poll`` notices that the child has ended
            self._pipe.send_bytes(encode(Question(self._number, player, begins, arrays, scores, why)))
        return self._number

    def poll(self, wait_s: float = 0.0) -> Answer | None:
        """Return the next answer, None so far; an answer with an ``error`` is a failure, and no others will come.

        Restarts a child that has ended, is late or has raised.
        """
        if time.monotonic() >= self._due_s:
            self.restarts += 1
            self._start()
        if not self._open:
            if self.ready and self._pipe.poll():  # the child has ended without a question
                self._restart()
            return None
        try:
            has_answer = self._pipe.poll(wait_s)
            answer = msgspec.msgpack.decode(self._pipe.recv_bytes(), type=Answer) if has_answer else None
        except (EOFError, OSError, msgspec.MsgspecError):
            return self._fail(f"its process {self._end_words()}")
        if answer is None:
            limit_s = SLOW_S if self.ready else _RESTARTS_S if self._number else _STARTS_S
            return self._fail(f"takes more than {limit_s:g} s to choose") if self._is_late(limit_s) else None
        self._open.popleft()
        if answer.error:
            self.refusal = "" if self.ready else answer.error
            return self._fail(answer.error)
        if not self.ready:
            self.ready, self.version = True, answer.version
            return None
        if answer.player == ROBOT:
            self.times_ms.append(answer.elapsed_ms)
            self._report("")
        return answer

    def _is_late(self, limit_s: float) -> bool:
        """Return True if the answer is late; while the child waits for a processor, only its processor time counts."""
        asked_s, busy_before_s = self._open[0]
        if time.monotonic() - asked_s <= limit_s:
            return False
        state, busy_s = main_thread(self.process.pid or 0)
        return state not in WAITING or busy_s - busy_before_s > limit_s

    def _end_words(self) -> str:
        status = self._await_end()
        if status is None:
            return "closed its pipe or sent half an answer"
        return f"ended with status {status}" if status >= 0 else f"ended by signal {-status}"

    def _await_end(self) -> int | None:
        """Return the exit status; None if the child does not end soon, such as while it waits for a device."""
        end_s = time.monotonic() + _ENDS_S
        while (status := _status(self.process)) is None and time.monotonic() < end_s:
            time.sleep(0.001)
        return status

    def _fail(self, words: str) -> Answer:
        """Report a failure, start the child again and return the failure as an answer."""
        name = f"policy {self.setup.policy!r}"
        text = words if words.startswith("policy ") else f"{name}: {words}"
        self._failed = True
        if self.restarts or self._number:  # otherwise ``wait`` raises the error
            self._report(f"{text}; the robot holds")
        self._restart()
        return Answer(error=text)

    def _restart(self) -> None:
        """End the child, and schedule its next start."""
        self.close()
        now = time.monotonic()
        recent = sum(now - since_s < _SOON_S for since_s in self._failures_s)
        self._failures_s.append(now)
        self._due_s = now + (min(2.0 ** (recent - 1), _LONGEST_PAUSE_S) if recent else 0.0)

    def close(self) -> None:
        """End the child at once."""
        self._open.clear()
        self.ready, self._due_s = False, math.inf
        self.process.kill()
        _ENDING[:] = [child for child in _ENDING if _status(child) is None]
        if self._await_end() is None:
            _ENDING.append(self.process)
        self._pipe.close()
