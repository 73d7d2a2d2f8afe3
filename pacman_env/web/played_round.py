"""One round in the simulator, tick by tick: played by a policy or by people, beside another robot, and recorded."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.episodes.rollout import allowed
from pacman_env.game.execution import RUNNING
from pacman_env.game.ghosts import POLICY
from pacman_env.policies.base import KIND_NAMES, Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.core.ghosts import BEHAVIOUR_NAMES, behaviour_choice
from pacman_env.sim.maps.level_source import LevelSource
from pacman_env.sim.observation.situation import Situation
from pacman_env.web.frame import Frame, Pose, thinned
from pacman_env.world.navigation import lidar, navigator

_RAYS = 180
_RANGE_M = (0.15, 12.0)  # of the RPLIDAR A1
_ONE = np.zeros(1, dtype=np.int64)
_ALL = np.ones(1, dtype=np.bool_)


@dataclass(frozen=True)
class Snapshot:
    """How a round stands after a tick; see :class:`~pacman_env.web.frame.Frame` for what is not said here."""

    time_s: float
    true: Pose
    believed: Pose
    velocity: tuple[float, float]
    ghosts: NDArray[np.float64]
    alive: NDArray[np.bool_]
    collected: int
    goal: int
    scores: NDArray[np.float64]
    plan: NDArray[np.float64]
    baseline: Pose | None
    baseline_collected: int
    over: bool


def between(old: Snapshot, new: Snapshot, share: float) -> dict[str, Any]:
    """Fields of a frame on the way from one snapshot to the next; 1: there."""
    if share >= 1.0 or new.time_s < old.time_s:
        share = 1.0
    moved = {
        name: _pose_between(getattr(old, name) or getattr(new, name), getattr(new, name), share)
        for name in ("true", "believed", "baseline")
        if getattr(new, name) is not None
    }
    ghosts = old.ghosts + share * (new.ghosts - old.ghosts) if old.ghosts.shape == new.ghosts.shape else new.ghosts
    last = new if share == 1.0 else old  # a pellet is there until it is reached
    return {
        **moved,
        "time_s": old.time_s + share * (new.time_s - old.time_s),
        "velocity": new.velocity,
        "ghosts": ghosts,
        "alive": last.alive,
        "collected": last.collected,
        "over": last.over,
        "baseline_collected": last.baseline_collected,
        "goal": new.goal,
        "scores": new.scores,
        "plan": thinned(new.plan),
    }


def _pose_between(old: Pose, new: Pose, share: float) -> Pose:
    turned = math.remainder(new[2] - old[2], 2 * math.pi)
    return old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1]), old[2] + share * turned


@dataclass
class Orders:
    """What people want of the next tick.

    Attributes:
        robot: whether a person plays the robot; the policy is not followed then.
        goal: the candidate of that person, as the page numbers them; None: hold.
        velocity: v (m/s) and omega (rad/s) by hand; None: nobody drives.
        ghosts: by the ghost's number the candidate that a person sends him to, None: where he is.
    """

    robot: bool = False
    goal: int | None = None
    velocity: tuple[float, float] | None = None
    ghosts: dict[int, int | None] = field(default_factory=dict)


class PlayedRound:
    """A round with its policies.

    Attributes:
        snapshots: before the first tick and after each.
        situations: that each tick was decided in.
        choices: (T,) lists of candidates, as the page numbers them: the goal of the robot, and what the two
            policies would have chosen.
    """

    def __init__(
        self,
        config: Config,
        source: LevelSource,
        ghosts: Mapping[int, Policy],
        policies: tuple[str, str],
        seed: int,
        ghost_roles: frozenset[int] = frozenset(),
    ) -> None:
        """Lay it out.

        Args:
            config: the game.
            source: its maps.
            ghosts: the policies of those that have one.
            policies: of the robot, and the one that is asked beside it.
            seed: of the round.
            ghost_roles: ghosts that people may send; until somebody does they do as the configuration says.

        Raises:
            ConfigError, MapError: it cannot be played.
        """
        self.seed, self.names = seed, policies
        self._behaviours = config.clyde.ghosts
        outside = tuple(POLICY if k in ghost_roles else name for k, name in enumerate(self._behaviours))
        self.config = config.with_fields(**{"clyde.ghosts": outside, "action": "goal", "endless": False})
        self.ghost_roles, self._ghosts = ghost_roles, dict(ghosts)
        self._made_from = source
        self.batch = GameBatch(source, self.config, 1)
        self._policies = [make_policy(name) for name in policies]
        self.snapshots: list[Snapshot] = []
        self.situations: list[Situation] = []
        self.choices: list[list[int]] = []
        self.by_person = False
        self.placed = False
        self._baseline: GameBatch | None = None
        self._baseline_policy: Policy | None = None
        self._begin()

    def _begin(self) -> None:
        self.batch.reset(_ONE, np.array([self.seed], dtype=np.uint64))
        for policy in (*self._policies, *self._ghosts.values()):
            policy.reset(_ALL, self.config)
        batch = self.batch
        self.assets = batch.assets_of(0)
        self._numbers = np.array(  # of the batch's candidates, by the page's number
            [
                *range(self.assets.pellets),
                *range(batch.pellet_slots, batch.pellet_slots + self.assets.refuges),
                batch.hold,
            ]
        )
        self.hold = len(self._numbers) - 1
        self._situation = batch.situation()
        self.snapshots = [self._snapshot()]
        self.situations.clear()
        self.choices.clear()

    @property
    def ticks(self) -> int:
        """Ticks played."""
        return len(self.choices)

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return bool(self.batch.games["end"][0] != RUNNING)

    @property
    def outcome(self) -> str:
        """``running``, ``caught``, ``complete``, ``timeout``."""
        return str(OUTCOMES[self.batch.games["end"][0]])

    @property
    def catcher(self) -> int:
        """The ghost that caught the robot, -1: none."""
        return int(self.batch.games["catcher"][0])

    @property
    def level(self) -> int | None:
        """Of a generated map."""
        return int(self.batch.level_numbers()[0]) if len(self.batch.levels) > 1 else None

    def place_ghost(self, number: int, x: float, y: float) -> None:
        """Before the first tick: put a ghost on the cell of his nearest to a place, m."""
        self.batch.place_ghost(0, number, x, y)
        self.placed = True
        self._situation = self.batch.situation()
        self.snapshots = [self._snapshot()]

    def nearest(self, x: float, y: float, within_m: float = 1.0) -> int | None:
        """The candidate that may be chosen nearest to a place, m; None: none is near."""
        places = self.assets.goal_xy
        away = np.hypot(places[:, 0] - x, places[:, 1] - y)
        away[~self._situation.mask[0, self._numbers[:-1]]] = np.inf
        return int(away.argmin()) if away.min() <= within_m else None

    def play_beside(self) -> None:
        """From the beginning on, let the policy play the same round beside the person."""
        if self.ticks == 0 and not self.placed and not self.ghost_roles:
            self._baseline = GameBatch(self._made_from, self.config, 1)
            self._baseline.reset(_ONE, np.array([self.seed], dtype=np.uint64))
            self._baseline_policy = make_policy(self.names[0])
            self._baseline_policy.reset(_ALL, self.config)
            self._baseline_ghosts = {k: copy.deepcopy(policy) for k, policy in self._ghosts.items()}
            self.snapshots = [self._snapshot()]

    def baseline_result(self) -> dict[str, Any] | None:
        """How the round goes on for the policy beside a person, to its end; None: there is none."""
        if self._baseline is None:
            return None
        while self._baseline.games["end"][0] == RUNNING:
            self._step_baseline()
        game = self._baseline.games[0]
        time_s = float(game["step"]) * self.config.physics_step_s
        return {"result": str(OUTCOMES[game["end"]]), "collected": int(game["collected"]), "time_s": time_s}

    def step(self, orders: Orders) -> None:
        """One tick; nothing after the end."""
        if self.over:
            return
        batch, situation = self.batch, self._situation
        chosen = [self._dense(policy.select(situation)) for policy in self._policies]
        sent = self._ghost_choices(batch, orders, self._ghosts)
        self.situations.append(situation)
        if orders.velocity is not None:
            self.by_person = True
            batch.step_by_hand(np.array([orders.velocity], dtype=np.float64), sent)
            goal = self.hold
        else:
            goal = chosen[0]
            if orders.robot:
                self.by_person = True
                goal = self.hold if orders.goal is None else orders.goal
            batch.step(allowed(situation, self._numbers[[goal]], batch.hold), sent)
        self.choices.append([goal, *chosen])
        if self._baseline is not None:
            self._step_baseline()
        self._situation = batch.situation()
        self.snapshots.append(self._snapshot())

    def _dense(self, choice: NDArray[np.int64]) -> int:
        found = np.flatnonzero(self._numbers == int(choice[0]))
        return int(found[0]) if len(found) else self.hold

    def _ghost_choices(
        self, batch: GameBatch, orders: Orders, policies: Mapping[int, Policy]
    ) -> NDArray[np.int64] | None:
        if not (self.ghost_roles or policies):
            return None
        choices = np.full(batch.ghosts.shape, batch.hold, dtype=np.int64)
        for k, policy in policies.items():
            if k not in orders.ghosts:
                choices[:, k] = policy.select(batch.situation(k))
        for k in self.ghost_roles:
            goal = orders.ghosts.get(k)
            if goal is not None:
                choices[:, k] = self._numbers[min(goal, self.hold)]
            elif k not in policies and self._behaviours[k] in BEHAVIOUR_NAMES:
                choices[:, k] = behaviour_choice(batch.hold, BEHAVIOUR_NAMES.index(self._behaviours[k]))
        return choices

    def _step_baseline(self) -> None:
        batch, policy = self._baseline, self._baseline_policy
        assert batch is not None
        assert policy is not None
        if batch.games["end"][0] == RUNNING:
            situation = batch.situation()
            choice = allowed(situation, policy.select(situation), batch.hold)
            batch.step(choice, self._ghost_choices(batch, Orders(), self._baseline_ghosts))

    def _snapshot(self) -> Snapshot:
        batch, g = self.batch, self.batch.games[0]
        situation = self._situation
        scores = self._policies[0].scores(situation)[0][self._numbers]
        pursued = int(g["pursued"])
        plan = np.zeros((0, 2))
        if g["nav_state"] == navigator.ACTIVE:
            plan = batch.paths[0, int(g["nav_at"]) : int(g["nav_points"])].astype(float)
        v, omega = situation.robot_velocity[0].tolist()
        other = None if self._baseline is None else self._baseline.games[0]
        return Snapshot(
            time_s=float(g["step"]) * self.config.physics_step_s,
            true=(float(g["x"]), float(g["y"]), float(g["heading"])),
            believed=tuple(situation.robot[0].tolist()),
            velocity=(v, omega),
            ghosts=np.stack([batch.ghosts["x"][0], batch.ghosts["y"][0]], axis=1),
            alive=batch.alive[0, : self.assets.pellets].copy(),
            collected=int(g["collected"]),
            goal=self._dense(np.array([pursued])) if pursued >= 0 else -1,
            scores=np.where(np.isfinite(scores) & situation.mask[0, self._numbers], scores, np.nan),
            plan=plan,
            baseline=None if other is None else (float(other["x"]), float(other["y"]), float(other["heading"])),
            baseline_collected=0 if other is None else int(other["collected"]),
            over=self.over,
        )

    def lidar(self) -> NDArray[np.float64]:
        """(R,) the scan at the robot's true pose, m, NaN: nothing met; without noise."""
        levels, ranges = self.batch.levels, np.zeros((1, _RAYS), dtype=np.float32)
        arrays, level = levels.arrays, np.ascontiguousarray(self.batch.games["level"][:1])
        maps = lidar.Maps(arrays["affine"], arrays["clearance_cm"], arrays["shape"], levels.resolution)
        pose, zeros = np.array([self.snapshots[-1].true]), np.zeros(1, np.int32)
        lidar.scan(
            maps, lidar.Robots(level, pose, zeros.astype(np.uint64), zeros), lidar.Sensor(*_RANGE_M, 0.0), ranges
        )
        return np.where(ranges[0] >= _RANGE_M[1], np.nan, ranges[0].astype(float))

    def why(self, tick: int) -> dict[str, Any]:
        """The terms of the candidates at a tick: the policies are asked again, from the beginning on.

        Raises:
            IndexError: there was no such tick.
        """
        situation = self.situations[tick] if tick < self.ticks else self._situation
        if tick > self.ticks:
            raise IndexError(tick)
        asked = [make_policy(name) for name in self.names]
        for policy in asked:
            policy.reset(_ALL, self.config)
            for before in self.situations[:tick]:
                policy.select(before)
        return self._terms(situation, asked, self.choices[tick][0] if tick < self.ticks else -1)

    def why_now(self) -> dict[str, Any]:
        """The same of this moment, without asking again."""
        return self._terms(
            self._situation, [copy.deepcopy(policy) for policy in self._policies], self.snapshots[-1].goal
        )

    def _terms(self, situation: Situation, asked: list[Any], goal: int) -> dict[str, Any]:
        explained = [policy.explain(situation)[0] for policy in asked]
        chosen = {policy: self._dense(one.select(situation)) for policy, one in zip(self.names, asked, strict=True)}
        rows = []
        for number, candidate in enumerate(self._numbers.tolist()):
            if not situation.mask[0, candidate]:
                continue
            terms = {name: _plain(e[candidate]) for name, e in zip(self.names, explained, strict=True)}
            kind = KIND_NAMES[int(situation.kind[0, candidate])]
            rows.append({"candidate": number, "kind": kind, "terms": terms})
        time_s = float(situation.time_s[0])
        return {"time_s": time_s, "goal": goal, "rows": rows, "policies": list(self.names), "chosen": chosen}

    def frame(self, tick: int, fields: Mapping[str, Any]) -> Frame:
        """The frame of a tick of a round that has ended; ``fields`` are those of every frame."""
        snapshot = self.snapshots[tick]
        return Frame(state="running", number=tick, **{**between(snapshot, snapshot, 1.0), **fields})


def _plain(terms: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: round(value, 4) if isinstance(value, float) else value
        for name, value in terms.items()
        if name not in ("kind", "allowed")
    }
