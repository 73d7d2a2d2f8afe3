"""Environments with several agents: the common base class, and a vector environment with arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ..config import ConfigError
from ..game.ghosts import GHOST_NAMES
from ..observations.kinds import MASK
from ..observations.observer import Observer
from ..observations.robot_features import FAST_MPS
from ..render.window import RENDER_FPS
from .arguments import EnvArguments, takes_env_arguments
from .guard import exclusive, shared
from .resets import ManyGames, Options, Seeds, whole_number
from .rewards import Ends, Step
from .spaces import checked_actions, state_limits

PACMAN = "pacman"
Observations = dict[str, Any]  # by agent: a dictionary of arrays, or one array
_TURN = 2 * np.pi


class SeveralAgents(ManyGames):
    """Base class for N games with the agents ``pacman`` and the ghosts that are agents."""

    def _make_agents(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        self._make_runner(n, arguments, ghost_agents=True, **more)
        self._make_generators()
        runner = self._runner
        if self.config.decisions.when == "event":
            raise ConfigError("decisions.when='event' is for one agent: here all decide at each tick")
        if not runner.ghost_agents:
            raise ConfigError("ghosts: at least one must have the behaviour 'policy', as in ('policy', 'policy')")
        self.possible_agents = [PACMAN, *(GHOST_NAMES[number] for number in runner.ghost_agents)]
        self.observation_spaces = {agent: runner.space_of(observer) for agent, observer in self._observers().items()}
        ghosts = {agent: spaces.Discrete(runner.candidates) for agent in self.possible_agents[1:]}
        self.action_spaces: dict[str, spaces.Space[Any]] = {PACMAN: runner.action_space, **ghosts}
        low, high = np.array(list(state_limits(self.batch).values())).T
        self.state_space = spaces.Box(low, high, dtype=np.float64)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the observation space of an agent in one game, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the action space of an agent in one game, always the same object."""
        return self.action_spaces[agent]

    @property
    def state_names(self) -> list[str]:
        """Return the names of the columns of ``state()``."""
        return list(state_limits(self.batch))

    def _decide(self, actions: dict[str, NDArray[Any]]) -> Ends:
        """Play one decision with actions (N,) by agent; return rewards (N, A), terminated and truncated (N,)."""
        robot, *ghosts = actions.values()
        reward, terminated, truncated = self._runner.step(robot, ghosts)
        rewards = np.empty((len(reward), len(actions)))
        of_ghosts = -reward / len(ghosts) if self.config.zero_sum else self._runner.rewards.of_ghost()
        rewards[:, 0], rewards[:, 1:] = reward, of_ghosts[:, None]
        return rewards, terminated, truncated

    def _observers(self) -> dict[str, Observer]:
        """Return the observers of the agents with their present observations and masks; the next step changes them."""
        observers = self._runner.observer, *self._runner.ghost_observers.values()
        return dict(zip(self.possible_agents, observers, strict=True))

    def _observations(self, first: bool = False) -> Observations:
        """Return the observations of all games, (N, ...), or of the ``first`` game by agent."""
        observers = self._observers().items()
        return {agent: self._runner.observation(observer, first=first) for agent, observer in observers}

    def _states(self) -> NDArray[np.float64]:
        """Return the states of the games, (N, S), with the columns ``state_names``.

        They contain true poses, the believed pose of the robot, and velocities of ghosts, clipped to ``FAST_MPS``.
        """
        self._runner.require_reset()
        situation, batch = self._runner.observer.situation, self.batch
        believed = situation.robot
        g, ghosts = batch.games, batch.ghosts
        turns = (g["right"] - g["left"]) / batch.config.robot.wheel_base_m
        columns = [g["x"], g["y"], _within_half_a_turn(g["heading"])]
        columns += [*believed.T, 0.5 * (g["left"] + g["right"]), turns]
        for k, ghost in enumerate(ghosts.T):
            velocity = [np.clip(ghost[name], -FAST_MPS, FAST_MPS) for name in ("vx", "vy")]
            columns += [ghost["x"], ghost["y"], *velocity, np.minimum(ghost["speed"], FAST_MPS), ghost["place"]]
            if batch.config.power.pellets > 0:
                columns += [situation.frightened_s[:, k], situation.away_s[:, k]]
        columns += [*batch.alive.T, g["pursued"], g["tick"] * batch.config.execution.tick_s, g["round"], g["score"]]
        return np.stack(columns, axis=1).astype(np.float64)


