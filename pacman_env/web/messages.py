"""What a page may say (docs/web_protocol.md, "what a page says"): a schema that each message is checked by."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Word = Annotated[str, Meta(max_length=100)]
Name = Annotated[str, Meta(min_length=1, max_length=200)]
Value = bool | int | float | str | None
Seed = Annotated[int, Meta(ge=0, lt=2**53)]  # a number of the page is a float64


class Said(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag=str.lower):
    """One message; an answer names its ``id``."""


class Start(Said, frozen=True):
    """Begin a round."""

    id: int = 0


class Reset(Said, frozen=True):
    """Break off: back to the menu."""

    id: int = 0


class Pause(Said, frozen=True):
    """Hold the simulated time, or let it go on."""

    on: bool
    id: int = 0


class Speed(Said, frozen=True):
    """Of the simulated time."""

    times: Annotated[float, Meta(ge=1, le=50)]
    id: int = 0


class Setup(Said, frozen=True):
    """What the next rounds are; what is left out stays. ``finish``: play the round to its end as fast as can be."""

    map: Name | None = None
    level: Annotated[int, Meta(ge=0, lt=2**31)] | None = None
    preset: Name | None = None
    policy: Name | None = None
    second: Name | None = None
    ghosts: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=4)] | None = None
    clyde_mps: Annotated[float, Meta(ge=0.05, le=2.0)] | None = None
    seed: Seed | None = None
    settings: dict[Name, Value] | None = None
    finish: bool = False
    id: int = 0


class ClydeSpeed(Said, frozen=True, tag="clyde_speed"):
    """Clyde's speed of round 1."""

    mps: Annotated[float, Meta(ge=0.05, le=2.0)]
    id: int = 0


class PlaceClyde(Said, frozen=True, tag="place_clyde"):
    """Where a ghost starts; in the menu alone."""

    x: Number
    y: Number
    ghost: Annotated[int, Meta(ge=0, le=3)] = 0
    id: int = 0


class Stop(Said, frozen=True):
    """The robot stands at once, and stays so."""

    id: int = 0


class Release(Said, frozen=True):
    """After a stop: it may drive again."""

    id: int = 0


class Control(Said, frozen=True):
    """Of the operator's lease."""

    what: Literal["take", "ask", "give"]
    id: int = 0


class Role(Said, frozen=True):
    """Who one plays: ``robot``, ``ghost-0`` to ``ghost-3``, or ``none``."""

    role: Literal["robot", "ghost-0", "ghost-1", "ghost-2", "ghost-3", "none"]
    id: int = 0


class Goal(Said, frozen=True):
    """Where the one that a person plays goes: a candidate, -1 to hold, or the nearest candidate to a place."""

    candidate: Annotated[int, Meta(ge=-1, lt=65536)] | None = None
    x: Number | None = None
    y: Number | None = None
    id: int = 0


class Drive(Said, frozen=True):
    """Velocities by hand; 0.5 s after the last of them the robot stands."""

    v: Annotated[float, Meta(ge=-10, le=10)]
    omega: Annotated[float, Meta(ge=-10, le=10)]
    id: int = 0


class Event(Said, frozen=True):
    """Have an event, a light or a sound shown."""

    word: Word
    what: Literal["event", "light", "sound"] = "event"
    id: int = 0


class Arm(Said, frozen=True):
    """Whether the robot moves at events."""

    on: bool
    id: int = 0


class Watch(Said, frozen=True):
    """What the page shows beside the map."""

    why: bool = False
    lidar: bool = False
    id: int = 0


class Why(Said, frozen=True):
    """The terms of the candidates at one tick of a story."""

    story: Annotated[int, Meta(ge=1)]
    tick: Annotated[int, Meta(ge=0)]
    id: int = 0


class Stories(Said, frozen=True):
    """The rounds that have ended."""

    id: int = 0


class Ready(Said, frozen=True):
    """The readiness list."""

    id: int = 0


class Ping(Said, frozen=True):
    """Answered at once."""

    id: int = 0


Message = (
    Start
    | Reset
    | Pause
    | Speed
    | Setup
    | ClydeSpeed
    | PlaceClyde
    | Stop
    | Release
    | Control
    | Role
    | Goal
    | Drive
    | Event
    | Arm
    | Watch
    | Why
    | Stories
    | Ready
    | Ping
)
MOST_BYTES = 16_384  # of a message; a map is uploaded by another way
#: What one who only looks may say.
FOR_ALL = (Stop, Watch, Why, Stories, Ready, Ping)
_decoder = msgspec.json.Decoder(Message)


def parse(text: str | bytes) -> Message:
    """A message from its JSON.

    Raises:
        ValueError: it is none; the words say where.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"a message of {len(text)} bytes: at most {MOST_BYTES}")
    try:
        return _decoder.decode(text)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ValueError(f"bad message: {error}") from error


def as_json(value: Any) -> str:
    """JSON; NaN and infinity become null."""
    return msgspec.json.encode(value).decode()
