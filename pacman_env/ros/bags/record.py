"""``pacman-env ros record``: record the topics of a running game as an MCAP bag, which ROS's tools can also play.

For privacy, bags contain no map, scan or picture of the home; but poses show where the robot has been."""

import os
import shutil
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.typesys import Stores, get_typestore

from pacman_env.ros import topics
from pacman_env.ros.bags.bag import new_bag, remedy_for, unfinished_folder
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import full_namespace
from pacman_env.ros.node import BaseNode, run

NAME = "pacman_recorder"
RECORDED = (
    *(topics.CONFIGURATION, topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_RESULT, topics.PELLETS_SPAWNED),
    *(topics.PELLETS_COLLECTED, topics.SCORE, topics.ROUND, topics.BASE_CLYDE_SPEED, topics.CLYDE_SPEED),
    *(topics.PELLET_MARKERS, topics.REMOVE_PELLET, *topics.GHOST_POSES, topics.CLICKED_POINT, topics.GAME_EVENT),
    *(topics.GAME_STATUS, topics.GAME_LIGHT, topics.GAME_SOUND, topics.CMD_VEL, topics.OPERATOR_STOP),
    *(topics.SCORES, topics.DIAGNOSTICS, topics.AMCL_POSE, topics.INITIAL_POSE, topics.PLAN, topics.ODOMETRY),
    *(topics.TF, topics.TF_STATIC, topics.GHOSTS_CAUGHT, topics.HARMLESS_GHOSTS),
)
FLUSH_S = 2.0  # wall time; a killed recorder loses at most this time
_DEPTH = 1000  # messages that can wait while the disk is busy
_FOR_EVER = QosTime(2147483647, 4294967295)  # rosbag2's "no limit"


class Recorder(BaseNode):
    """Node that writes each arriving message on the topics :data:`RECORDED`; ``last_messages`` completes the bag."""

    def __init__(self, folder: Path, sim_time: bool) -> None:
        super().__init__(NAME, parameter_overrides=[Parameter("use_sim_time", Parameter.Type.BOOL, sim_time)])
        self.messages = 0
        self._writer = new_bag(folder)
        self._writer.open()
        self._open = True
        self._subscribed: list[tuple[Any, Any]] = []
        store = get_typestore(Stores.ROS2_JAZZY)
        for topic in RECORDED:
            name, type_name = self.resolve_topic_name(topic.name), topic.type_name.replace("/", "/msg/")
            qos = [_bag_qos(topic.qos)]
            connection = self._writer.add_connection(name, type_name, typestore=store, offered_qos_profiles=qos)
            deep = QoSProfile(depth=_DEPTH, durability=topic.qos.durability, reliability=topic.qos.reliability)
            write = partial(self._write, connection)
            subscription = self.create_subscription(topic.type, topic.name, write, deep, raw=True)
            self._subscribed.append((subscription, connection))
        self.create_timer(FLUSH_S, self._flush, clock=self.surroundings.clock())

    def last_messages(self) -> Iterable[Any]:
        if self._open:
            for subscription, connection in self._subscribed:
                with subscription.handle:
                    while (item := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                        self._write(connection, item[0])
            self._open = False
            self._writer.close()
        return ()

    def _write(self, connection: Any, raw: bytes) -> None:
        if self._open:
            self._writer.write(connection, self.get_clock().now().nanoseconds, raw)
            self.messages += 1

    def _flush(self) -> None:
        """Close the current chunk and write it to disk, so that it can be read even if the recorder is killed."""
        storage = self._writer.storage
        if self._open and storage.chunk.msgs:
            storage.close_chunk()
            storage.bio.flush()
            os.fsync(storage.bio.fileno())


def record(out: Path, namespace: str, domain: int | None = None, sim_time: bool = False) -> int:
    """Record until SIGINT or SIGTERM, in the main thread, and return the exit status.

    With ``sim_time`` messages get the time of ``/clock`` instead of wall time.
    """
    full = full_namespace(namespace)
    if out.exists():
        raise FileExistsError(f"{out}: already exists; a bag is not overwritten")
    join(domain, sim_time)
    folder = unfinished_folder(out)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        remedy = remedy_for(out) or "another recorder writes into it, or was killed"
        raise FileExistsError(f"{folder}: already exists; delete it, or recover its content: {remedy}") from None
    recorders: list[Recorder] = []

    def make() -> Recorder:
        recorders.append(Recorder(folder / out.name, sim_time))
        print(f"recording {full} into {out}; Ctrl-C ends it", flush=True)
        return recorders[0]

    try:
        status = run(make, NAME, ["--ros-args", "-r", f"__ns:={full}"])
        count = recorders[0].messages if recorders else 0
        if status == 0 and not count:
            raise ValueError(f"no message was received under {full}: is the namespace right, is the game up?")
        if status == 0:
            os.replace(folder / out.name, out)
            size = sum(path.stat().st_size for path in out.iterdir())
            print(f"{out}: {count} messages, {size / 1e6:.2f} MB", file=sys.stdout, flush=True)
    finally:
        if out.exists() or not (recorders and recorders[0].messages):  # otherwise keep what can be recovered
            shutil.rmtree(folder, ignore_errors=True)
    return status


def _bag_qos(qos: QoSProfile) -> Qos:
    """Convert a QoS profile to the bag's form, so that replayed latched topics are latched."""
    reliability, durability = QosReliability[qos.reliability.name], QosDurability[qos.durability.name]
    durations = _FOR_EVER, _FOR_EVER, QosLiveliness.AUTOMATIC, _FOR_EVER, False
    return Qos(QosHistory.KEEP_LAST, qos.depth, reliability, durability, *durations)
