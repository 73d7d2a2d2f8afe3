"""Read a robot's rounds from its bags as if they were recorded in the environment.

Observations are made from the robot's knowledge; rewards follow from the game's statuses and the configuration.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.config.composition import differences
from pacman_env.envs.arguments import EnvArguments
from pacman_env.envs.game_runner import GameRunner
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.game.reward import Rewards, reward
from pacman_env.ros import topics
from pacman_env.ros.bags.bag import BagError, open_bag
from pacman_env.ros.bags.bag_walk import Walk, recorded_config
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.kinds import BUILT_IN_KINDS
from pacman_env.sim.observation.robot_view import RobotView
from pacman_env.sim.observation.situation import Situation

from .recording import ROUND, RecordedRounds, flattened

KINDS = [kind.name for kind in BUILT_IN_KINDS.values() if not kind.simulated]
_CODES = {word: code for code, word in enumerate(OUTCOMES.tolist())}
#: Sections of a configuration that affect how learners see rounds, but not how rounds are played.
_NOT_PLAYED = ("observation", "action", "decisions", "randomize", "max_cycles", "num_levels", "start_level")


class RobotRounds:
    """Rounds of bags in an environment; raises BagError, or ConfigError for kinds that need the simulator."""

    def __init__(self, bags: Sequence[Path], arguments: EnvArguments, namespace: str | None = None) -> None:
        """Read the game's configuration from the first bag; ``arguments`` supply everything else."""
        self._bags, self._namespace = bags, namespace
        self.unchecked: dict[str, str] = {}  # reasons by bag why damage cannot be ruled out
        with open_bag(bags[0], namespace) as bag:
            self.arguments = _played_by(recorded_config(bag), arguments)
        self._runner = GameRunner(1, self.arguments)
        for kind in self._runner.config.observation.kinds:
            if kind not in KINDS:
                raise ConfigError(f"observation kind {kind!r}: rounds of a robot provide only {', '.join(KINDS)}")

    def rounds(self) -> Iterator[RecordedRounds]:
        """Yield the rounds with at least one decision, bag after bag."""
        for path in self._bags:
            with open_bag(path, self._namespace) as bag:
                if not bag.has(topics.SCORES):
                    raise BagError(f"{path}: no {topics.SCORES.name}: the choices of its goal selector are not known")
                recorder, config = _RoundRecorder(self._runner), recorded_config(bag)
                walk = Walk(bag, map_assets(self.arguments.map, config), config, recorder)
                recorder.view, batch = walk.view, self._runner.batch
                if walk.view.hold != batch.hold or len(config.clyde.ghosts) != batch.ghosts.shape[1]:
                    raise BagError(f"{path}: has other pellets, refuges or ghosts than {self._bags[0]}")
                walk.run()
            if bag.unchecked:
                self.unchecked[path.name] = bag.unchecked
            yield from recorder.rounds


def _played_by(played: Config, arguments: EnvArguments) -> EnvArguments:
    """Return the arguments of a played game; ghosts of a policy become wandering ones, as only their number matters."""
    changes = differences(make_config("robot").as_dict(), played.as_dict())
    changed = {name: value for name, (_, value) in changes.items() if name.partition(".")[0] not in _NOT_PLAYED}
    changed.pop("clyde.ghosts", None)
    ghosts = tuple("wander" if name == "policy" else name for name in played.clyde.ghosts)
    if isinstance(arguments.settings, Config):
        raise ConfigError("settings is a Config: a robot's rounds have the configuration of their bag")
    return replace(arguments, ghosts=ghosts, preset="robot", settings={**changed, **(arguments.settings or {})})


