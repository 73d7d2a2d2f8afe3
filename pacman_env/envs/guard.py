"""Guard an environment against calls from several threads, which would write the same arrays in machine code.

The calls of an environment form a queue. An exclusive call changes the games or copies them; it raises RuntimeError if
another thread's exclusive call is in the queue. A shared call only reads, and waits for its turn. The queue is a list
instead of a lock: appending to a list and removing from it are atomic, a call removes its own entry even after Ctrl-C,
and a forked process can drop the entries of the threads that it does not have.
"""

import functools
import os
import sys
import time
import weakref
from collections.abc import Callable
from threading import get_ident
from types import FrameType
from typing import Any, Self, TypeVar, cast

_POLL_S = 0.0002
_Kind = tuple[str, bool]  # name of a call, True if it is exclusive
Method = TypeVar("Method", bound=Callable[..., Any])


class Guard:
    """The queue of an environment's calls: the running call and the calls that wait for it."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, _Kind]] = []  # with the thread of each call
        self.copying: Callable[[], _Copying | None] | None = None  # a weak reference
        self.lost = False  # True in a forked process if a lost thread was changing the games
        _guards.add(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return Guard, ()

    def contains(self, entry: tuple[int, _Kind]) -> bool:
        """Return True if the thread is in another call already; raises RuntimeError if it must not begin this one."""
        thread, (name, exclusive) = entry
        outer = next((other for running, (other, _) in self.calls.copy() if running == thread), None)
        if outer is not None and exclusive and name != "close":
            raise RuntimeError(f"{name}() was called within {outer}() of the same environment: call it afterwards")
        return outer is not None

    def wait(self, env: "Guarded", entry: tuple[int, _Kind]) -> None:
        """Wait for the turn of a call; raises RuntimeError if it and another thread's call are exclusive."""
        thread, (name, exclusive) = entry
        calls = self.calls.copy()
        for _, (other, other_exclusive) in calls[: calls.index(entry)]:
            if exclusive and other_exclusive:
                raise _in_use(name, other)
        while self.calls[0] is not entry:
            time.sleep(_POLL_S)
        if self.lost:
            self.lost, self.copying = False, None
            env._give_up_games()
        reference = self.copying  # which the other thread may set to None
        copying = reference() if reference else None
        if exclusive:
            if copying and copying.thread != thread and copying.is_running():
                raise _in_use(name, "copy")
            self.copying = None  # left by a copy that failed


_guards: weakref.WeakSet[Guard] = weakref.WeakSet()


def _drop_lost_threads() -> None:
    """Drop the calls of threads that a fork did not copy to this process."""
    for guard in _guards:
        lost = [entry for entry in guard.calls if entry[0] != get_ident()]
        guard.calls[:] = [entry for entry in guard.calls if entry[0] == get_ident()]  # which this thread may be in
        if any(exclusive for _, (_, exclusive) in lost):
            guard.lost, guard.copying = True, lambda: None


os.register_at_fork(after_in_child=_drop_lost_threads)


class _Copying:
    """Last part of the state of a copy: until it is copied itself, exclusive calls of other threads are refused.

    A copy that fails drops its state. If an error keeps the state alive, the copying function runs no longer.
    """

    def __init__(self, guard: Guard, function: FrameType) -> None:
        self.thread = get_ident()
        self._guard, self._function = guard, id(function)
        guard.copying = weakref.ref(self)

    def is_running(self) -> bool:
        """Return True if the function that makes the copy is still on the stack of its thread."""
        frame = sys._current_frames().get(self.thread)
        while frame is not None and id(frame) != self._function:
            frame = frame.f_back
        return frame is not None

    def __reduce__(self) -> tuple[Any, ...]:
        self._guard.copying = None
        return type(None), ()


def exclusive_step(method: Method) -> Method:
    """Make ``method(self, action)`` exclusive; faster than :func:`exclusive`."""
    return cast(Method, functools.wraps(method)(_guarded(("step", True), method)))


def exclusive(method: Method) -> Method:
    """Make a method of a :class:`Guarded` class exclusive."""
    return _with_any_arguments(method, True)


def shared(method: Method) -> Method:
    """Make a method of a :class:`Guarded` class wait for other threads' calls."""
    return _with_any_arguments(method, False)


def _with_any_arguments(method: Method, exclusive: bool) -> Method:
    kind = method.__name__.strip("_"), exclusive
    guarded = _guarded(kind, lambda self, given: method(self, *given[0], **given[1]))

    @functools.wraps(method)
    def call(self: Any, *arguments: Any, **named: Any) -> Any:
        return guarded(self, (arguments, named))

    return cast(Method, call)


def _guarded(kind: _Kind, method: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return the method with the guard, in few instructions: a step of one game takes 12 us."""

    def call(self: "Guarded", action: Any) -> Any:
        guard = self._guard
        calls, entry = guard.calls, (get_ident(), kind)
        if calls and guard.contains(entry):
            return method(self, action)
        try:
            calls.append(entry)
            if calls[0] is not entry or guard.copying is not None:
                guard.wait(self, entry)
            return method(self, action)
        finally:
            calls.remove(entry)  # no other thread has an equal one

    return call


class Guarded:
    """Base class of objects with exclusive and shared methods; copying them is exclusive, too."""

    _guard: Guard

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """Create the guard before anything else; ``close`` of an object whose creation failed needs it."""
        self = super().__new__(cls)
        self._guard = Guard()
        return self

    def __getstate__(self) -> dict[str, Any]:
        return self._copy(sys._getframe(1))

    @exclusive
    def _copy(self, function: FrameType) -> dict[str, Any]:
        state = cast(dict[str, Any], super().__getstate__())
        return {**state, "_copying": _Copying(self._guard, function)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__dict__.pop("_copying", None)

    def _give_up_games(self) -> None:
        """Require a reset after a fork during a step; a wrapper has no games of its own."""


def _in_use(name: str, other: str) -> RuntimeError:
    return RuntimeError(f"{name}(): another thread is in {other}() of this environment; use one environment per thread")
