"""Convert messages to plain values and back; readers raise BadMessage. Stamps are ``builtin_interfaces/Time``.

Poses are (x, y, theta) in m, m, rad and positions (x, y) in m, in the map frame unless another frame is given."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, TwistStamped
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float64MultiArray, Header
from visualization_msgs.msg import Marker, MarkerArray

FARTHEST_M = 1000.0  # farthest position from the origin; no map is larger
UNIT_TOLERANCE = 0.01  # tolerance of a quaternion's length
LONGEST_WORD = 200  # characters
LONGEST_JSON = 100_000
MOST_POINTS = 100_000  # of a cloud
PELLETS = "pellets"  # namespace of markers
POWER_PELLETS = "power_pellets"  # namespace of markers that the original's nodes ignore
GHOSTS = "ghosts"
PELLET_DIAMETER_M, POWER_PELLET_DIAMETER_M = 0.12, 0.24
RVIZ_VARIANCES = (0.25, 0.25, 0.0685)  # x (m2), y (m2), heading (rad2) in RViz's "2D Pose Estimate"

Pose = tuple[float, float, float]
Position = tuple[float, float]
Colour = tuple[float, float, float]  # red, green, blue, 0 to 1


_AROUND = [(math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k in range(8)]
#: (9, 2) obstacle of a ghost at the origin: the ghost's position and eight points at distance 1 around it.
GHOST_OBSTACLE = np.array([(0.0, 0.0), *_AROUND], dtype=np.float64)


@dataclass
class Frames:
    """Names of the frames of this process; parameters of the game may change them at the start."""

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"


FRAMES = Frames()


class BadMessage(ValueError):
    """Raised for an invalid message; the text says why."""


def _position(point: Any) -> Position:
    for axis in ("x", "y", "z"):
        value = getattr(point, axis)
        if not math.isfinite(value):
            raise BadMessage(f"position {axis} = {value}: must be finite")
        if abs(value) > FARTHEST_M:
            raise BadMessage(f"position {axis} = {value:g} m: more than {FARTHEST_M:g} m away")
    return point.x, point.y


def _yaw(quaternion: Any) -> float:
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    length = math.hypot(x, y, z, w)
    if not abs(length - 1.0) <= UNIT_TOLERANCE:  # also refuses NaN
        raise BadMessage(f"orientation ({x:g}, {y:g}, {z:g}, {w:g}): length {length:g}, must be 1")
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _check_frame(header: Any, frame: str | None = None) -> None:
    frame = frame or FRAMES.map
    if header.frame_id != frame:
        raise BadMessage(f"frame {header.frame_id!r}: must be {frame!r}")


def pose_of(message: Any, frame: str | None = None) -> Pose:
    _check_frame(message.header, frame)
    pose = getattr(message.pose, "pose", message.pose)  # PoseWithCovariance contains a Pose
    return *_position(pose.position), _yaw(pose.orientation)


def point_of(message: Any) -> Position:
    _check_frame(message.header)
    return _position(message.point)


def word_of(message: Any, words: Collection[str] | None = None) -> str:
    text: str = message.data
    if len(text) > LONGEST_WORD:
        raise BadMessage(f"a word of {len(text)} characters, at most {LONGEST_WORD}")
    word = text.strip().lower()
    if words is not None and word not in words:
        raise BadMessage(f"unknown word {text!r}: one of {', '.join(sorted(words))}")
    return word


def number_of(message: Any, low: float, high: float) -> float:
    value = message.data
    if not low <= value <= high:  # also refuses NaN
        raise BadMessage(f"number {value!r}: must be within {low:g} and {high:g}")
    return value


def pellets_of(message: Any, limit: int = 10_000) -> dict[int, Position]:
    """Return the positions (m), by id, of the pellets that a MarkerArray leaves on the map, in the markers' order."""
    if len(message.markers) > limit:
        raise BadMessage(f"{len(message.markers)} markers: at most {limit}")
    pellets: dict[int, Position] = {}
    for marker in message.markers:
        if marker.action == Marker.DELETEALL:
            pellets.clear()
        elif marker.ns in (PELLETS, POWER_PELLETS):
            if marker.id < 0:
                raise BadMessage(f"pellet {marker.id}: ids start at 0")
            if marker.action == Marker.DELETE:
                pellets.pop(marker.id, None)
                continue
            try:
                _check_frame(marker.header)
                pellets[marker.id] = _position(marker.pose.position)
            except BadMessage as error:
                raise BadMessage(f"pellet {marker.id}: {error}") from None
    return pellets


