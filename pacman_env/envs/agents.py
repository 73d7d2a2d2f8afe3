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
from .core import CoreEnv, Ends
from .spaces import state_limits

PACMAN = "pacman"
Observations = dict[str, Any]  # an agent's: a dictionary of arrays, or one array
_TURN = 2 * np.pi


class SeveralAgents(CoreEnv):
    """``pacman`` and the ghosts that are agents, in N games."""

    def _make_agents(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        self._make_core(n, arguments, ghost_agents=True, **more)
        core = self._core
        if self.config.decisions.when == "event" or self.config.observation.candidates == "nearest":
            forbidden = "decisions.when='event' and observation.candidates='nearest'"
            raise ConfigError(f"{forbidden} are for one agent: here all decide at each tick")
        self._ghosts = {GHOST_NAMES[k]: k for k in core.ghost_agents}
        if not self._ghosts:
            raise ConfigError("ghosts: at least one must have the behaviour 'policy', as in ('policy', 'policy')")
        self._ghost_masks: dict[str, NDArray[np.bool_]] = {}  # (N, C) each, of the last observations
        self.possible_agents = [PACMAN, *self._ghosts]
        self.observation_spaces: dict[str, spaces.Space[Any]] = {PACMAN: core.observation_space()}
        self.action_spaces: dict[str, spaces.Space[Any]] = {PACMAN: core.action_space()}
        for name in self._ghosts:
            self.observation_spaces[name] = core.ghost_observation_space()
            self.action_spaces[name] = spaces.Discrete(self.batch.candidates)
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

    def _decide(self, actions: dict[str, NDArray[Any]]) -> Ends:
        """One decision of every agent, whose actions (N,) are checked; rewards are (N, A)."""
        choices = {number: actions[name] for name, number in self._ghosts.items()}
        reward, terminated, truncated = self._core.step(actions[PACMAN], choices)
        of_ghosts = -reward / len(self._ghosts) if self.config.zero_sum else self._core.ghost_reward()
        return np.stack([reward, *[of_ghosts] * len(self._ghosts)], axis=1), terminated, truncated

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
        columns = [g["x"], g["y"], _within_half_a_turn(g["heading"])]
        columns += [*believed.T, 0.5 * (g["left"] + g["right"]), turns]
        for ghost in ghosts.T:
            velocity = [np.clip(ghost[name], -FAST_MPS, FAST_MPS) for name in ("vx", "vy")]
            columns += [ghost["x"], ghost["y"], *velocity, np.minimum(ghost["speed"], FAST_MPS), ghost["place"]]
        columns += [*batch.alive.T, g["pursued"], g["tick"] * batch.config.execution.tick_s, g["round"], g["score"]]
        return np.stack(columns, axis=1).astype(np.float64)


def _within_half_a_turn(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) the same angles from -pi to pi, without rounding: ``math.remainder`` of each."""
    rest = np.fmod(angles, _TURN)
    return np.where(np.abs(rest) > np.pi, rest - np.copysign(_TURN, rest), rest)
