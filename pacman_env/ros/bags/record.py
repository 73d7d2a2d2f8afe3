"""``pacman-env ros record``: record the topics of a running game as an MCAP bag, which ROS's tools can also play.

For privacy, bags contain no map, scan or picture of the home; but poses show where the robot has been."""

import os
import shutil
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import mcap.writer
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import QoSProfile
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.bags.bag import SUFFIX, remedy_for
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import full_namespace
from pacman_env.ros.node import BaseNode
from pacman_env.ros.process import run

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
_FOR_EVER = QosTime(9223372036, 854775807)  # ROS's "no limit"


def new_bag(folder: Path) -> Writer:
    """Create a compressed MCAP bag with checksums and the writer's version; ``folder`` must not exist."""
    writer = Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
    writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: McapFile}
    writer.set_custom_data("pacman_env", __version__)
    return writer


class McapFile:
    """The bag's file, as ``rosbags`` uses it; chunks and summary have checksums by default."""

    def __init__(self, folder: Path, compression: object) -> None:
        self.path = folder / f"{folder.name}.mcap"
        self._file = self.path.open("xb")
        self._mcap = mcap.writer.Writer(self._file, enable_data_crcs=True)
        self._mcap.start("ros2", f"pacman_env {__version__}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[int, int] = {}

    def add_msgtype(self, connection: Connection) -> None:
        name, definition = connection.msgtype, connection.msgdef.data.encode()
        self._schemas[name] = self._mcap.register_schema(name, "ros2msg", definition)

    def add_connection(self, connection: Connection, qos: str) -> None:
        schema, metadata = self._schemas[connection.msgtype], {"offered_qos_profiles": qos}
        self._channels[connection.id] = self._mcap.register_channel(connection.topic, "cdr", schema, metadata)

    def write(self, connection: Connection, at_ns: int, data: Any) -> None:
        self._mcap.add_message(self._channels[connection.id], at_ns, data, at_ns)

    def flush(self) -> None:
        """Write everything so far to the disk, so that it can be read even if the process is killed."""
        if not self._file.closed:  # the recorder's timer may be due at its end
            self._mcap.flush()
            os.fsync(self._file.fileno())

    def close(self, version: int, metadata: str) -> None:
        self._mcap.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._mcap.finish()
        self.flush()
        self._file.close()

    def abort(self) -> None:
        self._file.close()


class Recorder(BaseNode):
    """Node that writes each arriving message on the topics :data:`RECORDED`; ``last_messages`` completes the bag."""

    def __init__(self, writer: Writer, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._writer, store = writer, get_typestore(Stores.ROS2_JAZZY)
        writer.open()
        for topic in RECORDED:
            name, type_name, qos = self.resolve_topic_name(topic.name), topic.type_name.replace("/", "/msg/"), topic.qos
            bag_qos = [_bag_qos(qos)]
            channel = writer.add_connection(name, type_name, typestore=store, offered_qos_profiles=bag_qos)
            deep = QoSProfile(depth=_DEPTH, durability=qos.durability, reliability=qos.reliability)
            self.create_subscription(topic.type, topic.name, partial(self._write, channel), deep, raw=True)
        self.create_timer(FLUSH_S, writer.storage.flush, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def last_messages(self) -> Iterable[Any]:
        for subscription in [one for one in self.subscriptions if one.raw]:  # all but the clock
            with subscription.handle:
                while (item := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                    subscription.callback(item[0])
        self._writer.close()
        return ()

    def _write(self, channel: Any, raw: bytes) -> None:
        if self._writer.storage is not None:  # else the message arrived after the last ones
            self._writer.write(channel, self.get_clock().now().nanoseconds, raw)


def record(out: Path, namespace: str, domain: int | None = None, sim_time: bool = False) -> int:
    """Record until SIGINT or SIGTERM, in the main thread, and return the exit status.

    With ``sim_time`` messages get the time of ``/clock`` instead of wall time.
    """
    full = full_namespace(namespace)
    if out.exists():
        raise FileExistsError(f"{out}: already exists; a bag is not overwritten")
    join(domain, sim_time)
    folder = out.with_name(out.name + SUFFIX)
    if folder.exists():
        remedy = remedy_for(out) or "another recorder writes into it, or was killed"
        raise FileExistsError(f"{folder}: already exists; delete it, or recover its content: {remedy}")
    folder.mkdir(parents=True)
    writer = new_bag(folder / out.name)

    def make() -> Recorder:
        recorder = Recorder(writer)
        print(f"recording {full} into {out}; Ctrl-C ends it", flush=True)
        return recorder

    try:
        status = run(make, NAME, ["--ros-args", "-r", f"__ns:={full}", "-p", f"use_sim_time:={str(sim_time).lower()}"])
        count = sum(writer.counts.values())
        if status == 0 and not count:
            raise ValueError(f"no message was received under {full}: is the namespace right, is the game up?")
        if status == 0:
            os.replace(folder / out.name, out)
            size = sum(path.stat().st_size for path in out.iterdir())
            print(f"{out}: {count} messages, {size / 1e6:.2f} MB", flush=True)
    finally:
        if out.exists() or not any(writer.counts.values()):  # otherwise keep what can be recovered
            shutil.rmtree(folder, ignore_errors=True)
    return status


def _bag_qos(qos: QoSProfile) -> Qos:
    """Convert a QoS profile to the bag's form, so that replayed latched topics are latched."""
    reliability, durability = QosReliability[qos.reliability.name], QosDurability[qos.durability.name]
    liveliness = QosLiveliness.AUTOMATIC, _FOR_EVER, False
    return Qos(QosHistory.KEEP_LAST, qos.depth, reliability, durability, _FOR_EVER, _FOR_EVER, *liveliness)
