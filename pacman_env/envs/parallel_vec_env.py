"""Many games of several agents at once: what all of them see and get, as arrays."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ..render.display import RENDER_FPS
from ..sim.observation.kinds import MASK
from .agents import PACMAN, Observations, SeveralAgents
from .arguments import EnvArguments, checked_games, takes_env_arguments
from .resets import ManyGames


class PacManBotParallelVecEnv(SeveralAgents, ManyGames):
    """Many games of :class:`~pacman_env.envs.pettingzoo_env.PacManBotParallelEnv` at once.

    ```python
    env = pacman_env.parallel_vec_env(64, map="generated", flat=True)
    observations, infos = env.reset(seed=0)
    actions = {agent: np.zeros(64, dtype=np.int64) for agent in env.agents}  # or an array (64, A)
    observations, rewards, terminated, truncated, infos = env.step(actions)
    ```

    Agents, spaces, rewards and arguments are those of the PettingZoo environment; game i with seed s equals a
    PettingZoo environment with seed s, bit for bit. Spaces are of one game. Observations are a dictionary by agent, of
    arrays (N, ...) or of dictionaries of such. ``rewards`` are float64 (N, A), agents in the order of
    ``possible_agents``; ``terminated`` and ``truncated`` bool (N,), since a game ends for all agents at once. ``infos``
    are arrays (N,) by name; with ``observation.mask`` ``"info"`` the masks there are int8 (N, A, C).

    ``autoreset_mode``, ``SAME_STEP``: a game that ends begins anew in the same step, so that observations and infos are
    those of the new episode. ``infos["final_observation"]`` (N,) then holds the last observations by agent of each game
    that ended, and None elsewhere; ``final_info`` the last infos and ``final_state`` (N, S) the last states, 0 in the
    others. All three have a mask ``_final_observation`` and so on, and are there only after a step in which a game
    ended.
    ``DISABLED``: a game that is over stands still, with no reward and its flags as they were, until
    ``reset(mask=...)`` begins it anew.

    ``num_threads`` share the games (0: one for each core); nothing else depends on it.
    """

    metadata: dict[str, Any] = {"name": "pacmanbot_v0", "render_modes": ["rgb_array"], "render_fps": RENDER_FPS}  # noqa: RUF012

    @takes_env_arguments
    def __init__(
        self,
        num_envs: int = 64,
        *,
        arguments: EnvArguments,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        num_threads: int = 1,
    ) -> None:
        """See the PettingZoo environment; raises ConfigError or MapError for arguments that cannot be played."""
        self.num_envs = checked_games(num_envs)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            raise ValueError(f"autoreset_mode = {autoreset_mode}: must be AutoresetMode.SAME_STEP or DISABLED")
        self._make_agents(self.num_envs, arguments, num_threads=num_threads)
        self._make_generators()

    @property
    def agents(self) -> list[str]:
        """All of ``possible_agents``: none leaves before the others."""
        return list(self.possible_agents)

    @property
    def num_agents(self) -> int:
        """A, how many there are."""
        return len(self.possible_agents)

    def reset(
        self,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
        mask: NDArray[np.bool_] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Start new episodes, in all games or those of the mask; what is returned is of all games.

        Args:
            seed: one seed s (game i gets s + i), one per game, or None: the generators go on.
            options: may hold what the single environment's may: ``round_seed`` and ``level``, one for all games or one
                for each, for the episodes that begin now; ``settings``, for all games and until the next reset of all.
            mask: bool (N,); None: all.

        Raises:
            ValueError: the seeds, the mask or the options do not fit the games; nothing has been changed then.
            ResetNeeded: the first reset is not of all games.
        """
        self._reset_games(seed, options, mask, "mask")
        return self._observed(), self._infos()

    def step(
        self, actions: NDArray[np.integer[Any]] | Mapping[str, NDArray[Any]]
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One decision of every agent in every game.

        Args:
            actions: integers (N, A), agents in the order of ``possible_agents``; or by agent (N,), velocities of
                ``pacman`` as numbers (N, 2), v and omega.

        Raises:
            ValueError: actions that are not of these shapes, or not in an agent's space (velocities beyond the limits
                are cut to them); nothing has been changed then.
            ResetNeeded: before the first reset.
        """
        self._core.require_reset()
        rewards, terminated, truncated = self._decide(self._checked(actions))
        observations, final = self._observed(), {}
        ended = np.flatnonzero(terminated | truncated)
        if self.autoreset_mode == AutoresetMode.SAME_STEP and len(ended):
            final = self._final(ended, observations)
            self._follow(ended)
            observations = self._observed()
        return observations, rewards, terminated, truncated, {**self._infos(), **final}

    def action_masks(self) -> Any:
        """Which actions are allowed now: bool (N, A, C), or with velocities (N, C) by the ghost's name.

        Raises ResetNeeded before the first reset.
        """
        self._core.require_reset()
        if self.config.action != "goal":
            return {name: mask.copy() for name, mask in self._ghost_masks.items()}
        return np.stack([self._core.masks(), *self._ghost_masks.values()], axis=1)

    def state(self) -> NDArray[np.float64]:
        """(N, S) the games as they truly are, numbers by ``state_names``; raises ResetNeeded before the first reset."""
        return self._states()

    def stacked(self, observations: Observations) -> Any:
        """Observations of all agents in one: arrays (N, A, ...), or a dictionary of such.

        Raises ValueError where those of two agents differ in their arrays or in the shape of one.
        """
        return _stacked(self._by_agent(observations, "observation"), "")

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture (H, W, 3) per game, in mode ``rgb_array``."""
        self._core.require_reset()
        return self._pictures([self._core])

    def close(self) -> None:
        """Do nothing: nothing is open."""

    def _by_agent(self, given: Mapping[str, Any], what: str) -> dict[str, Any]:
        missing = [agent for agent in self.possible_agents if agent not in given]
        if missing:
            raise ValueError(f"no {what} of {', '.join(missing)}")
        return {agent: given[agent] for agent in self.possible_agents}

    def _checked(self, actions: Any) -> dict[str, NDArray[Any]]:
        """By agent, as the games take them."""
        if isinstance(actions, Mapping):
            by_agent = self._by_agent(actions, "actions")
            unknown = [str(agent) for agent in actions if agent not in by_agent]
            if unknown:
                raise ValueError(f"actions of {', '.join(unknown)}: the agents are {', '.join(self.possible_agents)}")
            return {agent: self._checked_of(agent, np.asarray(given)) for agent, given in by_agent.items()}
        if self.config.action == "velocity":
            raise ValueError(f"actions must be by agent, with velocities of {PACMAN}: {{{PACMAN!r}: (N, 2), ...}}")
        array, shape = np.asarray(actions), (self.num_envs, self.num_agents)
        if array.shape != shape or array.dtype.kind not in "iu":
            raise ValueError(f"actions must be integers of shape {shape}, got {array.dtype} of shape {array.shape}")
        return {agent: self._checked_of(agent, array[:, k]) for k, agent in enumerate(self.possible_agents)}

    def _checked_of(self, agent: str, given: NDArray[Any]) -> NDArray[Any]:
        space = self.action_spaces[agent]
        goals = isinstance(space, spaces.Discrete)
        shape: tuple[int, ...] = (self.num_envs,) if goals else (self.num_envs, 2)
        if given.shape != shape or given.dtype.kind not in ("iu" if goals else "fiu"):
            wanted = f"{self.num_envs} {'integers' if goals else 'pairs of v and omega'}"
            raise ValueError(f"actions of {agent} must be {wanted}, got {given.dtype} of shape {given.shape}")
        if isinstance(space, spaces.Discrete):
            bad, rule = (given < 0) | (given >= space.n), f"must be 0 to {space.n - 1}"
        else:
            bad, rule = ~np.isfinite(given).all(axis=1), "must be two finite numbers"
        for game in np.flatnonzero(bad)[:1].tolist():
            raise ValueError(f"action {given[game].tolist()} of {agent} in game {game}: {rule}")
        return np.ascontiguousarray(given, dtype=np.int64 if goals else np.float64)

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = self._core.infos()
        if MASK in infos:
            infos[MASK] = self.action_masks().astype(np.int8)
        return infos

    def _final(self, ended: NDArray[np.int64], observations: Observations) -> dict[str, Any]:
        """Last observations, infos and states of the games that have just ended."""
        last = np.full(self.num_envs, None, dtype=object)
        for i in ended.tolist():
            last[i] = copy.deepcopy(self._core.of_game(observations, i))  # not to keep those of all games in memory
        others = np.ones(self.num_envs, dtype=np.bool_)
        others[ended] = False
        infos, states = self._infos(), self._states()
        for array in (*infos.values(), states):
            array[others] = None if array.dtype == object else 0
        final = {"final_observation": last, "final_info": infos, "final_state": states}
        return final | {f"_{name}": ~others for name in final}


parallel_vec_env = PacManBotParallelVecEnv


def _stacked(by_agent: dict[str, Any], where: str) -> Any:
    first, seen = next(iter(by_agent.items()))
    for agent, other in by_agent.items():
        ours, theirs = (sorted(one) if isinstance(one, dict) else one.shape for one in (seen, other))
        if ours != theirs:
            differ = f"observations{where} of {first} and {agent} differ"
            raise ValueError(f"{differ}, so they cannot be stacked: {ours} and {theirs}")
    if isinstance(seen, dict):
        return {key: _stacked({agent: one[key] for agent, one in by_agent.items()}, f"[{key!r}]") for key in seen}
    return np.stack(list(by_agent.values()), axis=1)