class _RoundRecorder:
    """Listener of a walk that collects its rounds and omits those without a decision."""

    view: RobotView  # the view that the walk updates

    def __init__(self, runner: GameRunner) -> None:
        self.rounds: list[RecordedRounds] = []
        self._runner = runner
        self._begin()

    def _begin(self) -> None:
        self._seen: list[dict[str, Any]] = []
        self._masks: list[Any] = []
        self._actions: list[int] = []
        self._at_s: list[float] = []
        self._collected: dict[str, float] = {}  # time by pellet
        self._caught: dict[str, float] = {}  # time by number and name of the ghost
        self._unlisted = self._spawned = 0
        self._word = ""

    def begin(self, at_s: float) -> None:
        self._begin()

    def report(self, at_s: float, status: str) -> None:
        word, _, number = status.partition(":")
        if word == "pellet_collected":
            self._collected.setdefault(number, at_s)
        elif word == "ghost_caught":
            self._caught.setdefault(number, at_s)
        elif word in ("death_detected", "game_complete"):
            self._word = word

    def decide(self, at_s: float, situation: Situation, recorded: int | None) -> None:
        runner = self._runner
        self._look(situation)
        self._spawned = max(self._spawned, int(situation.pellets_left[0]) + len(self._collected))
        assert recorded is not None  # bags without choices are refused above
        (action,), (listed,) = runner.observer.actions_of(np.array([recorded]))
        self._unlisted += not listed
        self._actions.append(int(action))
        self._at_s.append(at_s)

    def end(self, at_s: float, state: str, situation: Situation | None) -> None:
        if not self._actions:
            return
        if situation is None:  # repeat the last observation
            self._seen.append(self._seen[-1])
            self._masks.append(self._masks[-1])
        else:
            self._look(situation)
        outcome = self._outcome(state)
        over = outcome != "running"
        count = len(self._actions)
        elapsed_s = np.diff([*self._at_s, at_s])
        rewards = self._rewards(elapsed_s, outcome)
        about = np.zeros(1, dtype=ROUND)
        about["outcome"], about["decisions"], about["return"] = _CODES[outcome], count, rewards.sum()
        about["collected"], about["spawned"], about["unlisted"] = len(self._collected), self._spawned, self._unlisted
        last = np.arange(count) == count - 1
        ends = last & over, last & (not over)
        seen = {key: np.stack([one[key] for one in self._seen]) for key in self._seen[0]}
        masks = np.stack(self._masks).astype(np.int8)
        actions = np.array(self._actions, dtype=np.int64)
        self.rounds.append(RecordedRounds(about, seen, masks, actions, rewards, *ends, elapsed_s))
        self._begin()

    def _look(self, situation: Situation) -> None:
        seen = flattened(self._runner.observe_from(situation))
        self._seen.append({key: array[0] for key, array in seen.items()})
        self._masks.append(self._runner.masks()[0])

    def _outcome(self, state: str) -> str:
        """Return the outcome of a round; ``running`` if a person interrupted it."""
        if state == "dying" or self._word == "death_detected":
            return "caught"
        if state == "complete" or self._word == "game_complete":
            return "complete" if len(self._collected) >= self._spawned else "cleared"
        return "running"

    def _rewards(self, elapsed_s: Any, outcome: str) -> Any:
        """Return the rewards (D,) of ticks, events and the end as in the environment, without ``reward.progress``."""
        config, goals = self._runner.config, self.view.goals
        power = {goals.ids[slot] for slot in np.flatnonzero(goals.power)}
        times = self._collected.values(), [at_s for pellet, at_s in self._collected.items() if int(pellet) in power]
        pellets, powers, caught = map(self._counts, (*times, self._caught.values()))
        ends = np.zeros(len(elapsed_s), dtype=np.int64)
        ends[-1] = _CODES[outcome]
        return reward(elapsed_s / config.execution.tick_s, pellets, powers, caught, 0, ends, Rewards.of(config.reward))

    def _counts(self, times_s: Iterable[float]) -> Any:
        """Return the number of events (D,) after each decision and before the next one."""
        decision = np.searchsorted(self._at_s, list(times_s), side="right") - 1
        return np.bincount(np.maximum(decision, 0), minlength=len(self._at_s))
