"""What environments of several agents share, of N games: agents, spaces, observations, rewards, the whole state."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import ConfigError
from ..game.ghosts import GHOST_NAMES
from ..sim.observation.robot_features import FAST_MPS
from .arguments import EnvArguments
from .core import CoreEnv
from .spaces import ghost_action_space, state_limits

PACMAN = "pacman"
Observations = dict[str, Any]  # an agent's: a dictionary of arrays, or one array

_TURN = 2 * np.pi


class SeveralAgents(CoreEnv):
    """``pacman`` and the ghosts that are agents, in N games."""

    def _make_agents(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        self._make_core(n, arguments, ghost_agents=True, **more)
        if self.config.decisions.when == "event" or self.config.observation.candidates == "nearest":
            forbidden = "decisions.when='event' and observation.candidates='nearest'"
            raise ConfigError(f"{forbidden} are for one agent: here all decide at each tick")
        self._ghosts = {GHOST_NAMES[k]: k for k in self._core.ghost_agents}
        if not self._ghosts:
            raise ConfigError("ghosts: at least one must have the behaviour 'policy', as in ('policy', 'policy')")
        self._cycles = np.zeros(n, dtype=np.int64)  # decisions of each episode
        self._cut = np.zeros(n, dtype=np.bool_)  # by max_cycles, and not reset since
        self._ghost_masks: dict[str, NDArray[np.bool_]] = {}  # (N, C) each, as last seen
        self.possible_agents = [PACMAN, *self._ghosts]
        self.observation_spaces: dict[str, spaces.Space[Any]] = {PACMAN: self._core.observation_space()}
        self.action_spaces: dict[str, spaces.Space[Any]] = {PACMAN: self._core.action_space()}
        for name in self._ghosts:
            self.observation_spaces[name] = self._core.ghost_observation_space()
            self.action_spaces[name] = ghost_action_space(self.batch)
        low, high = np.array(list(state_limits(self.batch).values())).T
        self.state_space = spaces.Box(low, high, dtype=np.float64)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, in one game; the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, in one game; the same object each time."""
        return self.action_spaces[agent]

    @property
    def state_names(self) -> list[str]:
        """The names of the numbers of ``state()``."""
        return list(state_limits(self.batch))

    def _begin(
        self, index: NDArray[np.int64], seeds: NDArray[np.uint64], levels: NDArray[np.int64] | None = None
    ) -> None:
        """New episodes in the games ``index``."""
        self._core.reset(index, seeds, levels)
        self._cycles[index] = 0
        self._cut[index] = False

    def _decide(
        self, actions: dict[str, NDArray[Any]]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """One decision of every agent, whose actions (N,) are checked; games that are over stand still.

        Rewards (N, A), terminated (N,), truncated (N,).
        """
        choices = {number: actions[name] for name, number in self._ghosts.items()}
        plays = None if self.config.max_cycles is None or not self._cut.any() else ~self._cut
        reward, terminated, truncated = self._core.step(actions[PACMAN], choices, plays)
        if self.config.max_cycles is not None:
            self._cycles += 1
            self._cut |= (self._cycles >= self.config.max_cycles) & ~terminated
            truncated |= self._cut
        of_ghosts = -reward / len(self._ghosts) if self.config.zero_sum else self._core.ghost_reward()
        rewards = np.empty((len(reward), 1 + len(self._ghosts)))
        rewards[:, 0], rewards[:, 1:] = reward, of_ghosts[:, None]
        return rewards, terminated, truncated

    def _observed(self) -> Observations:
        """Of all agents in all games, (N, ...); their masks are kept."""
        core = self._core
        situations = {name: self.batch.situation(number) for name, number in self._ghosts.items()}
        self._ghost_masks = {name: situation.mask for name, situation in situations.items()}
        return {PACMAN: core.observe()} | {name: core.observe_ghost(one) for name, one in situations.items()}

    def _states(self) -> NDArray[np.float64]:
        """(N, S) the games as they truly are; the numbers are named by ``state_names``."""
        believed, batch = self.situation.robot, self.batch
        g, ghosts = batch.games, batch.ghosts
        turns = (g["right"] - g["left"]) / batch.config.robot.wheel_base_m
        robot = [g["x"], g["y"], _within_half_a_turn(g["heading"]), *believed.T, 0.5 * (g["left"] + g["right"]), turns]
        each: list[NDArray[Any]] = []
        for ghost in ghosts.T:
            velocity = [np.clip(ghost[name], -FAST_MPS, FAST_MPS) for name in ("vx", "vy")]
            each += [ghost["x"], ghost["y"], *velocity, np.minimum(ghost["speed"], FAST_MPS), ghost["place"]]
        game = [g["pursued"], g["tick"] * batch.config.execution.tick_s, g["round"], g["score"]]
        states, before, after = np.empty((batch.n, *self.state_space.shape)), [*robot, *each], len(game)
        for k, column in enumerate(before):
            states[:, k] = column
        states[:, len(before) : -after] = batch.alive
        for k, column in enumerate(game):
            states[:, k - after] = column
        return states


def _within_half_a_turn(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) the same angles from -pi to pi, without rounding: ``math.remainder`` of each."""
    rest = np.fmod(angles, _TURN)
    return np.where(np.abs(rest) > np.pi, rest - np.copysign(_TURN, rest), rest)
