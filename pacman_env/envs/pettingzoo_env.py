"""The multi-agent PettingZoo environment: the same game with ghosts that are agents."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from ..render.display import RENDER_FPS, Display
from ..sim.observation.kinds import MASK
from .agents import PACMAN as PACMAN
from .agents import Observations, SeveralAgents
from .arguments import EnvArguments, takes_env_arguments
from .resets import ResetOptions
from .spaces import checked_action

_ONE = np.zeros(1, dtype=np.int64)


class PacManBotParallelEnv(SeveralAgents, Display, ParallelEnv[str, dict[str, Any], Any]):
    """
    ## Description
    The game of `pacman_env/PacManBot-v0` for two players and more: `pacman` names the robot's next goal, `clyde` the
    place he goes to himself. Both decide at the same time, every 0.5 s. With `ghosts=("policy", "policy")` there is
    an agent `blinky` too, then `pinky` and `inky`; ghosts with another behaviour play by themselves.

    ```python
    env = pacman_env.parallel_env(map="house", settings={"clyde.speed_mps": 0.35})
    observations, infos = env.reset(seed=0)
    actions = {agent: env.action_space(agent).sample(observations[agent]["action_mask"]) for agent in env.agents}
    observations, rewards, terminations, truncations, infos = env.step(actions)
    ```

    `pacman_env.env(...)` is the same game agent by agent (AEC). Both are in PettingZoo's registry (1.27 and later):
    `pettingzoo.make("parallel", "pacman_env/PacManBot-v0")`, or `"aec"`. `PacManBotFlat-v0` is the same with the shapes
    that learners take, `flat=True`.

    ## Action Spaces
    - `pacman`: as in the Gymnasium environment.
    - a ghost: `Discrete(C)`: the robot's candidates are places that he can go to, as far as he fits in; the last one
      is to wander on: he goes where he is going, and then draws his own targets as the original Clyde does.

    What the mask forbids makes the robot hold and the ghost wander on.

    ## Observation Spaces
    `pacman` sees what the Gymnasium environment shows. A ghost sees the features with himself as Clyde, in the robot's
    frame: `path_clyde` are its own path lengths, `is_current` is the place it was sent to, a candidate is a pellet as
    long as one lies there. `action_mask` is in both. `observation="flat"` and the settings `observation.normalize` and
    `observation.mask` hold for all agents: with the mask `"beside"` each sees
    `{"observation": ..., "action_mask": ...}`, as in PettingZoo's own games with masks.

    ## Rewards
    `pacman` gets the Gymnasium environment's reward, the ghosts share its negative (each gets an equal part). With the
    setting `zero_sum` False each ghost gets 10 when the robot is caught, -0.002 for the time, -5 when it completes the
    round or the time is over (`config.ghost_reward`).

    ## State
    `state()`: float64, see `state_names`: true and believed pose of the robot, its velocities, for each ghost where he
    is, his velocity, speed and the place he was sent to, which pellets are left, the robot's goal, time, round, score.

    ## Episode End
    For all agents at once, as in the Gymnasium environment.

    ## Arguments
    Those of the Gymnasium environment; `ghosts` is `("policy",)` by default. The setting `max_cycles` truncates an
    episode after so many decisions, as a time limit outside of the game. With `flat=True` the settings
    `observation.flat`, `observation.normalize` and `observation.numeric_info` are True, `observation.mask` is
    `"beside"`, and `timeout` is `"termination"`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "pacmanbot_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": RENDER_FPS,
        "is_parallelizable": True,
    }

    @takes_env_arguments
    def __init__(self, *, arguments: EnvArguments) -> None:
        """See the class; raises ConfigError or MapError for arguments that cannot be played."""
        self._make_agents(1, arguments)
        self.agents: list[str] = []
        self._generator: np.random.Generator | None = None

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Start a new episode; seed and options are as the Gymnasium environment's."""
        wanted = ResetOptions.of(options, 1, "options")  # by this name PettingZoo's judge asks for nothing
        levels = wanted.levels(self.batch.source, _ONE)
        self._play_by(wanted.settings)
        if seed is not None:
            self._generator, _ = seeding.np_random(seed)
        self._core.reset(_ONE, wanted.seeds(_ONE, [self.np_random]), levels)
        self.agents = list(self.possible_agents)
        if self.render_mode == "human":
            self.render()
        return self._seen()

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One decision of every agent.

        Raises:
            ValueError: an agent has no action, or one that is not in its space; nothing has been changed then.
            ResetNeeded: before the first reset.
        """
        self._core.require_reset()
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"no action of {', '.join(missing)}")
        checked = {agent: self.checked(agent, actions[agent]) for agent in self.agents}
        reward, terminated, truncated = self._decide({agent: action[None] for agent, action in checked.items()})
        agents = self.agents
        rewards = dict(zip(agents, reward[0].tolist(), strict=True))
        if terminated[0] or truncated[0]:
            self.agents = []
        if self.render_mode == "human":
            self.render()
        observations, infos = self._seen()
        ends, cuts = (dict.fromkeys(agents, bool(flags[0])) for flags in (terminated, truncated))
        return observations, rewards, ends, cuts, infos

    @property
    def np_random(self) -> np.random.Generator:
        """Draws the seeds of the episodes, as in Gymnasium; SuperSuit's ``frame_skip_v0`` draws from it."""
        if self._generator is None:
            self._generator, _ = seeding.np_random()
        return self._generator

    def checked(self, agent: str, action: Any) -> Any:
        """The action as the game takes it; raises ValueError where it is not in the agent's space.

        Velocities beyond the limits are cut to them.
        """
        return checked_action(self.action_spaces[agent], action, f" of {agent}")

    def state(self) -> NDArray[np.float64]:
        """(S,) the game as it truly is, numbers by ``state_names``; raises ResetNeeded before the first reset."""
        return self._states()[0]

    def _seen(self) -> tuple[Observations, dict[str, dict[str, Any]]]:
        observations, info = self._observed(), self._core.info_of_game()
        infos = {agent: dict(info) for agent in self.possible_agents}
        if MASK in info:
            for name, mask in self._ghost_masks.items():
                infos[name][MASK] = mask[0].astype(np.int8)
        return {agent: self._core.of_game(observation, 0) for agent, observation in observations.items()}, infos


class _InTurn(parallel_to_aec_wrapper):
    """PettingZoo's own, but a wrong action is refused when it is made, not when the last agent has made its own."""

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
