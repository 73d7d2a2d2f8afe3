"""The policy ``search``: plans on a coarse model of the game if a ghost is predictable, else asks a base policy."""

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...game.behaviour_belief import BELIEVED, taken_for
from ...game.ghosts import POLICY, WANDER, Behaviour, find_behaviour
from ...observations.coarse_start import CoarseStart, draw_futures, start
from ...observations.learner_layout import NearestCounts, nearest_candidates
from ...observations.situation import Situation
from ...policies.base import BasePolicy, Policy, require_numbers
from ...policies.registry import make_policy
from ...sim.coarse_model import Behaviours, Lags
from .beam import NODE, BeamMemory, new_memory, search

_NARROWEST, _WIDEST = 4, 1024  # widths of a search with a time limit
_MOST_SAMPLES = 16
_SOURCES = "belief", "configuration"


class SearchParameters(NamedTuple):
    """Parameters of the search, tuned by hand."""

    nodes: int = 12_500  # largest number of segments per decision
    milliseconds: float = 0.0  # if above 0: time limit for searches of increasing width, in place of ``nodes``
    samples: int = 2  # number of random futures if a ghost is not predictable
    horizon_s: float = 48.0
    layer_s: float = 3.0
    segment_s: float = 3.0  # duration of a choice, unless its goal is reached before
    pellets: int = 5  # goals of a node: nearest pellets ...
    refuges: int = 6  # ... and refuges
    pellet_worth: float = 10.0
    second_worth: float = 0.1  # value of collecting a pellet a second earlier
    completion_worth: float = 20.0
    lead_worth: float = 40.0  # cost of no lead in a node's safety ...
    lead_share: float = 0.125  # ... and the share of this cost in its value
    lead_m: float = 3.0  # path length of a full lead, which costs nothing
    metre_worth: float = 0.5  # cost of each metre to the nearest remaining pellet
    near_worth: float = 12.0  # cost of a ghost at the robot, which falls to 0 at the straight distance ``near_m``
    near_m: float = 0.9
    keep_worth: float = 3.0  # value of keeping the current goal
    seed: int = 0  # seed of the futures

    @property
    def layers(self) -> int:
        return round(self.horizon_s / self.layer_s)

    @property
    def choices(self) -> int:
        """Largest number of choices of a node: pellets, refuges, hold and the current goal."""
        return self.pellets + self.refuges + 2

    @property
    def least_nodes(self) -> int:
        """Smallest allowed number of nodes: one in each layer of each future, with all its choices."""
        return self.samples * self.choices * (self.layers + 1)

    def settings(self) -> NDArray[Any]:
        """Return a record (1,) of SETTINGS without the width."""
        record = np.zeros(1, dtype=SETTINGS)
        for name in set(SETTINGS.names or ()) - {"width"}:
            record[name] = getattr(self, name)
        return record


#: Settings of the search: ``width``, the number of nodes of a layer that are continued, and the parameters of nodes.
SETTINGS = np.dtype(
    [
        ("width", np.int64),
        ("layers", np.int64),
        *(
            (name, np.int64 if kind is int else np.float64)
            for name, kind in SearchParameters.__annotations__.items()
            if name not in ("nodes", "samples", "seed")
        ),
    ]
)


def _check(p: SearchParameters) -> None:
    require_numbers(p._asdict(), ("nodes", "samples", "horizon_s", "layer_s", "segment_s", "lead_m", "near_m"))
    if not p.layer_s <= p.segment_s <= p.horizon_s:
        raise ValueError(f"segment_s = {p.segment_s}: must be layer_s = {p.layer_s} to horizon_s = {p.horizon_s}")
    if p.samples > _MOST_SAMPLES:
        raise ValueError(f"samples = {p.samples}: must be {_MOST_SAMPLES} at most")
    if p.nodes < p.least_nodes:
        raise ValueError(f"nodes = {p.nodes}: must be at least {p.least_nodes}, one of each layer in each future")


