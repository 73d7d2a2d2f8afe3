"""``search``: plans against ghosts that react, on a coarse model of the game; elsewhere the choice of a base policy."""

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.game.behaviour_belief import BELIEVED, taken_for
from pacman_env.game.ghosts import POLICY, WANDER, Behaviour, find_behaviour
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.coarse.model import Behaviours, Lags
from pacman_env.sim.coarse.start import Start, draw_futures, start
from pacman_env.sim.observation.situation import Nearest, Situation, nearest_candidates

from .beam import NODE, SETTINGS, Room, new_room, search

_NARROWEST, _WIDEST = 4, 1024  # of a search that has a time
_MOST_SAMPLES = 16
_SOURCES = "belief", "configuration"


class Parameters(NamedTuple):
    """Numbers of the search, by hand."""

    nodes: int = 12_500  # segments played for a decision, at most
    milliseconds: float = 0.0  # above 0, in place of that: wider and wider searches, until so long after the start
    samples: int = 2  # futures of the ghosts that wander beside others
    horizon_s: float = 48.0
    layer_s: float = 3.0
    segment_s: float = 3.0
    pellets: int = 5  # goals of a node: the nearest pellets ...
    refuges: int = 6  # ... and refuges
    pellet_worth: float = 10.0
    second_worth: float = 0.1  # of a pellet that is collected a second earlier
    completion_worth: float = 20.0
    lead_worth: float = 40.0  # of ghosts that are far by their paths, in a node's safety ...
    lead_share: float = 0.125  # ... and this share of it in its value
    lead_m: float = 3.0
    metre_worth: float = 0.5  # of the path to the nearest pellet left
    near_worth: float = 12.0  # of ghosts that never come near, straight
    near_m: float = 0.9
    keep_worth: float = 3.0  # the goal pursued now is worth so much more
    seed: int = 0  # of the futures

    @property
    def layers(self) -> int:
        return round(self.horizon_s / self.layer_s)

    @property
    def choices(self) -> int:
        """Of a node, at most: those, to hold, and to go on."""
        return self.pellets + self.refuges + 2

    @property
    def least_nodes(self) -> int:
        """One of each layer in each future."""
        return self.samples * self.choices * (self.layers + 1)

    def settings(self) -> NDArray[Any]:
        """(1,) of SETTINGS, for beams; the width is to be set."""
        record = np.zeros(1, dtype=SETTINGS)
        for name in set(SETTINGS.names or ()) & set(self._fields):
            record[name] = getattr(self, name)
        record["layers"] = self.layers
        return record


def _check(p: Parameters) -> None:
    above_0 = ("nodes", "samples", "horizon_s", "layer_s", "segment_s", "lead_m", "near_m")
    for name, value in p._asdict().items():
        if not 0 <= value < np.inf or (name in above_0 and value == 0):
            raise ValueError(
                f"{name} = {value!r}: must be a finite number, {'above' if name in above_0 else 'at least'} 0"
            )
    if not p.layer_s <= p.segment_s <= p.horizon_s:
        raise ValueError(f"segment_s = {p.segment_s}: must be layer_s = {p.layer_s} to horizon_s = {p.horizon_s}")
    if p.samples > _MOST_SAMPLES:
        raise ValueError(f"samples = {p.samples}: must be {_MOST_SAMPLES} at most")
    if p.nodes < p.least_nodes:
        raise ValueError(f"nodes = {p.nodes}: must be at least {p.least_nodes}, one of each layer in each future")


