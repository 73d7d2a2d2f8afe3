"""Guard an environment against calls from several threads, which would write the same arrays in machine code.

The calls form a queue. An exclusive call changes or copies the games; it is refused if another thread's exclusive call
is in the queue. A shared call only reads, and waits for its turn. The queue is a list instead of a lock: inserting and
removing are atomic and cheap, an interrupted call removes itself, and a forked process can drop calls of lost threads.
"""

import functools
import os
import sys
import time
import weakref
from collections.abc import Callable
from threading import get_ident
from traceback import walk_stack
from typing import Any, Self, TypeVar, cast

Method = TypeVar("Method", bound=Callable[..., Any])
_objects: "weakref.WeakValueDictionary[int, Guarded]" = weakref.WeakValueDictionary()
_IN_USE = "{}(): {} thread is in {}() of this environment; end it first, or use one environment per thread"


class Guard:
    """The queue of an environment's calls, the newest first; the last call is running."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, str, bool]] = []  # thread, name, True if exclusive
        self.copying: tuple[int, int, Callable[[], Any]] | None = None  # thread, id of its frame, reference to a state

    def __reduce__(self) -> tuple[Any, ...]:
        self.copying = None  # the guard is the last part of the state
        return Guard, ()

    def wait(self, call: tuple[int, str, bool]) -> None:
        """Wait for the turn of this thread; raises RuntimeError if an earlier call refuses this exclusive call."""
        me, name, exclusive = call
        earlier = self.calls[::-1] if exclusive else [call]
        while earlier[0] is not call and (earlier[0][0] != me or name != "close"):
            thread, other, excludes = earlier.pop(0)
            if thread == me or excludes:
                raise RuntimeError(_IN_USE.format(name, "this" if thread == me else "another", other))
        if exclusive and (copying := self.copying):
            thread, function, state = copying
            stack = sys._current_frames().get(thread) if thread != me and state() else None
            if stack and any(id(frame) == function for frame, _ in walk_stack(stack)):
                raise RuntimeError(_IN_USE.format(name, "another", "copy"))
            self.copying = None  # an error may keep the state of a copy that failed
        while self.calls[-1][0] != me:
            time.sleep(0.0002)


def exclusive(method: Method, exclusive: bool = True) -> Method:
    """Make a method of a :class:`Guarded` class exclusive, or shared if not ``exclusive``."""
    name = "copy" if method.__name__ == "__getstate__" else method.__name__

    @functools.wraps(method)
    def guarded(self: "Guarded", *arguments: Any, **named: Any) -> Any:
        guard, call = self._guard, (get_ident(), name, exclusive)
        calls = guard.calls
        try:
            calls.insert(0, call)
            if calls[-1] is not call or guard.copying is not None:
                guard.wait(call)
            return method(self, *arguments, **named)
        finally:
            calls.remove(call)  # the newest of equal ones

    return cast(Method, guarded)


shared = functools.partial(exclusive, exclusive=False)


class Guarded:
    """Base class of objects with exclusive and shared methods; copying them is exclusive, too."""

    _guard: Guard
    _runner: Any = None  # a wrapper has no games

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """Create the guard before anything else; ``close`` of an object whose creation failed needs it."""
        self = super().__new__(cls)
        self._guard = Guard()
        _objects[id(self)] = self
        return self

    @exclusive
    def __getstate__(self) -> dict[str, Any]:
        """Return the state; exclusive calls of other threads are refused until it is copied or discarded."""
        state: Any = super().__getstate__()
        self._guard.copying = get_ident(), id(sys._getframe(2)), weakref.ref(mark := {"copying"})
        return {**{key: state[key] for key in state if key != "_guard"}, "_mark": mark, "_guard": self._guard}


def _drop_lost_calls() -> None:
    """Drop calls whose threads do not exist after a fork; games that a dropped call was changing need a reset."""
    for one in list(_objects.values()):
        calls, me = one._guard.calls, get_ident()
        if calls and calls[-1][0] != me and calls[-1][2] and one._runner is not None:
            one._runner.begun = False
        calls[:] = [call for call in calls if call[0] == me]


os.register_at_fork(after_in_child=_drop_lost_calls)
