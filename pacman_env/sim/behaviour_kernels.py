"""Compile kernels that call the function of a ghost's behaviour."""

import functools
import threading
import types
from collections.abc import Callable

from ..engine.jit import kernel
from ..game.ghosts import BEHAVIOURS, Behaviour

_making = threading.Lock()  # a second kernel from another thread would free the machine code of the first


def target_of(view, constants):  # type: ignore[no-untyped-def]
    """Stand for the function of a behaviour, which each copy of a kernel calls instead."""


CONSTANTS = 0  # replaced by the number of the behaviour's constants


def behaviour_kernel(function: Callable[..., int], behaviour: Behaviour) -> Callable[[int, int, int], int]:
    """Compile a copy of ``function`` that calls the behaviour's function as ``target_of``."""
    with _making:
        return _make(function, behaviour)


@functools.cache
def _make(function: Callable[..., int], behaviour: Behaviour) -> Callable[[int, int, int], int]:
    assert behaviour.target is not None
    own = BEHAVIOURS.get(behaviour.name) == behaviour
    inlined = {"target_of": kernel(behaviour.target, own), "CONSTANTS": len(behaviour.parameters)}
    copy = types.FunctionType(function.__code__, {**function.__globals__, **inlined}, function.__name__)
    copy.__module__ = function.__module__
    copy.__qualname__ = f"{function.__name__}_{behaviour.name if own else 'from_outside'}"
    return kernel(copy, own)
