"""Play one simulated round tick by tick, by a policy or by people, optionally next to a policy's robot."""

import copy
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.decisions import allowed, ghost_choices, play_until_due
from pacman_env.game.ends import ENDS, RUNNING, End
from pacman_env.game.ghosts import CHASE, POLICY
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.levels.level_source import LevelSource
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import KIND_NAMES, Policy, reach
from pacman_env.policies.policy_calls import PolicyError, choose
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.ghost_state import AS_BEHAVIOUR, BEHAVIOUR_NAMES, TO_CELL, choices_of
from pacman_env.web.caught_ghosts import CaughtGhosts
from pacman_env.web.frame import Frame, Pose, thinned
from pacman_env.web.game_interface import Refused
from pacman_env.web.orders import FOLLOW, Moves, Orders
from pacman_env.world.navigation import lidar, navigator

_RAYS = 180
_RANGE_M = (0.15, 12.0)  # RPLIDAR A1
_ONE = np.zeros(1, dtype=np.int64)
_ALL = np.ones(1, dtype=np.bool_)
_NEAR_M = 1.0  # largest distance from a click to its candidate
ADVISER = "ppo"  # policy that judges the goals of people
_WORSE = 0.1  # a goal is worse if a catch within 10 s is more likely by at least this probability


class PlayedRound:
    """A round with its policies. Raises ConfigError or MapError if it cannot be played."""

    def __init__(
        self,
        config: Config,
        source: LevelSource,
        ghosts: Mapping[int, Policy],
        policies: Sequence[str],  # the robot follows the first one; the second one is only compared
        seed: int,
        ghost_roles: frozenset[int] = frozenset(),  # ghosts that people may send; otherwise they behave as configured
    ) -> None:
        self.seed, self.names = seed, tuple(policies)
        self._given = config
        self._behaviours = config.clyde.ghosts
        outside = tuple(POLICY if k in ghost_roles else name for k, name in enumerate(self._behaviours))
        fixed = {"action": "goal", "decisions.when": "tick", "endless": False}
        self.config = config.with_fields(**{"clyde.ghosts": outside, **fixed})
        self.ghost_roles, self._ghosts = ghost_roles, dict(ghosts)
        self._source = source
        self._policies = [make_policy(name) for name in policies]
        self.situations: list[Situation] = []  # at the start of each tick
        self.choices: list[list[int]] = []  # (T, 3) goal and each policy's choice, page numbers
        self.by_person = False
        self.moves = Moves()  # orders of people until now
        self.worse: list[int] = []  # ticks at which a person chose a more dangerous goal than ADVISER
        self.baseline: PlayedRound | None = None  # the policy's own round, while a person plays
        self._sent: Mapping[int, int | None] = {}  # ``ghosts`` of the last orders
        self.batch = batch = GameBatch(source, self.config, 1)
        batch.reset(_ONE, np.array([seed], dtype=np.uint64))
        for policy in (*self._policies, *self._ghosts.values()):
            policy.reset(_ALL, self.config)
        self.assets = batch.assets_of(0)
        refuges = range(batch.pellet_slots, batch.pellet_slots + self.assets.refuges)
        self._numbers = np.array([*range(self.assets.pellets), *refuges, batch.hold])  # batch number by page number
        self.hold = len(self._numbers) - 1
        self._situation = situation_of(batch)
        self.power_pellets = self.assets.power_pellets(config.power.pellets)[: self.assets.pellets]  # mask (P,)
        self.caught = CaughtGhosts(config.power.return_s, config.power.ghost_points)
        self.snapshots = [self._snapshot()]  # before the first tick and after each tick

    @property
    def ticks(self) -> int:
        return len(self.choices)

    @property
    def over(self) -> bool:
        return bool(self.batch.games["end"][0] != RUNNING)

    @property
    def end(self) -> End:
        return ENDS[self.batch.games["end"][0]]

    @property
    def level(self) -> int | None:
        return int(self.batch.level_numbers()[0]) if len(self.batch.levels) > 1 else None

    def place_ghost(self, number: int, x: float, y: float) -> None:
        """Move a ghost to its cell nearest to (x, y), m; only before the first tick."""
        self.moves.placed[number] = self.batch.place_ghost(0, number, x, y)
        self._situation = situation_of(self.batch)
        self.snapshots = [self._snapshot()]

    @property
    def catcher(self) -> int | None:
        """Number of the ghost that caught the robot, or None."""
        number = int(self.batch.games["catcher"][0])
        return number if number >= 0 else None

    @property
    def caught_before_pellets(self) -> bool:
        """Return True if ghosts were caught before pellets of the same tick were collected."""
        return self.over or bool(self.batch.games["streak"][0] < len(self.caught.new))

    def nearest(self, x: float, y: float) -> int | None:
        """Return the allowed candidate nearest to (x, y), m, or None if no candidate is within 1 m."""
        places = self.assets.goal_xy
        distance = np.hypot(places[:, 0] - x, places[:, 1] - y)
        distance[~self._situation.mask[0, self._numbers[:-1]]] = np.inf
        return int(distance.argmin()) if distance.min() <= _NEAR_M else None

    def nearest_ghost_cell(self, number: int, x: float, y: float) -> int:
        """Return the cell nearest to (x, y), m, that a ghost can reach."""
        cells, batch = self.assets.clyde, self.batch
        current = batch.ghost_paths[0, number, batch.ghosts["path_index"][0, number]]
        return cells.nearest(x, y, int(cells.part[current]))[0]

    def ghost_goals(self, sent: Mapping[int, int | None], robot: Pose | None) -> NDArray[np.float64]:
        """Return the places to which people have sent ghosts: (G, 2), m.

        NaN: not sent. The place of a ghost that follows the robot is ``robot``.
        """
        goals = np.full((len(self._behaviours), 2), np.nan)
        for number, cell in sent.items():
            if cell == FOLLOW and robot is not None:
                goals[number] = robot[:2]
            elif cell is not None and cell != FOLLOW:
                goals[number] = self.assets.clyde.position[cell]
        return goals

    def play_second_policy(self) -> None:
        """Let the policy play the same round next to the person, if no tick has been played."""
        if self.ticks == 0 and not self.moves.placed and not self.ghost_roles:
            self.baseline = self.unplayed(self.names[:1])
            self.snapshots = [self._snapshot()]

    def unplayed(self, names: Sequence[str]) -> "PlayedRound":
        """Return the same round before its first tick, for other policies and without people."""
        return PlayedRound(self._given, self._source, copy.deepcopy(self._ghosts), names, self.seed)

    def replay(self, moves: Moves, ticks: int | None = None) -> None:
        """Play with recorded orders until ``ticks`` ticks or the end; raises Refused if they do not fit the round."""
        if max(moves.ghosts | moves.placed.keys(), default=0) >= len(self._behaviours):
            raise Refused(f"moves: the round has {len(self._behaviours)} ghosts")
        if self.ticks == 0:
            for number, place in moves.placed.items():
                self.place_ghost(number, *place)
        cells = len(self.assets.clyde.position)
        for orders in islice(moves.ticks(), self.ticks, None):
            if self.over or self.ticks == ticks:
                return
            cell = max((one or 0 for one in orders.ghosts.values()), default=0)
            if cell >= cells or (orders.goal or 0) > self.hold:
                raise Refused(f"moves: tick {self.ticks}: the map has no such place")
            self.step(orders)

    def finish(self) -> dict[str, Any]:
        """Play to the end and return the result."""
        self.replay(Moves())
        last = self.snapshots[-1]
        return {"result": self.end.word, "collected": last.collected, "time_s": last.time_s}

    def step(self, orders: Orders) -> None:
        if self.over:
            return
        batch, situation = self.batch, self._situation
        chosen = [self._page_choice(policy, situation) for policy in self._policies]
        sent = self._ghost_choices(orders)
        self._sent = dict(orders.ghosts)
        self.situations.append(situation)
        self.moves.note(self.ticks, orders)
        goal = chosen[0]
        if orders.velocity is not None:
            goal = self.hold
            batch.step_by_hand(np.array([orders.velocity], dtype=np.float64), sent)
        else:
            if orders.robot:
                goal = self.hold if orders.goal is None else orders.goal
                is_new = not self.choices or goal != self.choices[-1][0]
                if is_new and self._is_worse(situation, goal):
                    self.worse.append(self.ticks)
            choice = allowed(situation, self._numbers[[goal]], batch.hold)
            play_until_due(batch, choice, choose_for_ghosts=lambda: sent)
        self.by_person |= orders.robot or orders.velocity is not None
        self.choices.append([goal, *chosen])
        if self.baseline is not None:
            self.baseline.step(Orders())
        self._situation = situation_of(batch)
        self.snapshots.append(self._snapshot())

    def _is_worse(self, situation: Situation, goal: int) -> bool:
        """Return True if ADVISER expects a catch on the way to ``goal`` clearly more often than with its own choice."""
        adviser = make_policy(ADVISER)
        adviser.reset(_ALL, self.config)
        terms, own = adviser.explain(situation)[0], self._page_choice(adviser, situation)
        risk, least = (terms[self._numbers[one]].get("caught", 0.0) for one in (goal, own))
        return bool(risk - least >= _WORSE)

    def _page_number(self, candidate: int) -> int:
        matches = np.flatnonzero(self._numbers == candidate)
        return int(matches[0]) if len(matches) else self.hold

    def _page_choice(self, policy: Policy, situation: Situation) -> int:
        return self._page_number(int(_choice(policy, situation)[0]))

    def _ghost_choices(self, orders: Orders) -> NDArray[Any] | None:
        """Return the choices (1, G) of people and ghost policies; people's orders replace a policy's choice."""
        given = {}
        for k in self.ghost_roles:
            cell = orders.ghosts.get(k)
            behaviour = CHASE if cell == FOLLOW else self._behaviours[k]
            if cell is not None and cell != FOLLOW:
                given[k] = choices_of(np.array([cell]), TO_CELL)
            elif behaviour in BEHAVIOUR_NAMES and (cell == FOLLOW or k not in self._ghosts):
                given[k] = choices_of(np.array([BEHAVIOUR_NAMES.index(behaviour)]), AS_BEHAVIOUR)
        policies = {k: policy for k, policy in self._ghosts.items() if k not in orders.ghosts}
        return ghost_choices(self.batch, policies, given, _choice)

    def _snapshot(self) -> Frame:
        batch, g, situation = self.batch, self.batch.games[0], self._situation
        scores = self._policies[0].scores(situation)[0][self._numbers]
        v, omega = situation.robot_velocity[0].tolist()
        true: Pose = (float(g["x"]), float(g["y"]), float(g["heading"]))
        plan = slice(int(g["nav_at"]), int(g["nav_points"]) if g["nav_state"] == navigator.ACTIVE else 0)
        baseline = None if self.baseline is None else self.baseline.snapshots[-1]
        alive = batch.alive[0, : self.assets.pellets].copy()
        time_s = float(g["step"]) * self.config.physics_step_s
        ghosts: dict[str, Any] = {"ghosts": np.stack([batch.ghosts["x"][0], batch.ghosts["y"][0]], axis=1)}
        if self.power_pellets.any():
            until_s = batch.obstacles[0, :, HARMLESS_UNTIL:] * self.config.physics_step_s
            ghosts = self.caught.update(ghosts["ghosts"], until_s, time_s, int(alive[self.power_pellets].sum()))
            ghosts["ghosts_caught"] = int(g["caught"])
        return Frame(
            state="running",
            revision=0,
            number=self.ticks,
            time_s=time_s,
            collected=int(g["collected"]),
            spawned=self.assets.pellets,
            goal=self._page_number(int(g["pursued"])) if g["pursued"] >= 0 else -1,
            over=self.over,
            true=true,
            believed=tuple(situation.robot[0].tolist()),
            velocity=(v, omega),
            **ghosts,
            ghost_goals=self.ghost_goals(self._sent, true),
            alive=alive,
            scores=np.where(np.isfinite(scores) & situation.mask[0, self._numbers], scores, np.nan),
            plan=thinned(batch.paths[0, plan].astype(float)),
            baseline=None if baseline is None else baseline.true,
            baseline_collected=0 if baseline is None else baseline.collected,
        )

    def lidar(self) -> NDArray[np.float64]:
        """Return the scan (R,) at the robot's true pose, m, without noise; NaN: no hit."""
        pose = self.snapshots[-1].true
        assert pose is not None
        grid, ranges = self.assets.grid, np.zeros(_RAYS, dtype=np.float32)
        moment, sensor = (np.uint64(0), np.int32(0)), lidar.Sensor(*_RANGE_M, 0.0)
        lidar.scan(grid.affine, grid.clearance_cm, grid.resolution, np.array(pose), moment, sensor, ranges)
        return np.where(ranges >= _RANGE_M[1], np.nan, ranges.astype(float))

    def why(self, tick: int) -> dict[str, Any]:
        """Return the terms of the candidates at a tick, by a replay of the policies from the first tick."""
        situation = [*self.situations, self._situation][tick]
        policies = [make_policy(name) for name in self.names]
        for policy in policies:
            policy.reset(_ALL, self.config)
            for earlier in self.situations[:tick]:
                _choice(policy, earlier)
        return self._terms(situation, policies, self.choices[tick][0] if tick < self.ticks else -1)

    def why_now(self) -> dict[str, Any]:
        """Explain the present tick: return the terms of each policy's scores for all allowed candidates.

        Unlike :meth:`why`, this does not replay the policies from the first tick.
        """
        return self._terms(self._situation, copy.deepcopy(self._policies), self.snapshots[-1].goal)

    def _terms(self, situation: Situation, policies: list[Any], goal: int) -> dict[str, Any]:
        named = dict(zip(self.names, policies, strict=True))
        explained = {name: policy.explain(situation)[0] for name, policy in named.items()}
        chosen = {name: self._page_choice(policy, situation) for name, policy in named.items()}

        def plain(terms: Mapping[str, Any]) -> dict[str, Any]:
            shown = {name: value for name, value in terms.items() if name not in ("kind", "allowed")}
            return {name: round(value, 4) if isinstance(value, float) else value for name, value in shown.items()}

        rows = []
        for number, candidate in enumerate(self._numbers.tolist()):
            if situation.mask[0, candidate]:
                kind = KIND_NAMES[int(situation.kind[0, candidate])]
                terms = {name: plain(terms[candidate]) for name, terms in explained.items()}
                distances = reach(situation, candidate, self.config.robot.speed_mps)
                rows.append({"candidate": number, "kind": kind, "terms": terms, **distances})
        time_s = float(situation.time_s[0])
        return {"time_s": time_s, "goal": goal, "rows": rows, "policies": list(self.names), "chosen": chosen}


def _choice(policy: Policy, situation: Situation) -> NDArray[np.int64]:
    """Return a policy's choice (1,), or hold if a user's policy fails, because other people use the page, too."""
    try:
        return choose(policy, situation)
    except PolicyError:
        return np.array([situation.mask.shape[1] - 1])
