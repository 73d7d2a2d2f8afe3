"""Call users' policies, and convert their errors to one line with the policy's name and the place."""

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
    from pacman_env.observations.situation import Situation
    from pacman_env.policies.base import Policy


class PolicyError(ValueError):
    """Raised if a user's policy fails or returns an invalid result."""


def choose(policy: Policy, situation: Situation) -> NDArray[np.int64]:
    """Return the candidates (N,) that a policy selects; raises PolicyError if they are invalid or ``select`` fails."""
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
    """Call the policy's ``reset`` for the games (N,); raises PolicyError if it fails and is a user's."""
    with what_users_raise(type(policy), name_of(policy)):
        policy.reset(games, config)


def checked_scores(policy: Policy, scores: Any, situation: Situation) -> NDArray[np.float64]:
    """Return scores (N, C) as an array; raises PolicyError for another shape or NaN of an allowed candidate."""
    array = np.asarray(scores)
    expected = situation.mask.shape
    if array.shape != expected:
        got = "None" if scores is None else array.shape
        raise PolicyError(f"policy {name_of(policy)!r}: scores must be {expected}, got {got}")
    bad = (array != array) & situation.mask
    if bad.any():
        game, candidate = np.argwhere(bad)[0].tolist()
        raise PolicyError(f"policy {name_of(policy)!r}: the score of candidate {candidate} in game {game} is NaN")
    return array


def scores(policy: Policy, situation: Situation) -> NDArray[np.float64]:
    """Return a policy's scores (N, C) for display; raises PolicyError if they are invalid or ``scores`` fails."""
    with what_users_raise(type(policy), name_of(policy)):
        return checked_scores(policy, policy.scores(situation), situation)


def name_of(policy: Policy) -> str:
    """Return the name of a policy in errors: ``module:Class`` for a user's policy, otherwise its name."""
    kind = type(policy)
    return f"{kind.__module__}:{kind.__qualname__}" if _is_users(kind) else policy.name


@contextlib.contextmanager
def what_users_raise(code: Any, name: str) -> Iterator[None]:
    """Convert exceptions in the block to PolicyError if a user wrote the class or function ``code``."""
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
    """Return file and line of the last call in the user's file, in brackets, or ""."""
    file = getattr(sys.modules.get(code.__module__), "__file__", None)
    lines = [call.lineno for call in traceback.extract_tb(error.__traceback__) if call.filename == file]
    return f" ({file}, line {lines[-1]})" if lines else ""
