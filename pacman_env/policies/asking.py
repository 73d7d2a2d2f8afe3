"""Asking a policy that a user wrote: what is wrong with it becomes one line, which names it and the place."""

from __future__ import annotations

import contextlib
import sys
import traceback
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pacman_env.config import Config
    from pacman_env.policies.base import Policy
    from pacman_env.sim.observation.situation import Situation


class PolicyError(ValueError):
    """A user's policy raises something, or answers with what cannot be played."""


def choose(policy: Policy, situation: Situation) -> NDArray[np.int64]:
    """(N,) the candidates that a policy chooses; raises PolicyError where they are none, or ``select`` fails."""
    if not _is_users(type(policy)):
        return policy.select(situation)
    name = name_of(policy)
    with what_users_raise(type(policy), name):
        chosen = policy.select(situation)
    n, candidates = situation.mask.shape
    chosen = np.asarray(chosen)
    if chosen.shape != (n,) or chosen.dtype.kind not in "iu":
        got = f"{chosen.dtype} of shape {chosen.shape}"
        raise PolicyError(f"policy {name!r}: select must return {n} integers, got {got}")
    if n > 0 and not 0 <= chosen.min() <= chosen.max() < candidates:
        bad = chosen[(chosen < 0) | (chosen >= candidates)][0]
        raise PolicyError(f"policy {name!r}: select must return candidates 0 to {candidates - 1}, got {bad}")
    return chosen


def reset(policy: Policy, games: NDArray[np.bool_], config: Config) -> None:
    """The policy's ``reset``; raises PolicyError where a user's fails."""
    with what_users_raise(type(policy), name_of(policy)):
        policy.reset(games, config)


def checked_scores(policy: Policy, scores: Any, situation: Situation) -> NDArray[np.float64]:
    """The scores (N, C) as an array; raises PolicyError for another shape, or NaN where a candidate may be chosen."""
    array = np.asarray(scores)
    wanted = situation.mask.shape
    if array.shape != wanted:
        got = "None" if scores is None else array.shape
        raise PolicyError(f"policy {name_of(policy)!r}: scores must be {wanted}, got {got}")
    bad = (array != array) & situation.mask
    if bad.any():
        game, candidate = np.argwhere(bad)[0].tolist()
        raise PolicyError(f"policy {name_of(policy)!r}: the score of candidate {candidate} in game {game} is NaN")
    return array


def scores(policy: Policy, situation: Situation) -> NDArray[np.float64]:
    """(N, C) the policy's scores, to be shown; raises PolicyError if they are none, or a user's ``scores`` fails."""
    with what_users_raise(type(policy), name_of(policy)):
        return checked_scores(policy, policy.scores(situation), situation)


def name_of(policy: Policy) -> str:
    """What errors call it: the place of a user's class as ``module:Class``, else its name."""
    kind = type(policy)
    return f"{kind.__module__}:{kind.__qualname__}" if _is_users(kind) else policy.name


@contextlib.contextmanager
def what_users_raise(code: Any, name: str) -> Iterator[None]:
    """PolicyError instead of what the block raises, where the class or function ``code`` is not the package's."""
    try:
        yield
    except PolicyError:
        raise
    except Exception as error:
        if not _is_users(code):
            raise
        text = f"policy {name!r}: {type(error).__name__}: {error}"
        raise PolicyError(text + _place(error, code)) from error


def _is_users(code: Any) -> bool:
    return str(getattr(code, "__module__", "")).partition(".")[0] != __package__.partition(".")[0]


def _place(error: Exception, code: Any) -> str:
    """File and line of the last call in the user's file, in brackets."""
    file = getattr(sys.modules.get(code.__module__), "__file__", None)
    lines = [call.lineno for call in traceback.extract_tb(error.__traceback__) if call.filename == file]
    return f" ({file}, line {lines[-1]})" if lines else ""
