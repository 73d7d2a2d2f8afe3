"""Kills of real processes in a running game: ``python -m tests.system.kills --kills 200``.

``pacman-env ros up --sim --play-on`` plays round after round; its nodes are killed with SIGKILL, one at a time, in a
drawn order and at drawn moments. After each kill the node that is started again must receive from those that were
there before: what it publishes then depends on their messages (``_EFFECTS``). Every round that is completed must have
the right score. Middleware and processes are real, so the moments are not repeatable. Needs ROS.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.files import prepare, write_json
from pacman_env.ros.supervisor.game_nodes import (
    GAME,
    NAMESPACE,
    REFEREE,
    SELECTOR,
    SIMULATOR,
    full_namespace,
    module_of,
)
from tests.system.campaign.workers import require_ros

FAULT_STATUS = 1
NODES = (SIMULATOR, *GAME, SELECTOR)
TRANSPORTS = {"default": "", "udp": "UDPv4", "shm": "DEFAULT"}  # values of the variable below
TRANSPORT = "FASTDDS_BUILTIN_TRANSPORTS"  # of Fast DDS
START_S = 300.0  # the first start may compile
HANG_S = 180.0  # of real time, from a kill to a game that goes on; a busy machine needs a minute
REPAIR_S = 120.0  # then the node may be started again by itself; after that, this command kills it
_PAUSE_S = 2.0  # between a game that goes on and the next kill, at most
SETTINGS = ("clyde.speed_mps=0.02", "clyde.speed_step_mps=0.001", "show.start_s=1", "show.death_s=1")
_SIMULATED_PAUSE_S = 20.0  # as the last, in lock-step
_SIMULATED_HANG_S = 600.0
_MOVED, _GONE = "clyde has moved", "removed pellets are not shown"
_DEAD_PORT = "fastrtps_port"  # in shared memory


@dataclass
class Kill:
    node: str
    state: str | None  # of the game
    back_s: float = 0.0  # until the node was there again
    on_s: float = 0.0  # until the game went on
    missing: list[str] = field(default_factory=list)  # effects that were not seen in time
    deleted_ports: int = 0  # processes that still map a port of shared memory that is deleted
    repaired: str = ""  # how, if it was a hang


def _mapped(process: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{process}/maps").read_text()
    return ""


class Command:
    """``ros up`` as a process, and the processes of its nodes."""

    def __init__(self, words: Sequence[str], folder: Path, transport: str) -> None:
        self.log = folder / "up.log"
        environment = dict(os.environ)
        environment.pop(TRANSPORT, None)
        if TRANSPORTS[transport]:
            environment[TRANSPORT] = TRANSPORTS[transport]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "pacman_env.cli.main", "ros", "up", *words, "--logs", str(folder / "logs")],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
            )

    def ids(self) -> dict[str, int]:
        modules = {module_of(name): name for name in NODES}
        found = {}
        for folder in Path("/proc").iterdir():
            if folder.name.isdigit():
                with suppress(OSError, IndexError):
                    parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                    words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
                    if parent == self.process.pid and (name := modules.get(words[4])):
                        found[name] = int(folder.name)
        return found

    def deleted_ports(self) -> int:
        lines = [_mapped(number).splitlines() for number in self.ids().values()]
        return sum(any(_DEAD_PORT in line and "(deleted)" in line for line in one) for one in lines)

    def restarts(self) -> int:
        """By the supervisor, of nodes that were there and did not respond."""
        return self.log.read_text(errors="replace").count("is started again")

    def end(self) -> int:
        self.process.terminate()
        try:
            return self.process.wait(60)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


class Watch:
    """Counts what the nodes publish, and judges the score of each round."""

    def __init__(self) -> None:
        self.counts: collections.Counter[str] = collections.Counter()  # of messages, by topic
        self.ids: dict[str, int] = {}  # processes of nodes, as they name themselves
        self.state: str | None = None
        self.shown: set[int] = set()
        self.removed: set[int] = set()  # of this round
        self.clyde: tuple[float, ...] = ()
        self.base, self.spawned, self.result = 0, 0, ""
        self.rounds, self.deaths, self.wrong = 0, 0, list[str]()

    def subscribe(self, subscribe: Callable[[Any, Callable[[Any], None]], object]) -> None:
        """Call ``subscribe`` for each topic, with what takes its messages."""
        from pacman_env.ros import topics
        from pacman_env.ros.messages import pellets_of, pose_of
        from pacman_env.ros.node import process_of

        def configured(message: Any) -> None:
            if (plays := process_of(message)) is not None:
                self.ids[str(plays["node"])] = int(plays["started"][2])

        def show(message: Any) -> None:
            self.shown = set(pellets_of(message))

        known: list[tuple[Any, Callable[[Any], None]]] = [
            (topics.CONFIGURATION, configured),
            (topics.GAME_STATE, lambda message: self._enter(message.data)),
            (topics.GAME_RESULT, lambda message: self._end(message.data)),
            (topics.PELLETS_SPAWNED, lambda message: setattr(self, "spawned", message.data or self.spawned)),
            (topics.PELLET_MARKERS, show),
            (topics.REMOVE_PELLET, lambda message: self.removed.add(message.data)),
            (topics.CLYDE_POSE, lambda message: self._move(pose_of(message))),
        ]
        counted = topics.PELLETS_COLLECTED, topics.PLAY_NOTES.statuses, topics.GAME_STATUS, topics.GAME_EVENT
        known += [(topic, lambda message: None) for topic in (*counted, topics.GAME_LIGHT, topics.GAME_SOUND)]
        known += [(topics.LIGHT_RING, lambda message: None)]
        for topic, handle in known:
            subscribe(topic, partial(self._receive, topic.name, handle))

    def _receive(self, name: str, handle: Callable[[Any], None], message: Any) -> None:
        self.counts[name] += 1
        handle(message)

    def _enter(self, state: str) -> None:
        self.state = state
        if state == "returning_home":
            self.removed.clear()

    def _move(self, pose: tuple[float, ...]) -> None:
        self.counts[_MOVED] += pose != self.clyde
        self.clyde = pose

    def _end(self, result: str) -> None:
        before, self.result = self.result, result
        if result in ("", before):
            return
        score = int(result.rpartition(" ")[2])
        if not result.startswith("Complete"):
            self.deaths, self.base = self.deaths + 1, 0
            return
        self.rounds += 1
        if score != self.base + self.spawned:
            self.wrong.append(f"{result}, {self.base} before and {self.spawned} pellets")
        self.base = score


#: What must come after a node's return, by node: messages that follow from others' messages to it.
_EFFECTS = {
    SIMULATOR: ("game_status",),
    "pellet_manager": ("pellet_markers", "remove_pellet", _GONE),
    "audio_node": ("game_sound", "audio_note_sequence/_action/status"),
    "game_light_node": ("game_light", "cmd_lightring"),
    "clyde_ghost_node": ("clyde_pose", _MOVED),
    "game_event_mapper": ("game_event", "game_light", "game_sound"),
    REFEREE: ("game_status", "game/pellets_collected"),
    SELECTOR: ("game_status", "remove_pellet"),
}


def missing(node: str, watch: Watch, before: collections.Counter[str]) -> list[str]:
    """Effects of a node's return that were not seen yet, and the game's own: a pellet is counted."""
    wanted = ("game/pellets_collected", *_EFFECTS[node])
    lacking = [name for name in dict.fromkeys(wanted) if name != _GONE and watch.counts[name] <= before[name]]
    return lacking + [_GONE] * (_GONE in wanted and bool(watch.shown & watch.removed))


class Series:
    def __init__(self, arguments: argparse.Namespace, folder: Path) -> None:
        self.rng = np.random.default_rng(arguments.seed)
        self.kills: list[Kill] = []
        self._stop_s = time.monotonic() + 60.0 * arguments.minutes if arguments.minutes else float("inf")
        words = ["--map", arguments.map, "--policy", arguments.policy, "--sim", "--speed", f"{arguments.speed:g}"]
        words += [word for setting in SETTINGS for word in ("--set", setting)]
        words += ["--start", "--play-on", *(["--domain-id", str(arguments.domain_id)] if arguments.domain_id else [])]
        from pacman_env.ros.node import Observer

        self.node = Observer("pacman_kills", full_namespace(NAMESPACE))
        self.watch = Watch()
        self.watch.subscribe(lambda topic, receive: topic.subscription(self.node, receive))
        self.command = Command(words, folder, arguments.transport)

    def spin_until(self, condition: Callable[[], object], timeout_s: float) -> bool:
        end = time.monotonic() + timeout_s
        while not condition():
            if self.command.process.poll() is not None:
                raise ValueError(f"ros up has ended:\n{self.command.log.read_text()[-2000:]}")
            if time.monotonic() > end:
                return False
            self.node.spin(0.05)
        return True

    def pause(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        self.spin_until(lambda: time.monotonic() > end, seconds + 1.0)

    def play(self, kills: int) -> None:
        going = self.spin_until(lambda: set(NODES) <= set(self.watch.ids) and self.watch.spawned, START_S)
        if not going:
            raise ValueError(f"no game within {START_S:g} s:\n{self.command.log.read_text()[-2000:]}")
        order: list[str] = []
        while len(self.kills) < kills and time.monotonic() < self._stop_s:
            order = order or [NODES[k] for k in self.rng.permutation(len(NODES))]
            self.pause(self.rng.uniform(0.0, _PAUSE_S))
            self._kill(order.pop())

    def _kill(self, node: str) -> None:
        watch, killed_s = self.watch, time.monotonic()
        if (number := self.command.ids().get(node)) is None:  # it waits to be started again
            return
        kill = Kill(node, watch.state)
        os.kill(number, 9)

        def back() -> bool:
            return watch.ids[node] not in (number, 0)

        def goes_on() -> bool:
            return not missing(node, watch, before)

        there = self.spin_until(back, HANG_S)
        kill.back_s = time.monotonic() - killed_s
        before = watch.counts.copy()
        if not (there and self.spin_until(goes_on, HANG_S)):
            kill.missing = missing(node, watch, before)
            print(f"{len(self.kills)}: {node} in {kill.state}: no {', '.join(kill.missing)}", flush=True)
            kill.deleted_ports = self.command.deleted_ports()
            kill.repaired = "by itself" if self.spin_until(goes_on, REPAIR_S) else "by another kill"
            if kill.repaired != "by itself":
                with suppress(OSError, KeyError):
                    os.kill(self.command.ids()[node], 9)
                self.spin_until(goes_on, REPAIR_S)
        kill.on_s = time.monotonic() - killed_s
        self.kills.append(kill)
        if len(self.kills) % 10 == 0:
            print(f"{len(self.kills)} kills, {watch.rounds} rounds, {len(watch.wrong)} wrong", flush=True)


def simulated(arguments: argparse.Namespace, folder: Path) -> tuple[list[Kill], Watch]:
    """The same in lock-step, where all times are simulated; a hang ends the series."""
    from pacman_env.ros import topics
    from pacman_env.ros.lock_step.deliveries import NodeFailed
    from pacman_env.ros.lock_step.game import LockStepGame
    from tests.ros import session

    rng, watch, kills = np.random.default_rng(arguments.seed), Watch(), list[Kill]()
    with session.game(folder, arguments.map, arguments.policy, arguments.seed, settings=SETTINGS) as whole:
        game = whole.game
        assert isinstance(game, LockStepGame)
        watch.subscribe(
            lambda topic, receive: game.subscribe(whole.observer, partial(topic.subscription, whole.observer, receive))
        )

        def until(condition: Callable[[], object], limit_s: float) -> bool:
            end_s = whole.now_s + limit_s
            while not condition() and whole.now_s < end_s:
                if watch.state == "menu":
                    with suppress(NodeFailed):  # no referee is there to answer
                        game.call(whole.observer, topics.START_GAME, 5.0)
                game.advance(0.5)
            return bool(condition())

        def kill_one(node: str) -> Kill:
            until(lambda: False, rng.uniform(0.0, _SIMULATED_PAUSE_S))
            kill, killed_s = Kill(node, watch.state), whole.now_s
            game.kill(node)
            there = until(lambda: game.member(node) is not None, HANG_S)
            kill.back_s, before = whole.now_s - killed_s, watch.counts.copy()
            if not (there and until(lambda: not missing(node, watch, before), _SIMULATED_HANG_S)):
                kill.missing = missing(node, watch, before)
            kill.on_s = whole.now_s - killed_s
            return kill

        while len(kills) < arguments.kills:
            for number in rng.permutation(len(NODES)):
                kills.append(kill_one(NODES[number]))
                if kills[-1].missing:
                    return kills, watch
        errors = whole.errors()
    watch.wrong += errors
    return kills, watch


def figures(kills: Sequence[Kill], watch: Watch) -> dict[str, Any]:
    on_s = sorted(kill.on_s for kill in kills)
    return {
        "kills": len(kills),
        "by_node": dict(collections.Counter(kill.node for kill in kills)),
        "in_state": dict(collections.Counter(kill.state for kill in kills)),
        "on_s": {"median": statistics.median(on_s), "longest": on_s[-1]} if on_s else {},
        "back_s": statistics.median(kill.back_s for kill in kills) if on_s else None,
        "hangs": [asdict(kill) for kill in kills if kill.missing],
        "rounds": watch.rounds,
        "deaths": watch.deaths,
        "wrong": watch.wrong,
    }


def run(arguments: argparse.Namespace) -> int:
    require_ros()
    from pacman_env.ros.discovery import join

    if arguments.json:
        prepare(arguments.json)
    folder = arguments.logs or Path(tempfile.mkdtemp(prefix="kills_"))
    folder.mkdir(parents=True, exist_ok=True)
    join(arguments.domain_id, this_machine=True)
    found: dict[str, Any] = {"lock_step": arguments.lock_step}
    if arguments.lock_step:
        found |= figures(*simulated(arguments, folder))
    else:
        series = Series(arguments, folder)
        try:
            series.play(arguments.kills)
        finally:
            found |= {"transport": arguments.transport, "speed": arguments.speed, "status": series.command.end()}
            found |= {"restarts_by_supervisor": series.command.restarts(), **figures(series.kills, series.watch)}
            series.node.close()
    print(json.dumps(found, indent=2))
    if arguments.json:
        write_json(arguments.json, found)
    return FAULT_STATUS if found["hangs"] or found["wrong"] or found.get("status") else 0


def main(argv: Sequence[str] | None = None) -> int:
    """The exit status is 1 after a hang, a wrong score, or an end that is not in order."""
    parser = Parser(prog="python -m tests.system.kills", description=__doc__)
    add = parser.add_argument
    add("--kills", type=whole_number(1), default=200, help="in lock-step whole turns of all nodes (%(default)s)")
    add("--minutes", type=whole_number(0), default=0, help="after which none is killed; 0: no limit (%(default)s)")
    add("--map", default="house", help="(%(default)s)")
    add("--policy", default="nearest", help="(%(default)s)")
    add("--speed", type=float, default=10.0, help="of the simulated clock (%(default)g)")
    add("--seed", type=whole_number(0), default=0, help="of order and moments (%(default)s)")
    add(
        "--lock-step",
        action="store_true",
        help="all nodes in one process, times are simulated: repeatable",
    )
    add("--transport", choices=TRANSPORTS, default="default", help="of the middleware (%(default)s: the game's own)")
    add("--domain-id", type=whole_number(0), default=None, help="ROS domain (ROS_DOMAIN_ID)")
    add("--logs", type=Path, help="folder for what the processes print (a new one in the temporary folder)")
    add("--json", type=Path, help="file for the figures")
    return run_command(parser, argv, run)


if __name__ == "__main__":
    sys.exit(main())
