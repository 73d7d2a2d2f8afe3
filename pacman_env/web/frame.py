"""Schema of the message ``frame``, the state of a game at one moment, which the page reads by field name."""

from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType, field
from numpy.typing import NDArray

from pacman_env.game.lights import Ring
from pacman_env.game.round import State

MOST_PLAN_POINTS = 64
_DECIMALS = 4  # decimals of numbers in arrays: a tenth of a millimetre

Metres = Annotated[float, Meta(extra_json_schema={"unit": "m"})]
Seconds = Annotated[float, Meta(extra_json_schema={"unit": "s"})]
Radians = Annotated[float, Meta(extra_json_schema={"unit": "rad"})]
MetresPerSecond = Annotated[float, Meta(extra_json_schema={"unit": "m/s"})]
RadiansPerSecond = Annotated[float, Meta(extra_json_schema={"unit": "rad/s"})]
Points = Annotated[NDArray[np.float64], Meta(description="(N, 2)", extra_json_schema={"unit": "m"})]
Ranges = Annotated[NDArray[np.float64], Meta(description="(R,)", extra_json_schema={"unit": "m"})]
Times = Annotated[NDArray[np.float64], Meta(description="(G,)", extra_json_schema={"unit": "s"})]
PlacedPoints = Annotated[NDArray[np.float64], Meta(description="(K, 3)", extra_json_schema={"unit": "m, m"})]
Scores = Annotated[NDArray[np.float64], Meta(description="(C,)")]
Present = Annotated[NDArray[np.bool_], Meta(description="(P,)")]
Pose = tuple[Metres, Metres, Radians]  # x, y, heading


class OptionalFields(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of a frame that are left out if they have no value."""

    lives: int | UnsetType = UNSET  # lives left; only set if a person plays the robot of a simulated game
    begins_in_s: Seconds | UnsetType = UNSET  # until the end of the start show; only set during the show
    # Only set in games with power pellets.
    ghosts_caught: int | UnsetType = UNSET  # in this round
    harmless_s: Times | UnsetType = UNSET  # until each ghost is dangerous again
    away_s: Times | UnsetType = UNSET  # until each caught ghost starts again; the page shows its eyes
    points: PlacedPoints | UnsetType = UNSET  # x, y and points of the ghosts that have just been caught


class Frame(OptionalFields, frozen=True, tag_field="kind", tag="frame"):
    """State of a game at one moment. NaN becomes null in JSON."""

    state: State
    revision: int  # revision of the scene to which the frame belongs
    number: int  # increases with each change
    time_s: Seconds = 0.0  # since the round began
    speed: float = 1.0  # simulated time relative to real time
    score: int = 0
    collected: int = 0
    spawned: int = 0
    round: int = 1
    goal: int = -1  # current candidate, -1: none
    paused: bool = False
    stopped: bool = False
    over: bool = False  # the round has ended
    true: Pose | None = None  # true pose of the robot, None: unknown
    believed: Pose | None = None
    velocity: tuple[MetresPerSecond, RadiansPerSecond] = (0.0, 0.0)
    baseline: Pose | None = None  # pose of the policy's robot in the same round, if a person plays
    baseline_collected: int = 0
    ring: Ring | None = None  # six LEDs, None: not controlled by the game
    ghosts: Points = field(default_factory=lambda: np.zeros((0, 2)))
    ghost_goals: Points = field(default_factory=lambda: np.zeros((0, 2)))  # targets set by people, NaN: none
    alive: Present = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))  # remaining pellets
    scores: Scores = field(default_factory=lambda: np.zeros(0))  # scores of candidates, NaN: none
    plan: Points = field(default_factory=lambda: np.zeros((0, 2)))  # path to the goal
    scan: Ranges = field(default_factory=lambda: np.zeros(0))  # ray 0 ahead, counter-clockwise, NaN: no hit

    def encode(self) -> str:
        return _encoder.encode(self).decode()


def thinned(plan: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return at most ``MOST_PLAN_POINTS`` points (K, 2) of a plan, including both ends."""
    if len(plan) <= MOST_PLAN_POINTS:
        return plan
    return plan[np.linspace(0, len(plan) - 1, MOST_PLAN_POINTS).round().astype(int)]


def _from_array(array: Any) -> Any:
    if not isinstance(array, np.ndarray):
        raise NotImplementedError(type(array).__name__)
    return (array if array.dtype == np.bool_ else array.round(_DECIMALS)).tolist()


_encoder = msgspec.json.Encoder(enc_hook=_from_array)


def encode_all(frames: list[Frame]) -> bytes:
    return _encoder.encode(frames)