def power_pellets_of(message: Any) -> set[int]:
    """Return the ids of all power pellets in a MarkerArray that :func:`pellets_of` accepts."""
    return {marker.id for marker in message.markers if marker.ns == POWER_PELLETS and marker.action == Marker.ADD}


def ghost_times_of(message: Any, ghosts: int) -> NDArray[np.float64]:
    """Return for each ghost the times until which it is harmless and until which it is away: (``ghosts``, 2), s."""
    times = np.array(message.data, dtype=np.float64)
    if times.shape != (2 * ghosts,):
        raise BadMessage(f"{len(times)} times: must be two for each of {ghosts} ghosts")
    if not (np.isfinite(times).all() and (times >= 0).all()):
        raise BadMessage(f"times {times.tolist()}: must be finite and at least 0")
    return times.reshape(ghosts, 2)


def ghost_times_message(times: NDArray[np.float64]) -> Any:
    """Return the message of such times (G, 2), s by the clock; times before its beginning become 0."""
    return Float64MultiArray(data=np.maximum(times, 0.0).ravel().tolist())


def points_of(message: Any) -> NDArray[np.float64]:
    """Return x and y of the finite points of a PointCloud2: (N, 2), m."""
    _check_frame(message.header)
    count = message.width * message.height
    if count > MOST_POINTS:
        raise BadMessage(f"{count} points: at most {MOST_POINTS}")
    offsets = {field.name: field.offset for field in message.fields if field.datatype == PointField.FLOAT32}
    formats = [">f4" if message.is_bigendian else "<f4"] * 2
    layout: Any = {"names": ["x", "y"], "formats": formats, "itemsize": message.point_step}
    try:
        layout["offsets"] = [offsets["x"], offsets["y"]]
        cloud: Any = np.frombuffer(bytes(message.data), np.dtype(layout))
    except (KeyError, ValueError):
        raise BadMessage("no cloud of points with float32 fields x and y") from None
    if len(cloud) != count:
        raise BadMessage(f"{len(cloud)} points, must be {count}")
    points: NDArray[np.float64] = structured_to_unstructured(cloud, np.float64)
    return points[np.isfinite(points).all(axis=1)]


def transform_of(message: Any) -> tuple[str, str, Pose]:
    """Return the parent frame, the child frame and the pose of the child in the parent."""
    pose = *_position(message.transform.translation), _yaw(message.transform.rotation)
    return message.header.frame_id, message.child_frame_id, pose


