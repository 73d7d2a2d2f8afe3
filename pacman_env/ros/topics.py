"""Names, types and QoS of all topics, services and actions of the nodes, and the words on the topics.

Names are relative to a node's namespace. A type is imported at its first use, so other packages may be missing."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, ClassVar, get_args

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient, ActionServer
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.round import Command, State


def _qos(depth: int, *, latched: bool = False, best_effort: bool = False) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
    )


LATCHED = _qos(1, latched=True)
#: Commands come in bursts, of which a depth of 1 keeps only the last; the original's depth of 1 is compatible.
COMMANDS = _qos(32, latched=True)
#: For subscriptions to latched topics: with a depth of 1, a second message right after the first would replace it
#: before it is read.
RECEIVED_LATCHED = _qos(10, latched=True)
EVENTS = _qos(10)
#: A late subscriber receives all reports of a round: its pellets and its end.
REPORTS = _qos(200)
SENSOR_DATA = _qos(5, best_effort=True)
TRANSFORMS = _qos(100)
STATIC_TRANSFORMS = _qos(100, latched=True)


@dataclass(frozen=True)
class _Interface:
    name: str
    type_name: str

    kind: ClassVar[str]  # module of the type's package: msg, srv or action

    @property
    def type(self) -> Any:
        package, _, name = self.type_name.partition("/")
        return attrgetter(name)(importlib.import_module(f"{package}.{self.kind}"))


@dataclass(frozen=True)
class Topic(_Interface):
    qos: QoSProfile
    kind = "msg"

    def publisher(self, node: Any) -> Any:
        return node.create_publisher(self.type, self.name, self.qos)

    def subscription(self, node: Any, callback: Callable[..., None]) -> Any:
        qos = RECEIVED_LATCHED if self.qos == LATCHED else self.qos
        return node.create_subscription(self.type, self.name, callback, qos)


@dataclass(frozen=True)
class Service(_Interface):
    kind = "srv"

    def client(self, node: Any) -> Any:
        return node.create_client(self.type, self.name)

    def server(self, node: Any, callback: Callable[[Any, Any], Any]) -> Any:
        return node.create_service(self.type, self.name, callback)


class FeedbackTopic(Topic):
    """Topic of an action's feedback, of which only the newest message matters."""

    kind = "action"


@dataclass(frozen=True)
class RosAction(_Interface):
    kind = "action"

    def client(self, node: Any) -> Any:
        return ActionClient(node, self.type, self.name)

    @property
    def statuses(self) -> Topic:
        """Topic with the statuses of all goals that the server still lists."""
        return Topic(f"{self.name}/_action/status", "action_msgs/GoalStatusArray", LATCHED)

    @property
    def feedback(self) -> FeedbackTopic:
        return FeedbackTopic(f"{self.name}/_action/feedback", f"{self.type_name}.Impl.FeedbackMessage", _qos(1))

    def goal_client(self, node: Any) -> Any:
        return node.create_client(self.type.Impl.SendGoalService, f"{self.name}/_action/send_goal")

    def result_client(self, node: Any) -> Any:
        """Create a client of the service that responds when a goal has ended."""
        return node.create_client(self.type.Impl.GetResultService, f"{self.name}/_action/get_result")

    def server(self, node: Any, execute: Callable[[Any], Any], **options: Any) -> Any:
        return ActionServer(node, self.type, self.name, execute, **options)


#: JSON: the configuration of each node (``node.py``); a reader has one queue for all nodes, so it must be deep.
CONFIGURATION = Topic("game/configuration", "std_msgs/String", COMMANDS)
GAME_STATE = Topic("game_state", "std_msgs/String", LATCHED)
GAME_COMMAND = Topic("game_command", "std_msgs/String", COMMANDS)
GAME_RESULT = Topic("game_result", "std_msgs/String", LATCHED)
PELLETS_SPAWNED = Topic("game/pellets_spawned", "std_msgs/Int32", LATCHED)
PELLETS_COLLECTED = Topic("game/pellets_collected", "std_msgs/Int32", LATCHED)
SCORE = Topic("game/score", "std_msgs/Int32", LATCHED)
ROUND = Topic("game/round", "std_msgs/Int32", LATCHED)
GHOSTS_CAUGHT = Topic("game/ghosts_caught", "std_msgs/Int32", LATCHED)  # in this round, of a game with power pellets
#: ROS times, s, until which each ghost is harmless and until which it is away (``game/power.py``).
HARMLESS_GHOSTS = Topic("game/harmless_ghosts", "std_msgs/Float64MultiArray", LATCHED)
BASE_CLYDE_SPEED = Topic("game/base_clyde_speed", "std_msgs/Float32", LATCHED)  # m/s
CLYDE_SPEED = Topic("clyde/speed", "std_msgs/Float32", LATCHED)  # m/s

#: JSON: why processes of the game do not run, and the newest event, from ``ros up`` (``supervisor/status_line.py``).
PROCESSES = Topic("game/processes", "std_msgs/String", LATCHED)

#: JSON: whether the operator has stopped the robot, who did and when (``operator_stop.py``).
OPERATOR_STOP = Topic("operator/stop", "std_msgs/String", LATCHED)

