"""``search``: plans against ghosts that react, on a coarse model of the game; elsewhere the choice of a base policy."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.engine.jit import kernel
from pacman_env.game.ghosts import WANDER, Behaviour, find_behaviour
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.registry import make_policy
from pacman_env.rng import POLICY, stream
from pacman_env.sim.coarse.coarse_map import coarse_map
from pacman_env.sim.coarse.model import (
    GHOST,
    MOST_PELLETS,
    NOWHERE,
    Behaviours,
    Lags,
    Model,
    begin,
    put_ghost,
    put_robot,
    rules,
)
from pacman_env.sim.observation.situation import HOLD, PELLET, REFUGE, Nearest, Situation, nearest_candidates

from .beam import DEAD, NODE, PRUNED, SETTINGS, Room, new_room, search


class Parameters(NamedTuple):
    """Numbers of the search, by hand."""

    nodes: int = 12_000  # segments played for a decision
    milliseconds: float | None = None  # in place of that: wider searches until the time is spent
    samples: int = 2  # futures of the ghosts that wander, where others do not
    horizon_s: float = 48.0
    layer_s: float = 1.5
    segment_s: float = 3.0
    pellets: int = 5
    refuges: int = 6
    pellet_worth: float = 10.0
    second_worth: float = 0.1
    completion_worth: float = 20.0
    lead_worth: float = 15.0
    lead_m: float = 4.0
    metre_worth: float = 0.5
    near_worth: float = 4.0
    near_m: float = 0.8
    keep_worth: float = 0.5  # the goal pursued now is worth so much more
    seed: int = 0


_NARROWEST = 4


@kernel
def _put(robot, ghosts, model, pose, seen):  # type: ignore[no-untyped-def]
    put_robot(robot[0], model, pose[0], pose[1], pose[2])
    for k in range(len(ghosts)):
        put_ghost(ghosts[k], model, seen[k, 0], seen[k, 1], seen[k, 4])
        ghosts[k].vx, ghosts[k].vy = seen[k, 2], seen[k, 3]


@kernel
def _begin(robot, goal, left_m, model):  # type: ignore[no-untyped-def]
    begin(robot[0], goal, left_m, model)


_stream = kernel(stream)


class Search(BasePolicy):
    """The rule; every parameter can be given by name.

    ``base`` is the policy that chooses where no ghost can be predicted.
    """

    name = "search"

    def __init__(self, base: str = "ppo", **parameters: Any) -> None:
        self.parameters = Parameters(**parameters)
        self.base: Policy = make_policy(base)
        self._room: Room | None = None
        self._known: tuple[Behaviour, ...] = ()
        self._prepare()

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        changed = config is not self.config
        super().reset(games, config)
        self.base.reset(games, config)
        if changed:
            self._prepare()

    def _prepare(self) -> None:
        self._known = self.behaviours(self.config)
        self._behaviours = Behaviours(self._known, self.config)
        p = self.parameters
        s = np.zeros(1, dtype=SETTINGS)
        for name in SETTINGS.names or ():
            if name not in ("width", "layers"):
                s[name] = getattr(p, name)
        s["layers"] = round(p.horizon_s / p.layer_s)
        self._settings = s

    def behaviours(self, config: Config) -> tuple[Behaviour, ...]:
        """What each ghost is taken to do, by number: what the configuration says."""
        return tuple(find_behaviour(name) for name in config.clyde.ghosts)

    @staticmethod
    def predictable(behaviours: Sequence[Behaviour]) -> bool:
        """Whether search is worth while: a ghost follows a function of what it sees."""
        return any(one.target is not None and one.name != WANDER for one in behaviours)

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C) the value of the best line that begins with each candidate; where nothing can be predicted, the base's."""
        if not self.predictable(self._known):
            return self.base.scores(situation)
        order = nearest_candidates(situation, Nearest(self.parameters.pellets, self.parameters.refuges))
        scores = np.full(situation.mask.shape, -np.inf)
        for i in range(len(situation)):
            candidates = order[i][order[i] >= 0]
            candidates = candidates[situation.mask[i, candidates] & np.isfinite(situation.path_robot[i, candidates])]
            if len(candidates) > 0:
                scores[i, candidates] = self._values(situation, i, candidates)
        return scores

    def _values(self, s: Situation, i: int, candidates: NDArray[np.int64]) -> NDArray[np.float64]:
        """(R,) of the candidates of one situation."""
        assert s.maps is not None
        p, assets = self.parameters, s.maps.assets(int(s.level[i]))
        bit = np.full(len(assets.goal_xy), -1, dtype=np.int8)
        pellets = np.flatnonzero(s.mask[i] & (s.kind[i] == PELLET) & np.isfinite(s.path_robot[i]))
        pellets = pellets[np.argsort(s.path_robot[i, pellets], kind="stable")][:MOST_PELLETS]
        bit[s.goal[i, pellets]] = np.arange(len(pellets))
        numbers = rules(self.config, Lags())
        apart = np.hypot(*(s.ghosts[i, :, :2] - s.robot[i, :2]).T).min()
        # A ghost that is nearer than the margin has not caught the robot yet.
        numbers["death_m"] = max(self.config.execution.death_radius_m, min(numbers["death_m"][0], apart - 0.05))
        model = Model(coarse_map(assets), numbers, self._behaviours.table.address, bit)
        root, ghosts = np.zeros(1, dtype=NODE), np.zeros(s.ghosts.shape[1], dtype=GHOST)
        root["time_s"] = s.time_s[i]
        root["pellets"] = (1 << len(pellets)) - 1
        _put(root, ghosts, model, s.robot[i], s.ghosts[i])
        goals = np.where(s.kind[i, candidates] == HOLD, NOWHERE, s.goal[i, candidates]).astype(np.int64)
        current = s.current[i]
        if current >= 0 and s.goal[i, current] >= 0 and np.isfinite(s.path_robot[i, current]):
            _begin(root, np.int64(s.goal[i, current]), np.float64(s.path_robot[i, current]), model)
        samples = p.samples if any(not one.target or one.name == WANDER for one in self._known) else 1
        total = np.zeros(len(goals))
        for sample in range(samples):
            for k in range(len(ghosts)):
                purpose = np.uint64(POLICY + 64 * (p.seed + 1) + 8 * sample + k)
                ghosts["stream"][k] = _stream(s.seed[i] ^ np.uint64(int(s.tick[i]) << 20), purpose)
            ghosts["target"] = -1
            total += self._search(root, ghosts, goals, model, assets.pellets, samples)
        total /= samples
        return total + p.keep_worth * (candidates == current)

    def _search(
        self, root: NDArray[Any], ghosts: NDArray[Any], goals: NDArray[np.int64], model: Model, refuges: int, share: int
    ) -> NDArray[np.float64]:
        p, s = self.parameters, self._settings
        best = np.empty(len(goals))
        choices = p.pellets + p.refuges + 1
        if p.milliseconds is None:
            widths = [max(p.nodes // (int(s["layers"][0]) * choices * share), 1)]
        else:
            widths = [_NARROWEST << k for k in range(12)]
        began = time.perf_counter()
        for width in widths:
            before = time.perf_counter()
            if self._room is None or len(self._room.kept) < width or self._room.ghosts.shape[2] != len(ghosts):
                self._room = new_room(width, len(ghosts), 64, s)
            s["width"] = width
            search(root, ghosts, goals, model, s, np.int64(refuges), self._room, best)
            now = time.perf_counter()
            # The next search is twice as wide.
            if p.milliseconds is not None and now - began + 2.0 * (now - before) > p.milliseconds / 1e3 / share:
                break
        return best