class PacManBotParallelVecEnv(SeveralAgents):
    """Many games of :class:`~pacman_env.envs.pettingzoo_env.PacManBotParallelEnv` at once.

    ```python
    env = pacman_env.parallel_vec_env(64, map="generated", flat=True)
    observations, infos = env.reset(seed=0)
    actions = {agent: np.zeros(64, dtype=np.int64) for agent in env.agents}  # or an array (64, A)
    observations, rewards, terminated, truncated, infos = env.step(actions)
    ```

    Agents, spaces (of one game), rewards and arguments are as in the PettingZoo environment; game i with seed s
    equals that environment with seed s, bit for bit. Observations are a dictionary by agent; its values are arrays
    (N, ...) or dictionaries of arrays. ``rewards`` are float64 (N, A), agents in the order of ``possible_agents``;
    ``terminated`` and ``truncated`` are bool (N,), ``infos`` arrays (N,) by name. With ``observation.mask`` ``"info"``
    the infos contain the masks, int8 (N, A, C).

    ``autoreset_mode`` ``SAME_STEP``: a game that ends starts again in the same step. ``infos["final_observation"]``
    (N,) then contains the last observations by agent (None for other games), and ``final_info`` the last infos.
    ``final_state`` (N, S) contains the last states (0 for other games). Each has a mask ``_final_...``. ``DISABLED``: a
    game that is over stands still, without reward and with its flags unchanged, until ``reset(mask=...)`` starts it
    again. ``num_threads`` threads play the games (0: one per core); the results do not depend on it.
    Use one environment per thread; calls from another thread wait or are refused as in the Gymnasium environment.
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
        """Create the games; raises ConfigError, MapError or ValueError for arguments that cannot be played."""
        self.num_envs = whole_number(num_envs, "num_envs", 1)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            raise ValueError(f"autoreset_mode = {autoreset_mode}: must be AutoresetMode.SAME_STEP or DISABLED")
        self._make_agents(self.num_envs, arguments, num_threads=num_threads)

    @property
    def agents(self) -> list[str]:
        """Return all ``possible_agents``: the agents of a game end together."""
        return list(self.possible_agents)

    @property
    def num_agents(self) -> int:
        """Return the number of agents, A."""
        return len(self.possible_agents)

    @exclusive
    def reset(
        self, seed: Seeds = None, options: Options = None, mask: NDArray[np.bool_] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start new episodes in all games, or in the games of ``mask``, bool (N,); the result covers all games.

        ``seed`` and ``options`` are as in :class:`~pacman_env.envs.pacmanbot_vector.PacManBotVectorEnv`. Raises,
        without any change, ValueError for invalid arguments and ResetNeeded if the first reset does not include all
        games.
        """
        self._reset_games(seed, options, mask, "mask")
        return self._observations(), self._infos()

    @exclusive
    def step(self, actions: NDArray[np.integer[Any]] | Mapping[str, NDArray[Any]]) -> Step:
        """Play one decision of every agent in every game.

        Actions are integers (N, A), agents in the order of ``possible_agents``, or arrays (N,) by agent. Velocities of
        ``pacman`` are numbers (N, 2), v and omega, and are clipped. Raises ValueError, without any change, for invalid
        actions, and ResetNeeded before the first reset.
        """
        self._runner.require_reset()
        rewards, terminated, truncated = self._decide(self._check(actions))
        observations, final = self._observations(), {}
        ended = np.flatnonzero(terminated | truncated)
        if self.autoreset_mode == AutoresetMode.SAME_STEP and len(ended):
            final = self._final(ended, observations)
            self._follow(ended)
            observations = self._observations()
        return observations, rewards, terminated, truncated, {**self._infos(), **final}

    @shared
    def action_masks(self) -> Any:
        """Return the masks of allowed actions: bool (N, A, C), or with velocity actions a dict of (N, C) by ghost.

        Raises ResetNeeded before the first reset.
        """
        self._runner.require_reset()
        if self.config.action != "goal":
            return {agent: observer.allowed != 0 for agent, observer in self._observers().items() if agent != PACMAN}
        return np.stack([observer.allowed for observer in self._observers().values()], axis=1) != 0

    @shared
    def state(self) -> NDArray[np.float64]:
        """Return the states (N, S) with columns ``state_names``; raises ResetNeeded before the first reset."""
        return self._states()

    def stacked(self, observations: Observations) -> Any:
        """Stack the observations of all agents: an array (N, A, ...), or a dictionary of arrays.

        Raises ValueError if the observations of two agents differ in their keys or shapes.
        """
        return _stack(self._by_agent(observations, "observation"), "")

    @shared
    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return one picture (H, W, 3) per game, or None without a render mode."""
        self._runner.require_reset()
        return self._pictures()

    @exclusive
    def close(self) -> None:
        """Do nothing: this environment opens no window."""

    def _by_agent(self, given: Mapping[str, Any], what: str) -> dict[str, Any]:
        missing = [agent for agent in self.possible_agents if agent not in given]
        if missing:
            raise ValueError(f"no {what} of {', '.join(missing)}")
        return {agent: given[agent] for agent in self.possible_agents}

    def _check(self, actions: Any) -> dict[str, NDArray[Any]]:
        """Check actions and return them by agent: int64 (N,), or velocities float64 (N, 2)."""
        if isinstance(actions, Mapping):
            by_agent = self._by_agent(actions, "actions")
            unknown = [str(agent) for agent in actions if agent not in by_agent]
            if unknown:
                raise ValueError(f"actions of {', '.join(unknown)}: the agents are {', '.join(self.possible_agents)}")
            return {agent: self._check_agent(agent, given) for agent, given in by_agent.items()}
        if self.config.action == "velocity":
            raise ValueError(f"actions must be by agent, with velocities of {PACMAN}: {{{PACMAN!r}: (N, 2), ...}}")
        array, shape = np.asarray(actions), (self.num_envs, self.num_agents)
        if array.shape != shape or array.dtype.kind not in "iu":
            raise ValueError(f"actions must be integers of shape {shape}, got {array.dtype} of shape {array.shape}")
        return {agent: self._check_agent(agent, array[:, k]) for k, agent in enumerate(self.possible_agents)}

    def _check_agent(self, agent: str, given: Any) -> NDArray[Any]:
        return checked_actions(self.action_spaces[agent], given, self.num_envs, f" of {agent}")

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = self._runner.infos.of_all(self._runner.observer.allowed)
        if MASK in infos:
            infos[MASK] = self.action_masks().astype(np.int8)
        return infos

    def _final(self, ended: NDArray[np.int64], observations: Observations) -> dict[str, Any]:
        """Return the last observations, infos and states of the games ``ended`` (M,), and their masks (N,)."""
        present, infos, states = self._mask(ended), self._infos(), self._states()
        for array in (*infos.values(), states):
            array[~present] = None if array.dtype == object else 0
        last = self._last_of(ended, observations)
        final = {"final_observation": last, "final_info": infos, "final_state": states}
        return final | {f"_{name}": present.copy() for name in final}


parallel_vec_env = PacManBotParallelVecEnv


def _stack(by_agent: dict[str, Any], where: str) -> Any:
    first, sample = next(iter(by_agent.items()))
    for agent, other in by_agent.items():
        ours, theirs = (sorted(one) if isinstance(one, dict) else one.shape for one in (sample, other))
        if ours != theirs:
            differ = f"observations{where} of {first} and {agent} differ"
            raise ValueError(f"{differ}, so they cannot be stacked: {ours} and {theirs}")
    if isinstance(sample, dict):
        return {key: _stack({agent: one[key] for agent, one in by_agent.items()}, f"[{key!r}]") for key in sample}
    return np.stack(list(by_agent.values()), axis=1)


def _within_half_a_turn(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    rest = np.fmod(angles, _TURN)  # without rounding errors, like math.remainder
    return np.where(np.abs(rest) > np.pi, rest - np.copysign(_TURN, rest), rest)