def nanoseconds_of(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def seconds_of(time: Any) -> float:
    return time.sec + time.nanosec * 1e-9


def _set_pose(pose: Any, x: float, y: float, theta: float) -> None:
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(theta / 2), math.cos(theta / 2)


def pose_message(x: float, y: float, theta: float, stamp: Any, frame: str | None = None) -> Any:
    message = PoseStamped(header=Header(stamp=stamp, frame_id=frame or FRAMES.map))
    _set_pose(message.pose, x, y, theta)
    return message


def uncertain_pose_message(
    x: float, y: float, theta: float, stamp: Any, variances: Sequence[float] = RVIZ_VARIANCES
) -> Any:
    """Create a PoseWithCovarianceStamped in the map frame; ``variances`` of x, y (m2) and heading (rad2)."""
    message = PoseWithCovarianceStamped(header=Header(stamp=stamp, frame_id=FRAMES.map))
    _set_pose(message.pose.pose, x, y, theta)
    message.pose.covariance[[0, 7, 35]] = variances
    return message


def twist_message(v_mps: float, w_radps: float, stamp: Any) -> Any:
    """Create a TwistStamped; driving forward and turning left are positive."""
    message = TwistStamped(header=Header(stamp=stamp, frame_id=FRAMES.base))
    message.twist.linear.x, message.twist.angular.z = float(v_mps), float(w_radps)
    return message


def transform_message(parent: str, child: str, pose: Pose, stamp: Any) -> Any:
    x, y, theta = pose
    message = TransformStamped(header=Header(stamp=stamp, frame_id=parent), child_frame_id=child)
    message.transform.translation.x, message.transform.translation.y = float(x), float(y)
    message.transform.rotation.z, message.transform.rotation.w = math.sin(theta / 2), math.cos(theta / 2)
    return message


def marker_message(namespace: str, number: int, at: Position, diameter_m: float, colour: Colour, stamp: Any) -> Any:
    marker = Marker(header=Header(stamp=stamp, frame_id=FRAMES.map), ns=namespace, id=number)
    marker.type, marker.action = Marker.SPHERE, Marker.ADD
    _set_pose(marker.pose, *at, 0.0)
    marker.pose.position.z = diameter_m / 2
    marker.scale.x = marker.scale.y = marker.scale.z = diameter_m
    marker.color.r, marker.color.g, marker.color.b = colour
    marker.color.a = 1.0
    return marker


def markers_of(pellets: Mapping[int, Position], stamp: Any, power: Collection[int] = ()) -> Any:
    """Create the MarkerArray that shows pellets; those in ``power`` are larger, in a namespace of their own."""
    yellow = (1.0, 1.0, 0.0)
    markers = [Marker(header=Header(stamp=stamp, frame_id=FRAMES.map), ns=PELLETS, action=Marker.DELETEALL)]
    for number, at in pellets.items():
        kind = (POWER_PELLETS, POWER_PELLET_DIAMETER_M) if number in power else (PELLETS, PELLET_DIAMETER_M)
        markers.append(marker_message(kind[0], number, at, kind[1], yellow, stamp))
    return MarkerArray(markers=markers)


def cloud_message(points: NDArray[np.float64], stamp: Any, z: float = 0.0) -> Any:
    """Create a PointCloud2 of float32 from ``points`` (N, 2), x and y in m, all at height ``z``."""
    data = np.full((len(points), 3), z, dtype="<f4")
    data[:, :2] = points
    fields = [PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate("xyz")]
    return PointCloud2(
        header=Header(stamp=stamp, frame_id=FRAMES.map),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=data.tobytes(),
        is_dense=True,
    )


def object_of(message: Any, longest: int = LONGEST_JSON) -> dict[str, Any]:
    if len(message.data) > longest:
        raise BadMessage(f"{len(message.data)} characters: at most {longest}")
    try:
        return msgspec.json.decode(message.data, type=dict[str, Any])
    except (msgspec.MsgspecError, ValueError, RecursionError):
        raise BadMessage("no JSON object") from None


def process_of(message: Any) -> dict[str, Any]:
    """Read the JSON object in a String that describes the sender; raises BadMessage unless ``started`` is valid."""
    content = object_of(message)
    try:
        return content | {"started": started(content)}
    except (ValueError, TypeError, LookupError, OverflowError):
        raise BadMessage("no process is described") from None


def configuration_of(message: Any) -> dict[str, Any]:
    """Return the configuration of a node with its name, its process, and the hashes of its configuration and map."""
    content = process_of(message)
    try:
        return {
            "node": str(content["node"])[:100],
            "acts": bool(content.get("acts")),
            "started": content["started"],
            "map": None if content["map"] is None else str(content["map"])[:100],
            "hash": str(content["hash"])[:100],
            "rules": content.get("rules"),
            "configuration": dict(content["configuration"]),
        }
    except (ValueError, TypeError, LookupError):
        raise BadMessage("not the configuration of a node of this game") from None


def started(plays: Mapping[str, Any]) -> tuple[float, str, int]:
    """Return start (s since 1970), machine and number of a process; sorting the tuples sorts by start."""
    started_s, host, number = plays["started"]
    return float(started_s), str(host)[:100], int(number)