class Search(BasePolicy):
    """The rule; every parameter can be given by name.

    ``base``: the policy that chooses where no ghost can be predicted, by its name or file. ``behaviours``: what each
    ghost does is what the situation has as belief (``belief``), or what is configured (``configuration``), where those
    that are sent from outside go by belief.
    """

    name = "search"

    def __init__(self, base: str = "ppo", behaviours: str = "belief", **parameters: Any) -> None:
        self.parameters = p = Parameters(**parameters)
        _check(p)
        if behaviours not in _SOURCES:
            raise ValueError(f"behaviours = {behaviours!r}: must be one of {', '.join(_SOURCES)}")
        self._by_belief = behaviours == "belief"
        self._prepared: dict[tuple[str, ...], Behaviours] = {}
        self.base: Policy = make_policy(base)
        self._settings = p.settings()
        self._room: Room | None = None
        self.played = 0  #: segments, for the last situation

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        if config is not self.config:
            self._prepared.clear()
        super().reset(games, config)
        self.base.reset(games, config)

    def behaviours(self, situation: Situation, i: int) -> tuple[str, ...]:
        """What each ghost is taken to do in situation ``i``, by number."""
        believed = situation.belief[i]
        found = list(self.config.clyde.ghosts)
        for k, (name, belief) in enumerate(zip(found, believed, strict=True)):
            if self._by_belief or name == POLICY:
                found[k] = BELIEVED[taken_for(belief)]
        return tuple(found)

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C) value of the best line that begins with each candidate; the base's where nothing is predictable."""
        p = self.parameters
        known = [self.behaviours(situation, i) for i in range(len(situation))]
        searched = np.array([any(is_predictable(find_behaviour(name)) for name in names) for names in known])
        if not searched.any():
            return self.base.scores(situation)
        order = nearest_candidates(situation, Nearest(p.pellets, p.refuges))
        scores = np.full(situation.mask.shape, -np.inf)
        if not searched.all():
            rest = np.flatnonzero(~searched)
            scores[rest] = self.base.scores(situation.rows(rest))
        for i in np.flatnonzero(searched).tolist():
            candidates = order[i][order[i] >= 0]
            candidates = candidates[situation.mask[i, candidates] & np.isfinite(situation.path_robot[i, candidates])]
            if len(candidates) > 0:
                scores[i, candidates] = self._values(situation, i, candidates, known[i])
        return scores

    def _values(
        self, situation: Situation, i: int, candidates: NDArray[np.int64], names: tuple[str, ...]
    ) -> NDArray[np.float64]:
        """(R,) of the candidates of one situation, whose ghosts behave so."""
        began = time.perf_counter()
        p, known = self.parameters, [find_behaviour(name) for name in names]
        if names not in self._prepared:
            self._prepared[names] = Behaviours(known, self.config)
        begin = start(situation, i, self.config, self._prepared[names], Lags(), NODE)
        goals = begin.goals[candidates]
        samples = 1 if all(map(is_predictable, known)) else p.samples
        values = np.zeros(len(goals))
        self.played = 0
        for number in range(samples):
            draw_futures(begin.ghosts, int(situation.seed[i]), int(situation.tick[i]), number + _MOST_SAMPLES * p.seed)
            until = began + p.milliseconds / 1e3 * (number + 1) / samples
            values += self._search(begin, goals, samples, until) / samples
        return values + p.keep_worth * (candidates == situation.current[i])

    def _search(self, begin: Start, goals: NDArray[np.int64], samples: int, until: float) -> NDArray[np.float64]:
        """(R,) with this share of the budget: of the nodes, or until a time of ``time.perf_counter()``."""
        p, settings = self.parameters, self._settings
        best = np.empty(len(goals))
        width = _NARROWEST
        if p.milliseconds == 0:
            width = (p.nodes // samples - len(goals)) // (p.layers * p.choices)
        while True:
            before = time.perf_counter()
            if self._room is None or len(self._room.kept) < width or self._room.ghosts.shape[2] != len(begin.ghosts):
                self._room = new_room(width, len(begin.ghosts), settings)
            settings["width"] = width
            self.played += search(begin, goals, settings, self._room, best)
            now = time.perf_counter()
            # The next search is twice as wide.
            if now + 2.0 * (now - before) > until or width >= _WIDEST:
                return best
            width *= 2


def alone(**parameters: Any) -> Search:
    """``search:alone``: over ``lookahead``, so that nothing learned is in it."""
    policy = Search(base="lookahead", **parameters)
    policy.name = "search:alone"
    return policy


def is_predictable(behaviour: Behaviour) -> bool:
    """Where such a ghost goes follows from what it sees."""
    return behaviour.target is not None and behaviour.name != WANDER
