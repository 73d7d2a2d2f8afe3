"""The kernels of the browser's game; two of them are only needed there: they begin rounds, and run the network."""

from typing import Any, NamedTuple

import numpy as np
from pymunk._chipmunk_cffi import ffi, lib

from pacman_env.engine.arrays import Array, arrays_by_address
from pacman_env.engine.jit import kernel
from pacman_env.engine.native import address_of_kernel
from pacman_env.game.behaviour_belief import BELIEVED
from pacman_env.game.ghosts import BEHAVIOURS, WANDER
from pacman_env.levels.level import level_arrays
from pacman_env.observations import planner_features, situation_kernel
from pacman_env.policies import forward_pass
from pacman_env.sim import coarse_model, ghost_state, kernels, ticks
from pacman_env.sim.behaviour_kernels import behaviour_kernel
from pacman_env.sim.ghost_state import spawn_ghost
from pacman_env.sim.parameters import GAME, GHOST
from pacman_env.world.navigation import physics

FIRST_FUNCTION = 1024  # first index of functions that are called by address, in the module's table
#: Functions of runtime.c for the functions of Chipmunk that ``physics.py`` calls, in its order.
_C_FUNCTIONS = "set_ends", "add_shape", "remove_shape", "give_body", "step_space", "take_body"


class StartArrays(NamedTuple):
    rules: Any = kernels.RuleArrays
    ghosts: Any = Array(GHOST, "N G")
    paths: Any = Array(np.int32, "N G l")  # cells of each ghost's path
    fresh: Any = Array(GAME, "N")  # first records of the rounds
    seeds: Any = Array(np.uint64, "N")
    wander_first: Any = Array(np.bool_, "G")


class _Layer(NamedTuple):
    weight: Any = Array(np.float32, "i o")
    bias: Any = Array(np.float32, "k o")


class _Network(NamedTuple):
    """The weights of the network, as in ``forward_pass._Network``."""

    whole: Any = _Layer
    own: Any = Array(np.float32, "f o")
    encode: Any = _Layer
    pooled: Any = _Layer
    encoded: Any = Array(np.float32, "i o")
    judge: Any = _Layer
    everything: Any = _Layer
    value: Any = _Layer


class PlannerArrays(NamedTuple):
    """Inputs and results of the network for one game."""

    network: Any = _Network
    mask: Any = Array(np.bool_, "1 C")
    candidates: Any = Array(np.float32, "1 C f")
    whole: Any = Array(np.float32, "1 w")
    logits: Any = Array(np.float64, "C")  # -inf outside the mask
    value: Any = Array(np.float64, "1")


_start_arrays, _planner_arrays = arrays_by_address(StartArrays), arrays_by_address(PlannerArrays)


@kernel
def begin_rounds(table, first, last):  # type: ignore[no-untyped-def]
    """Begin rounds in the games ``first`` to ``last - 1``, as ``GameBatch.reset`` does; return 0."""
    a = _start_arrays(table)
    index, rules = np.arange(first, last), a.rules
    kernels.reset_robots(rules.games, index, a.seeds, a.fresh, rules.levels)
    for i in range(first, last):
        for k in range(rules.alive.shape[1]):
            rules.alive[i, k] = k < rules.games[i].pellets
        rules.waits[i, :] = 0
        rules.aborts[i, :] = 0
    use_tf = rules.parameters[0].use_tf
    kernels.reset_ghosts(rules.games, index, a.ghosts, a.paths, rules.obstacles, a.wander_first, rules.levels, use_tf)
    return 0


@kernel
def place_ghost(table, number, cell):  # type: ignore[no-untyped-def]
    """Move ghost ``number`` of game 0 to a cell, as ``GameBatch.place_ghost`` does; return 0."""
    a = _start_arrays(table)
    g = a.rules.games[0]
    level = level_arrays(a.rules.levels[g.level])
    spawn_ghost(a.ghosts[0, number], cell, a.paths[0, number], level.ghost_xy)
    kernels.see_ghosts(g, a.ghosts[0], a.rules.obstacles[0])
    return 0


@kernel
def judge(table, first, last):  # type: ignore[no-untyped-def]
    """Write the logits of the candidates and the value of the situation; return the best candidate (-1: none)."""
    a = _planner_arrays(table)
    allowed = np.flatnonzero(a.mask[0])
    a.logits[:] = -np.inf
    own = np.empty((len(allowed), a.candidates.shape[2]), np.float32)
    for k in range(len(allowed)):
        own[k] = a.candidates[0, allowed[k]]
    counts = np.full(1, len(allowed))
    judged, values = forward_pass._judge(a.network, own, a.whole, np.zeros(len(allowed), np.int64), counts)
    best = -1
    for k in range(len(allowed)):
        a.logits[allowed[k]] = judged[k, 0]
        if best < 0 or judged[k, 0] > a.logits[best]:
            best = allowed[k]
    a.value[0] = values[0, 0]
    return best


#: Kernels that the page calls, by their names in the module.
ENTRY_KERNELS = {
    "begin_rounds": begin_rounds,
    "place_ghost": place_ghost,
    "play": ticks.play,
    "write_situations": situation_kernel.write_situations,
    "fill": planner_features._fill,
    "judge": judge,
}


def called_kernels() -> dict[str, Any]:
    """Return the kernels that kernels call by address, by their names in the module."""
    follow, decide = ghost_state._follow_behaviour, coarse_model._decide_behaviour
    own = {f"ghost_{one.name}": behaviour_kernel(follow, one) for one in BEHAVIOURS.values() if one.target}
    guessed = [BEHAVIOURS[name] for name in BELIEVED if name in BEHAVIOURS and name != WANDER]
    believed = {f"believed_{one.name}": behaviour_kernel(decide, one) for one in guessed}
    return own | believed | {"contact_step": physics._contact_step}


def called_functions() -> dict[str, int]:
    """Return the addresses in this process of what kernels call by address, by the names in the module."""
    chipmunk = zip(_C_FUNCTIONS, physics._CALLED, strict=True)
    c_functions = {name: int(ffi.cast("uintptr_t", ffi.addressof(lib, theirs))) for name, theirs in chipmunk}
    return {name: address_of_kernel(one) for name, one in called_kernels().items()} | c_functions
