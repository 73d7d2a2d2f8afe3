"""Random numbers for the rules: SplitMix64, one independent stream per game and purpose.

A stream is one uint64 of state; every draw returns the next state. The streams of a round depend only on its seed and
a purpose number, so that Clyde moves the same whatever the robot does.
"""

import math

import numpy as np

CLYDE, LOCALIZATION, NAVIGATION, POLICY, LEVEL, RANDOMIZE, LIDAR, ROUND, ODOMETRY = range(1, 10)
GHOSTS = 16  # purpose number of the first ghost after Clyde; the other ghosts have the next numbers

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_M1 = np.uint64(0xBF58476D1CE4E5B9)
_M2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


def mix(z):  # type: ignore[no-untyped-def]
    """Return a uint64 hash of ``z`` (uint64): SplitMix64's finalizer."""
    z = (z ^ (z >> _S30)) * _M1
    z = (z ^ (z >> _S27)) * _M2
    return z ^ (z >> _S31)


def stream(seed, purpose):  # type: ignore[no-untyped-def]
    """Return the first state (uint64) of the stream for one purpose of the round with this seed."""
    return mix(np.uint64(seed) + _GAMMA * np.uint64(purpose)) ^ (np.uint64(purpose) << _S27)


def uniform(state):  # type: ignore[no-untyped-def]
    """Return the next state and a float64 drawn uniformly from [0, 1)."""
    state = np.uint64(state) + _GAMMA
    return state, float(mix(state) >> _S11) * (1.0 / 9007199254740992.0)


def below(state, bound):  # type: ignore[no-untyped-def]
    """Return the next state and an integer drawn uniformly from [0, bound)."""
    state, u = uniform(state)
    return state, min(int(u * bound), bound - 1)


def normal(state):  # type: ignore[no-untyped-def]
    """Return the next state and a standard normal float64 (Box-Muller; the second number of the pair is not used)."""
    state, u = uniform(state)
    state, v = uniform(state)
    return state, math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2.0 * math.pi * v)
