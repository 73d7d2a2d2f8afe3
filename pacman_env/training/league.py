"""The league of a training: Clydes that learned against the planner on its way, and how often each is met.

A line-up names such a ghost ``learned``. Before there is a member, ``arcade`` and ``chase`` play in its place. A member
is drawn the more often, the more rounds the planner loses to it (prioritised fictitious self-play: Vinyals et al.,
"Grandmaster level in StarCraft II", 2019, with f(x) = 1 - x).
"""

import contextlib
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from pacman_env.executors.base import Executor
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.training.arguments import Arguments
from pacman_env.training.collector import Collector
from pacman_env.training.export import export_planner, network_of
from pacman_env.training.facts import facts_of
from pacman_env.training.games import make_ghost_parts
from pacman_env.training.learner import Learner
from pacman_env.training.lineups import LEARNED

_GAMES, _STEPS = 128, 64  # of Clyde at once, and between two updates
_RATE = 1e-3, 1e-4  # its learning rate, first and last
_GAMMA = 0.99
_DECISIONS, _SPEED_MPS = 131_072, (0.1, 0.35)
_STREAM = 1  # of its random numbers, beside the planner's

#: Of each member, by name: rounds that the planner completed against it, and rounds.
Record = Mapping[str, tuple[int, int]]


class League:
    """The members that a run has so far, as ONNX files in a folder."""

    def __init__(self, arguments: Arguments, folder: Path) -> None:
        self._arguments, self._folder = arguments, folder

    def names(self, segment: int) -> list[str]:
        """The members there are in a segment: one more after every ``league_every`` segments."""
        every = self._arguments.hyper.league_every
        return [f"clyde-{k + 1}" for k in range(segment // every if every else 0)]

    def path(self, name: str) -> Path:
        return self._folder / f"{name}.onnx"

    def is_due(self, segment: int) -> bool:
        """Whether a member is trained before a segment."""
        every = self._arguments.hyper.league_every
        return every > 0 and segment > 0 and segment % every == 0

    def train(self, segment: int, planner: Policy, executor: Executor) -> None:
        """Train the member that is due against the planner as it is.

        Every other one begins anew and so finds weaknesses of its own; the others begin as the member before them.
        """
        names = self.names(segment)
        arguments = clyde_arguments(self._arguments)
        seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment, _STREAM)).generate_state(2).tolist()
        learner = Learner(arguments.hyper, seeds[0], threads=arguments.threads)
        if len(names) % 2 == 0:
            learner.network.load_state_dict(network_of(self.path(names[-2])).state_dict())
        torch.manual_seed(seeds[0])
        bar = tqdm(disable=True)
        parts = make_ghost_parts(arguments, segment, planner)
        with contextlib.closing(Collector(parts, executor)) as games:
            learner.learn(games, arguments.hyper.decisions, seeds[1], bar)
        export_planner(learner.network, self.path(names[-1]), facts_of(arguments, learner.decisions, {}))

    def pool(self, segment: int, record: Record) -> Opponents:
        """What moves a ghost called ``learned`` in a segment, after the rounds in ``record``."""
        names = self.names(segment)
        if not names:
            return Opponents([BehaviourOpponent("arcade"), BehaviourOpponent("chase")], [1.0, 1.0])
        counts = [record.get(name, (0, 0)) for name in names]
        # One round lost and one completed are assumed, so that no member is forgotten.
        return Opponents(
            [LearnedPlanner(self.path(name)) for name in names], [(n - won + 1) / (n + 2) for won, n in counts]
        )

    def record(
        self, segment: int, seeds: NDArray[np.uint64], completed: NDArray[np.bool_], pool: Opponents
    ) -> dict[str, tuple[int, int]]:
        """What came of rounds (E,) with these seeds that were played with the pool of a segment."""
        drawn = pool.drawn(seeds)
        names = enumerate(self.names(segment))
        return {name: (int(completed[drawn == k].sum()), int((drawn == k).sum())) for k, name in names}


def clyde_arguments(arguments: Arguments) -> Arguments:
    """Those of a Clyde's games and learning, from the planner's."""
    hyper = arguments.hyper
    rollout = _GAMES * _STEPS
    changes: dict[str, Any] = {"games": _GAMES, "n_steps": _STEPS, "segment": rollout, "batch_size": rollout // 4}
    changes |= {"decisions": _DECISIONS, "learning_rate": _RATE, "cycles": 1, "gamma": _GAMMA}
    changes |= {"ghosts": (LEARNED,), "clyde_speed": _SPEED_MPS, "decide": "tick", "imitation": 0}
    return dataclasses.replace(arguments, hyper=dataclasses.replace(hyper, **changes))