class Search(BasePolicy):
    """The search policy; further arguments are the fields of :class:`SearchParameters`.

    ``base`` is the name or file of the policy that chooses if no ghost is predictable. ``behaviours`` is the source of
    the ghosts' behaviours: the situation's belief (``belief``), or the configuration (``configuration``), where belief
    is still used for ghosts that a policy controls.
    """

    name = "search"

    def __init__(self, base: str = "ppo", behaviours: str = "belief", **parameters: Any) -> None:
        self.parameters = p = SearchParameters(**parameters)
        _check(p)
        if behaviours not in _SOURCES:
            raise ValueError(f"behaviours = {behaviours!r}: must be one of {', '.join(_SOURCES)}")
        self._by_belief = behaviours == "belief"
        self._prepared: dict[tuple[str, ...], Behaviours] = {}
        self.base: Policy = make_policy(base)
        self._settings = p.settings()
        self._memory: BeamMemory | None = None
        self.played = 0  #: number of segments for the last situation

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        if config is not self.config:
            self._prepared.clear()
        super().reset(games, config)
        self.base.reset(games, config)

    def behaviours(self, situation: Situation, i: int) -> tuple[str, ...]:
        """Return the assumed behaviour of each ghost in situation ``i``."""
        believed = situation.belief[i]
        names = list(self.config.clyde.ghosts)
        for k, (name, belief) in enumerate(zip(names, believed, strict=True)):
            if self._by_belief or name == POLICY:
                names[k] = WANDER if situation.harmless[i, k] else BELIEVED[taken_for(belief)]
        return tuple(names)

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return the value (N, C) of each candidate's best line, or the base's scores if no ghost is predictable."""
        p = self.parameters
        behaviours = [self.behaviours(situation, i) for i in range(len(situation))]
        searched = np.array([any(is_predictable(find_behaviour(name)) for name in names) for names in behaviours])
        if not searched.any():
            return self.base.scores(situation)
        order = nearest_candidates(situation, NearestCounts(p.pellets, p.refuges))
        scores = np.full(situation.mask.shape, -np.inf)
        if not searched.all():
            rest = np.flatnonzero(~searched)
            scores[rest] = self.base.scores(situation.rows(rest))
        for i in np.flatnonzero(searched).tolist():
            candidates = order[i][order[i] >= 0]
            candidates = candidates[situation.mask[i, candidates] & np.isfinite(situation.path_robot[i, candidates])]
            if len(candidates) > 0:
                scores[i, candidates] = self._values(situation, i, candidates, behaviours[i])
        return scores

    def _values(
        self, situation: Situation, i: int, candidates: NDArray[np.int64], names: tuple[str, ...]
    ) -> NDArray[np.float64]:
        """Return the values of ``candidates`` (R,) in situation ``i`` if the ghosts have the behaviours ``names``."""
        began = time.perf_counter()
        p, behaviours = self.parameters, [find_behaviour(name) for name in names]
        if names not in self._prepared:
            self._prepared[names] = Behaviours(behaviours, self.config)
        begin = start(situation, i, self.config, self._prepared[names], Lags(), NODE)
        goals = begin.goals[candidates]
        samples = 1 if all(map(is_predictable, behaviours)) else p.samples
        values = np.zeros(len(goals))
        self.played = 0
        for number in range(samples):
            draw_futures(begin.ghosts, int(situation.seed[i]), int(situation.tick[i]), number + _MOST_SAMPLES * p.seed)
            until = began + p.milliseconds / 1e3 * (number + 1) / samples
            values += self._search(begin, goals, samples, until) / samples
        return values + p.keep_worth * (candidates == situation.current[i])

    def _search(self, begin: CoarseStart, goals: NDArray[np.int64], samples: int, until: float) -> NDArray[np.float64]:
        """Return the values of ``goals`` (R,) in one of ``samples`` futures.

        The future gets its share of the nodes, or the time until ``until`` (s, ``time.perf_counter``).
        """
        p, settings = self.parameters, self._settings
        best = np.empty(len(goals))
        width = _NARROWEST
        if p.milliseconds == 0:
            width = (p.nodes // samples - len(goals)) // (p.layers * p.choices)
        while True:
            start_s = time.perf_counter()
            memory, ghosts = self._memory, len(begin.ghosts)
            if memory is None or len(memory.kept) < width or memory.ghosts.shape[2] != ghosts:
                self._memory = memory = new_memory(width, ghosts, settings)
            settings["width"] = width
            self.played += search(begin, goals, settings, memory, best)
            now = time.perf_counter()
            # The next search, which is twice as wide, must not exceed the time limit.
            if now + 2.0 * (now - start_s) > until or width >= _WIDEST:
                return best
            width *= 2


def alone(**parameters: Any) -> Search:
    """Return the policy ``search:alone``, which uses ``lookahead`` as base policy, so that nothing is learned."""
    policy = Search(base="lookahead", **parameters)
    policy.name = "search:alone"
    return policy


def is_predictable(behaviour: Behaviour) -> bool:
    """Return True if a ghost with this behaviour has a target that only depends on its view."""
    return behaviour.target is not None and behaviour.name != WANDER