PELLET_MARKERS = Topic("pellet_markers", "visualization_msgs/MarkerArray", EVENTS)
REMOVE_PELLET = Topic("remove_pellet", "std_msgs/Int32", EVENTS)
GHOST_POSES = tuple(Topic(f"{name}_pose", "geometry_msgs/PoseStamped", EVENTS) for name in GHOST_NAMES)
CLYDE_POSE = GHOST_POSES[0]
CLYDE_MARKER = Topic("clyde_marker", "visualization_msgs/Marker", EVENTS)
CLYDE_OBSTACLE = Topic("clyde_obstacle", "sensor_msgs/PointCloud2", EVENTS)
CLYDE_TRAIL = Topic("clyde_trail", "sensor_msgs/PointCloud2", EVENTS)  # points that costmaps clear: ghost_trail.py
CLICKED_POINT = Topic("clicked_point", "geometry_msgs/PointStamped", EVENTS)  # places Clyde before a round
GAME_EVENT = Topic("game_event", "std_msgs/String", EVENTS)
GAME_STATUS = Topic("game_status", "std_msgs/String", REPORTS)
GAME_LIGHT = Topic("game_light", "std_msgs/String", EVENTS)
GAME_SOUND = Topic("game_sound", "std_msgs/String", EVENTS)
LIGHT_RING = Topic("cmd_lightring", "irobot_create_msgs/LightringLeds", EVENTS)
CMD_VEL = Topic("cmd_vel", "geometry_msgs/TwistStamped", EVENTS)

MAP = Topic("map", "nav_msgs/OccupancyGrid", LATCHED)
AMCL_POSE = Topic("amcl_pose", "geometry_msgs/PoseWithCovarianceStamped", LATCHED)
INITIAL_POSE = Topic("initialpose", "geometry_msgs/PoseWithCovarianceStamped", EVENTS)
#: Start of a simulated robot's odometry in the map; start and odometry give its true pose.
SIMULATED_ORIGIN = Topic("sim/origin", "geometry_msgs/PoseStamped", LATCHED)
SIMULATED_POSE = Topic("sim/true_pose", "geometry_msgs/PoseStamped", EVENTS)
PLAN = Topic("plan", "nav_msgs/Path", EVENTS)
ODOMETRY = Topic("odom", "nav_msgs/Odometry", SENSOR_DATA)
#: Odometry of a base alone: some middlewares treat the default of Nav2's subscriptions as reliable.
RELIABLE_ODOMETRY = Topic("odom", "nav_msgs/Odometry", _qos(10))
BATTERY_STATE = Topic("battery_state", "sensor_msgs/BatteryState", _qos(5))
DOCK_STATUS = Topic("dock_status", "irobot_create_msgs/DockStatus", _qos(5))
HAZARD_DETECTION = Topic("hazard_detection", "irobot_create_msgs/HazardDetectionVector", _qos(5))
SCAN = Topic("scan", "sensor_msgs/LaserScan", SENSOR_DATA)
TF = Topic("tf", "tf2_msgs/TFMessage", TRANSFORMS)
TF_STATIC = Topic("tf_static", "tf2_msgs/TFMessage", STATIC_TRANSFORMS)
CLOCK = Topic("/clock", "rosgraph_msgs/Clock", SENSOR_DATA)  # absolute, as rclpy subscribes to it
CLOCK_OWNER = Topic("/clock_owner", "std_msgs/String", COMMANDS)  # JSON: the simulated robot that publishes the time

#: Messages of a goal selector about itself (``selector/goal_scores.py``): scores of candidates, as markers of one
#: namespace; as JSON the candidates' positions, their terms at each decision, the node's diagnostics.
SCORES = Topic("goal_selector/scores", "visualization_msgs/MarkerArray", EVENTS)
SCORE_MARKERS = "scores"
CANDIDATES = Topic("goal_selector/candidates", "std_msgs/String", LATCHED)
WHY = Topic("goal_selector/why", "std_msgs/String", EVENTS)
DIAGNOSTICS = Topic("goal_selector/diagnostics", "std_msgs/String", LATCHED)
DIAGNOSTIC_ARRAY = Topic("/diagnostics", "diagnostic_msgs/DiagnosticArray", EVENTS)

START_GAME = Service("game/start", "std_srvs/Trigger")
RESET_GAME = Service("game/reset", "std_srvs/Trigger")
CONTINUE = Service("goal_selector/continue", "std_srvs/Trigger")  # accepts the believed pose after a jump
CLEAR_GLOBAL_COSTMAP = Service("global_costmap/clear_entirely_global_costmap", "nav2_msgs/ClearEntireCostmap")

NAVIGATE_TO_POSE = RosAction("navigate_to_pose", "nav2_msgs/NavigateToPose")
DOCK = RosAction("dock", "irobot_create_msgs/Dock")
UNDOCK = RosAction("undock", "irobot_create_msgs/Undock")
PLAY_NOTES = RosAction("audio_note_sequence", "irobot_create_msgs/AudioNoteSequence")

#: Names of other actions that move a TurtleBot 4: Nav2's behaviours and other navigators, then the base's motions.
MOTIONS = (
    *("navigate_through_poses", "follow_waypoints", "spin", "backup", "drive_on_heading", "assisted_teleop"),
    *("dock_robot", "undock_robot"),
    *("dock", "undock", "drive_distance", "drive_arc", "rotate_angle", "navigate_to_position", "wall_follow"),
)


def cancel_client(node: Any, name: str) -> Any:
    """Create a client that cancels goals by id, even before they are accepted; the type need not be installed."""
    return node.create_client(CancelGoal, f"{name}/_action/cancel_goal")


STATE_WORDS = frozenset(get_args(State))
COMMAND_WORDS = frozenset(get_args(Command))
