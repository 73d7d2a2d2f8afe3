"""The multi-agent PettingZoo environment: the same game with ghosts that are agents."""

from __future__ import annotations

import inspect
import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from ..config import ConfigError
from ..game.ghosts import GHOST_NAMES
from ..render.display import RENDER_FPS, Display
from ..sim.observation.kinds import MASK
from ..sim.observation.robot_features import FAST_MPS
from .arguments import EnvArguments, takes_env_arguments
from .core import CoreEnv
from .reset_options import ResetOptions
from .spaces import (
    checked_action,
    ghost_action_space,
    state_limits,
)

PACMAN = "pacman"
Rewards = Literal["zero_sum", "separate"]
Observations = dict[str, Any]  # an agent's: a dictionary of arrays, or one array

_ONE = np.zeros(1, dtype=np.int64)


class PacManBotParallelEnv(CoreEnv, Display, ParallelEnv[str, dict[str, Any], Any]):
    """
    ## Description
    The game of `pacman_env/PacManBot-v0` for two players and more: `pacman` names the robot's next goal, `clyde` the
    place he goes to himself. Both decide at the same time, every 0.5 s. With `ghosts=("policy", "policy")` there is
    an agent `blinky` too, then `pinky` and `inky`; ghosts with another behaviour play by themselves.

    ```python
    env = pacman_env.parallel_env(map="house", rewards="zero_sum")
    observations, infos = env.reset(seed=0)
    actions = {agent: env.action_space(agent).sample(observations[agent]["action_mask"]) for agent in env.agents}
    observations, rewards, terminations, truncations, infos = env.step(actions)
    ```

    `pacman_env.env(...)` is the same game agent by agent (AEC). Both are in PettingZoo's registry (1.27 and later):
    `pettingzoo.make("parallel", "pacman_env/PacManBot-v0")`, or `"aec"`. `PacManBot-v1` is the same with the shapes
    that learners take: `observation="flat"`, `normalize=True`, `mask="beside"`, `numeric_info=True`,
    `timeout="termination"`.

    ## Action Spaces
    - `pacman`: as in the Gymnasium environment.
    - a ghost: `Discrete(C)`: the robot's candidates are places that he can go to, as far as he fits in; the last one
      is to wander on: he goes where he is going, and then draws his own targets as the original Clyde does.

    What the mask forbids makes the robot hold and the ghost wander on.

    ## Observation Spaces
    `pacman` sees what the Gymnasium environment shows. A ghost sees the features with himself as Clyde, in the robot's
    frame: `path_clyde` are his own ways, `is_current` is the place he was sent to, a candidate is a pellet as long as
    one lies there. `action_mask` is in both. `observation="flat"`, `normalize` and `mask` hold for all agents: with
    `mask="beside"` each sees `{"observation": ..., "action_mask": ...}`, as in PettingZoo's own games with masks.

    ## Rewards
    `pacman` gets the Gymnasium environment's reward. `rewards="zero_sum"`: the ghosts share its negative (each gets an
    equal part). `"separate"`: each ghost gets 10 when the robot is caught, -0.002 for the time, -5 when it completes
    the round or the time is over (`config.ghost_reward`).

    ## State
    `state()`: float64, see `state_names`: true and believed pose of the robot, its velocities, for each ghost where he
    is, his velocity, speed and the place he was sent to, which pellets are left, the robot's goal, time, round, score.

    ## Episode End
    For all agents at once, as in the Gymnasium environment.

    ## Arguments
    Those of the Gymnasium environment, `rewards`, and `max_cycles`: truncation after so many decisions, as a time
    limit outside of the game. `ghosts` is `("policy",)` by default.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "pacmanbot_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": RENDER_FPS,
        "is_parallelizable": True,
    }

    @takes_env_arguments
    def __init__(
        self, *, arguments: EnvArguments, rewards: Rewards = "zero_sum", max_cycles: int | None = None
    ) -> None:
        """See the class; raises ConfigError or MapError for arguments that cannot be played."""
        if rewards not in ("zero_sum", "separate"):
            raise ConfigError(f"rewards = {rewards!r}: choose zero_sum or separate")
        if max_cycles is not None and (not isinstance(max_cycles, int) or max_cycles < 1):
            raise ConfigError(f"max_cycles = {max_cycles!r}: must be a whole number of at least 1")
        if arguments.ghosts is None and arguments.config is None and "clyde.ghosts" not in (arguments.settings or {}):
            arguments = replace(arguments, ghosts=("policy",))
        self._make_core(1, arguments, ghost_agents=True)
        if self.config.decisions.when == "event" or self.config.observation.candidates == "nearest":
            raise ConfigError("decide='event' and candidates='nearest' are for one agent: here all decide at each tick")
        self._ghosts = {GHOST_NAMES[k]: k for k in self._core.ghost_agents}
        if not self._ghosts:
            raise ConfigError("ghosts: at least one must have the behaviour 'policy', as in ('policy', 'policy')")
        self.rewards = rewards
        self.max_cycles = max_cycles
        self._cycles = 0
        self.possible_agents = [PACMAN, *self._ghosts]
        self.agents: list[str] = []
        self.observation_spaces: dict[str, spaces.Space[Any]] = {PACMAN: self._core.observation_space()}
        self.action_spaces: dict[str, spaces.Space[Any]] = {PACMAN: self._core.action_space()}
        for name in self._ghosts:
            self.observation_spaces[name] = self._core.ghost_observation_space()
            self.action_spaces[name] = ghost_action_space(self.batch)
        low, high = np.array(list(state_limits(self.batch).values())).T
        self.state_space = spaces.Box(low, high, dtype=np.float64)
        self._generator: np.random.Generator | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent; the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent; the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Start a new episode; seed and options are as the Gymnasium environment's."""
        wanted = ResetOptions.of(options, 1, "options")  # by this name PettingZoo's judge asks for nothing
        levels = wanted.levels(self.batch.source, _ONE)
        self._play_by(wanted.settings)
        if seed is not None or self._generator is None:
            self._generator, _ = seeding.np_random(seed)
        self._core.reset(_ONE, wanted.seeds(_ONE, [self._generator]), levels)
        self.agents = list(self.possible_agents)
        self._cycles = 0
        if self.render_mode == "human":
            self.render()
        return self._seen()

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One decision of every agent.

        Raises:
            ValueError: an agent has no action, or one that :meth:`checked` refuses; nothing has been changed then.
            ResetNeeded: before the first reset.
        """
        self._core.require_reset()
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"no action of {', '.join(missing)}")
        checked = {agent: self.checked(agent, actions[agent]) for agent in self.agents}
        choices = {number: checked[name] for name, number in self._ghosts.items()}
        reward, terminated, truncated = self._core.step(np.array([checked[PACMAN]]), choices)
        self._cycles += 1
        if self.max_cycles is not None and self._cycles >= self.max_cycles and not terminated[0]:
            truncated[0] = True
        agents = self.agents
        rewards = dict(zip(agents, [float(reward[0]), *self._ghost_rewards(float(reward[0]))], strict=True))
        if terminated[0] or truncated[0]:
            self.agents = []
        if self.render_mode == "human":
            self.render()
        observations, infos = self._seen()
        return (
            observations,
            rewards,
            dict.fromkeys(agents, bool(terminated[0])),
            dict.fromkeys(agents, bool(truncated[0])),
            infos,
        )

    def checked(self, agent: str, action: Any) -> Any:
        """The action as the game takes it.

        Raises:
            ValueError: it is not in the agent's space; but velocities beyond the limits are cut to them.
        """
        return checked_action(self.action_spaces[agent], action, f" of {agent}")

    def state(self) -> NDArray[np.float64]:
        """The whole game as it truly is; the numbers are named by ``state_names``.

        Raises:
            ResetNeeded: before the first reset.
        """
        batch, believed = self.batch, self.situation.robot[0]
        g, ghosts = batch.games[0], batch.ghosts[0]
        heading = math.remainder(g["heading"], 2 * math.pi)
        robot = [g["x"], g["y"], heading, *believed]
        velocity = [0.5 * (g["left"] + g["right"]), (g["right"] - g["left"]) / batch.config.robot.wheel_base_m]
        each = []
        for ghost in ghosts:
            each += [ghost["x"], ghost["y"], *np.clip([ghost["vx"], ghost["vy"]], -FAST_MPS, FAST_MPS)]
            each += [min(ghost["speed"], FAST_MPS), ghost["place"]]
        game = [g["pursued"], g["tick"] * batch.config.execution.tick_s, g["round"], g["score"]]
        return np.concatenate([robot, velocity, each, batch.alive[0], game]).astype(np.float64)

    @property
    def state_names(self) -> list[str]:
        """The names of the numbers of ``state()``."""
        return list(state_limits(self.batch))

    def _seen(self) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Observations and infos of all agents."""
        core = self._core
        situations = {name: self.batch.situation(number) for name, number in self._ghosts.items()}
        seen = {PACMAN: core.observe()} | {name: core.observe_ghost(one) for name, one in situations.items()}
        info = core.info_of_game()
        infos = {agent: dict(info) for agent in self.possible_agents}
        if MASK in info:
            for name, situation in situations.items():
                infos[name][MASK] = situation.mask[0].astype(np.int8)
        return {agent: core.of_game(observation, 0) for agent, observation in seen.items()}, infos

    def _ghost_rewards(self, pacman: float) -> list[float]:
        count = len(self._ghosts)
        if self.rewards == "zero_sum":
            return [-pacman / count] * count
        return [float(self._core.ghost_reward()[0])] * count


class _InTurn(parallel_to_aec_wrapper):
    """PettingZoo's own, but a wrong action is refused when it is made, not when the last agent has made his."""

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if not (self.terminations[agent] or self.truncations[agent]):
            self.env.checked(agent, action)
        super().step(action)


parallel_env = PacManBotParallelEnv


def env(*arguments: Any, **named: Any) -> AECEnv[str, Any, Any]:
    """The same game agent by agent: Pac-Man names his goal, then the ghosts; the world moves after the last.

    The arguments are those of :class:`PacManBotParallelEnv`.
    """
    return OrderEnforcingWrapper(_InTurn(PacManBotParallelEnv(*arguments, **named)))


env.__signature__ = inspect.signature(PacManBotParallelEnv)  # type: ignore[attr-defined]
