"""Schema of the messages that a page may send (docs/dev/web_protocol.md, "What a page sends")."""

from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from pacman_env.web.orders import Moves

Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Word = Annotated[str, Meta(max_length=100)]
Name = Annotated[str, Meta(min_length=1, max_length=200)]
Value = bool | int | float | str | None
Seed = Annotated[int, Meta(ge=0, lt=2**53)]  # JavaScript numbers are float64
ClydeMps = Annotated[float, Meta(ge=0.05, le=2.0)]  # m/s in round 1


class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="do", tag=str.lower):
    id: int = 0  # the answer gets this id; 0: no answer


class Start(Message, frozen=True):
    same: bool = False  # the last round again, with its seed


class Reset(Message, frozen=True): ...  # abort the round and go back to the menu


class Pause(Message, frozen=True):
    on: bool


class Speed(Message, frozen=True):
    times: Annotated[float, Meta(ge=1, le=50)]  # simulated time relative to real time


class Setup(Message, frozen=True):
    """Settings of the next rounds; omitted fields stay unchanged."""

    map: Name | None = None
    level: Annotated[int, Meta(ge=0, lt=2**31)] | None = None
    preset: Name | None = None
    policy: Name | None = None
    second: Name | None = None
    ghosts: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=4)] | None = None
    clyde_mps: ClydeMps | None = None
    seed: Seed | None = None
    settings: dict[Name, Value] | None = None
    finish: bool = False  # play the round to its end as fast as possible
    moves: Moves | None = None  # orders of people, as in a link
    until: Annotated[int, Meta(ge=0)] = 0  # number of ticks to play with these orders before the start


class ClydeSpeed(Message, frozen=True, tag="clyde_speed"):
    mps: ClydeMps


class PlaceClyde(Message, frozen=True, tag="place_clyde"):
    x: Number
    y: Number
    ghost: Annotated[int, Meta(ge=0, le=3)] = 0


class SetPose(Message, frozen=True, tag="set_pose"):
    """Pose of the robot for its localization, m and rad."""

    x: Number
    y: Number
    heading: Annotated[float, Meta(ge=-7, le=7)]


class Continue(Message, frozen=True): ...  # accept the believed pose after a jump


class Stop(Message, frozen=True): ...  # stop the robot at once, until the release


class Release(Message, frozen=True): ...


class Control(Message, frozen=True):
    what: Literal["take", "ask", "give", "keep"]


class Role(Message, frozen=True):
    role: Literal["robot", "ghost-0", "ghost-1", "ghost-2", "ghost-3", "none"]


class Goal(Message, frozen=True):
    """A goal for the sender's role: a candidate (-1: hold), a place, or the robot (for a ghost)."""

    candidate: Annotated[int, Meta(ge=-1, lt=65536)] | None = None
    follow: bool = False  # follow the robot
    x: Number | None = None
    y: Number | None = None


class Drive(Message, frozen=True):
    """Velocity command, m/s and rad/s; the robot stops 0.5 s after the last command."""

    v: Annotated[float, Meta(ge=-10, le=10)]
    omega: Annotated[float, Meta(ge=-10, le=10)]


class Event(Message, frozen=True):
    word: Word
    what: Literal["event", "light", "sound"] = "event"


class Arm(Message, frozen=True):
    on: bool  # True: the robot moves at events


class Watch(Message, frozen=True):
    why: bool = False  # the page shows the terms
    lidar: bool = False


class Why(Message, frozen=True):
    story: Annotated[int, Meta(ge=1)]  # number of a recorded round
    tick: Annotated[int, Meta(ge=0)]


class Compare(Message, frozen=True):
    """Play a recorded round of the policy again with the second policy."""

    story: Annotated[int, Meta(ge=1)]


class Stories(Message, frozen=True): ...  # list the recorded rounds


class Ready(Message, frozen=True): ...  # list the readiness checks


class Ping(Message, frozen=True): ...


MOST_BYTES = 262_144  # largest message; maps are uploaded over HTTP
FOR_ALL = (Stop, Watch, Why, Stories, Ready, Ping)  # viewers may send these, too
_decoder: msgspec.json.Decoder[Message] = msgspec.json.Decoder(reduce(or_, Message.__subclasses__()))


def parse(text: str | bytes) -> Message:
    """Parse a message; raises ValueError with the place of the error if the text is invalid."""
    if len(text) > MOST_BYTES:
        raise ValueError(f"a message of {len(text)} bytes: at most {MOST_BYTES}")
    try:
        return _decoder.decode(text)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ValueError(f"bad message: {error}") from error


def as_json(value: Any) -> str:
    """Return a value as JSON text; NaN and infinity become null."""
    return msgspec.json.encode(value).decode()
