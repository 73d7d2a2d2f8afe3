"""Schema of the message ``frame``, the state of a game at one moment, which the page reads by field name.

The comment of a field is its row in docs/dev/web_protocol.md (``python -m tools.reference``).
"""

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
    """Fields of a frame that are left out if they have no value; the last four are of games with power pellets."""

    lives: int | UnsetType = UNSET  # remaining lives of the person who plays the robot of a simulated game
    begins_in_s: Seconds | UnsetType = UNSET  # remaining time of the show before a round; only during it
    ghosts_caught: int | UnsetType = UNSET  # in this round, if there are power pellets
    harmless_s: Times | UnsetType = UNSET  # for each ghost how long it stays frightened or away; 0: it is dangerous
    away_s: Times | UnsetType = UNSET  # for each ghost how long it stays away after it was caught; 0: it is present
    points: PlacedPoints | UnsetType = UNSET  # [[x, y, points], ...] of the ghosts that were caught in the last 2 s


class Frame(OptionalFields, frozen=True, tag_field="kind", tag="frame"):
    """State of a game at one moment. NaN becomes null in JSON."""

    state: State  # `menu`, `returning_home`, `starting`, `running`, `dying` or `complete`
    revision: int  # of the scene to which the frame belongs
    number: int  # of the frame; it increases with each change
    time_s: Seconds = 0.0  # since the round began
    speed: float = 1.0  # simulated time relative to real time; 1 on a robot
    score: int = 0  # points over all rounds
    collected: int = 0  # pellets of this round
    spawned: int = 0  # pellets at the start of the round
    round: int = 1  # from 1
    goal: int = -1  # current candidate, -1: none
    paused: bool = False  # simulated time stands still
    stopped: bool = False  # STOP was pressed
    over: bool = False  # the round has ended
    true: Pose | None = None  # true pose of the robot [x, y, heading], null: unknown
    believed: Pose | None = None  # pose that the robot estimates, null: unknown
    velocity: tuple[MetresPerSecond, RadiansPerSecond] = (0.0, 0.0)  # [v, omega]
    baseline: Pose | None = None  # pose of the policy's robot in the same round while a person plays, else null
    baseline_collected: int = 0  # pellets that this robot has collected
    ring: Ring | None = None  # six LEDs [[red, green, blue], ...], 0 to 255; null: not controlled by the game
    ghosts: Points = field(default_factory=lambda: np.zeros((0, 2)))  # [[x, y], ...]
    ghost_goals: Points = field(default_factory=lambda: np.zeros((0, 2)))  # where a person sent each ghost, null: none
    alive: Present = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))  # for each pellet: not collected yet
    scores: Scores = field(default_factory=lambda: np.zeros(0))  # of the candidates, null: none
    plan: Points = field(default_factory=lambda: np.zeros((0, 2)))  # path to the goal [[x, y], ...], at most 64 points
    scan: Ranges = field(default_factory=lambda: np.zeros(0))  # ray 0 ahead, then counter-clockwise; null: no hit

    def encode(self) -> str:
        return _encoder.encode(self).decode()


def thinned(plan: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return at most ``MOST_PLAN_POINTS`` points (K, 2) of a plan, including both ends."""
    return plan[np.linspace(0, len(plan) - 1, min(len(plan), MOST_PLAN_POINTS)).round().astype(int)]


def _from_array(array: Any) -> Any:
    return (array if array.dtype == np.bool_ else array.round(_DECIMALS)).tolist()


_encoder = msgspec.json.Encoder(enc_hook=_from_array)


def encode_all(frames: list[Frame]) -> bytes:
    return _encoder.encode(frames)
