"""Play decisions in a batch: allowed choices, the choices of ghost policies, and ticks until the next decision.

Environments, rounds of policies and the operator page play with these functions.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Flags, Indices, Policy
from pacman_env.policies.policy_calls import choose
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.ghost_state import GHOST_CHOICE, choices_of


def allowed(situation: Situation, choices: Indices, hold: int) -> Indices:
    """Return the choices (N,) as the executor applies them: forbidden or invalid ones become hold."""
    valid = (choices >= 0) & (choices < situation.mask.shape[1])
    valid &= situation.mask[np.arange(len(choices)), np.where(valid, choices, hold)]
    return np.where(valid, choices, hold)


def ghost_choices(
    batch: GameBatch,
    policies: Mapping[int, Policy],
    given: Mapping[int, NDArray[Any]] = MappingProxyType({}),
    select: Callable[[Policy, Situation], Any] = choose,
) -> NDArray[Any] | None:
    """Return the choices (N, G) of ghosts that ``policies`` move or that are ``given``, by ghost number.

    The choices of a ghost (N,) are candidates, or records of type ``GHOST_CHOICE``. ``select`` calls a policy. Returns
    None without policies and given choices. Raises ValueError if a policy returns anything else.
    """
    if not (policies or given):
        return None
    choices = np.zeros(batch.ghosts.shape, dtype=GHOST_CHOICE)
    for number, policy in policies.items():
        chosen = np.asarray(select(policy, situation_of(batch, number)))
        if chosen.shape != (batch.n,) or (chosen.dtype != GHOST_CHOICE and chosen.dtype.kind not in "iu"):
            wanted, got = f"{batch.n} integers", f"{chosen.dtype} of shape {chosen.shape}"
            raise ValueError(f"ghosts[{number}]: select must return {wanted}, got {got}")
        choices[:, number] = choices_of(chosen)
    for number, chosen in given.items():
        choices[:, number] = choices_of(chosen)
    return choices


def play_until_due(
    batch: GameBatch,
    choices: NDArray[Any],
    forbidden: Flags | None = None,
    choose_for_ghosts: Callable[[], NDArray[Any] | None] | None = None,
    played: Flags | None = None,
) -> None:
    """Play until the next decision is due: one tick, or with ``decisions.when="event"`` until an event of each game.

    ``choices`` are candidates (N,) or velocities (N, 2). After a ``forbidden`` (N,) choice (None: there is none), the
    next decision is due after one tick. ``choose_for_ghosts`` is called before each tick (None: no policy moves a
    ghost). Only the games in the mask ``played`` (N,) are played (None: all).
    """
    if batch.config.decisions.when == "event":
        forbidden = np.zeros(batch.n, dtype=np.bool_) if forbidden is None else forbidden
        batch.step_until_due(choices, forbidden, choose_for_ghosts, played)
    else:
        batch.step(choices, choose_for_ghosts() if choose_for_ghosts else None, played)
