"""``pacman-env ros record``: the topics of a running game as an MCAP bag that ROS's own tools can play, too.

A home's inside is left out on purpose: no map, no scan, no picture. Poses tell enough where the robot has been:
docs/robot.md says where bags lie and how they are deleted.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.bags.unfinished import recording
from pacman_env.ros.discovery import join
from pacman_env.ros.node import BaseNode, run
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS, SCORES
from pacman_env.ros.supervisor.game_nodes import full_namespace

NAME = "pacman_recorder"
RECORDED = (
    topics.CONFIGURATION,
    topics.GAME_STATE,
    topics.GAME_COMMAND,
    topics.GAME_RESULT,
    topics.PELLETS_SPAWNED,
    topics.PELLETS_COLLECTED,
    topics.SCORE,
    topics.ROUND,
    topics.BASE_CLYDE_SPEED,
    topics.CLYDE_SPEED,
    topics.PELLET_MARKERS,
    topics.REMOVE_PELLET,
    *topics.GHOST_POSES,
    topics.CLICKED_POINT,
    topics.GAME_EVENT,
    topics.GAME_STATUS,
    topics.GAME_LIGHT,
    topics.GAME_SOUND,
    topics.CMD_VEL,
    topics.OPERATOR_STOP,
    SCORES,
    DIAGNOSTICS,
    topics.AMCL_POSE,
    topics.INITIAL_POSE,
    topics.PLAN,
    topics.ODOMETRY,
    topics.TF,
    topics.TF_STATIC,
)
FLUSH_S = 2.0  # of wall time: a recorder that is killed loses no more
_DEPTH = 1000  # messages that may wait while the disk is busy
_FOR_EVER = QosTime(2147483647, 4294967295)  # as rosbag2 writes "no limit"


class Recorder(BaseNode):
    """Writes every message of :data:`RECORDED` as it comes; the bag is whole after the last messages.

    Until then everything that was heard is on the disk, but the last ``FLUSH_S``; ``recover.py`` makes a bag of it.
    """

    def __init__(self, folder: Path, sim_time: bool) -> None:
        """Begin the bag in ``folder``, which must not exist.

        Raises:
            OSError: it cannot be written.
        """
        super().__init__(NAME, parameter_overrides=[Parameter("use_sim_time", Parameter.Type.BOOL, sim_time)])
        self.messages = 0
        self._writer = Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.set_custom_data("pacman_env", __version__)
        self._writer.open()
        self._open = True
        self._subscribed: list[tuple[Any, Any]] = []
        store = get_typestore(Stores.ROS2_JAZZY)
        for topic in RECORDED:
            package, _, name = topic.type_name.partition("/")
            connection = self._writer.add_connection(
                self.resolve_topic_name(topic.name),
                f"{package}/msg/{name}",
                typestore=store,
                offered_qos_profiles=[_described(topic.qos)],
            )
            deep = QoSProfile(depth=_DEPTH, durability=topic.qos.durability, reliability=topic.qos.reliability)
            subscription = self.create_subscription(
                topic.type, topic.name, lambda raw, to=connection: self._write(to, raw), deep, raw=True
            )
            self._subscribed.append((subscription, connection))
        self.create_timer(FLUSH_S, self._flush, clock=self.surroundings.clock())

    def last_messages(self) -> Iterable[Any]:
        """Write what has arrived already, and finish the bag."""
        if self._open:
            for subscription, connection in self._subscribed:
                with subscription.handle:
                    while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                        self._write(connection, taken[0])
            self._open = False
            self._writer.close()
        return ()

    def _write(self, connection: Any, raw: bytes) -> None:
        if self._open:
            self._writer.write(connection, self.get_clock().now().nanoseconds, raw)
            self.messages += 1

    def _flush(self) -> None:
        """End a chunk, so that it can be read without the next, and have it written to the disk."""
        storage = self._writer.storage
        if self._open and storage.chunk.msgs:
            storage.close_chunk()
            storage.bio.flush()
            os.fsync(storage.bio.fileno())


def record(out: Path, namespace: str, domain: int | None = None, sim_time: bool = False) -> int:
    """Record until SIGINT or SIGTERM; to be called in the main thread.

    Args:
        out: The bag, a folder; it appears when it is whole. Until then ``OUT.unfinished`` is there.
        namespace: Of the robot.
        domain: ROS_DOMAIN_ID; None: that of the environment.
        sim_time: Stamp with /clock instead of the wall's time.

    Returns:
        The exit status.

    Raises:
        ValueError: no namespace, or nothing was heard.
        OSError: ``out`` exists, or one that is not finished, or it cannot be written.
    """
    full = full_namespace(namespace)
    if out.exists():
        raise FileExistsError(f"{out}: exists already, a bag is not overwritten")
    join(domain, sim_time)
    made: list[Recorder] = []
    with recording(out) as folder:

        def make() -> Recorder:
            made.append(Recorder(folder / out.name, sim_time))
            print(f"recording {full} into {out}; Ctrl-C ends it", flush=True)
            return made[0]

        try:
            status = run(make, NAME, ["--ros-args", "-r", f"__ns:={full}"])
            heard = made[0].messages if made else 0
            if status == 0 and heard == 0:
                raise ValueError(f"nothing was heard under {full}: is the namespace right, is the game up?")
            if status == 0:
                os.replace(folder / out.name, out)
                size = sum(path.stat().st_size for path in out.iterdir())
                print(f"{out}: {heard} messages, {size / 1e6:.2f} MB", file=sys.stdout, flush=True)
        finally:
            if out.exists() or not (made and made[0].messages):  # else there is something to recover
                shutil.rmtree(folder, ignore_errors=True)
    return status


def _described(qos: QoSProfile) -> Qos:
    """A QoS profile as bags hold it, so that a replayed latched topic is latched."""
    latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    best_effort = qos.reliability == ReliabilityPolicy.BEST_EFFORT
    return Qos(
        QosHistory.KEEP_LAST,
        qos.depth,
        QosReliability.BEST_EFFORT if best_effort else QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        _FOR_EVER,
        _FOR_EVER,
        QosLiveliness.AUTOMATIC,
        _FOR_EVER,
        False,
    )
