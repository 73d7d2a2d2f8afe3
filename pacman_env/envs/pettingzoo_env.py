"""PettingZoo environments: the same game with ghosts that are agents."""

import inspect
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from ..observations.kinds import MASK
from ..render.window import RENDER_FPS, Display
from .arguments import EnvArguments, takes_env_arguments
from .guard import Guarded, exclusive, shared
from .parallel_vec_env import PACMAN as PACMAN
from .parallel_vec_env import Observations, SeveralAgents
from .resets import Options, Seed, checked_seed
from .spaces import checked_action

Infos = dict[str, dict[str, Any]]  # by agent


class PacManBotParallelEnv(SeveralAgents, Display, ParallelEnv[str, dict[str, Any], Any]):
    """The game of `pacman_env/PacManBot-v2` for two or more agents, which decide at the same time, every 0.5 s.

    ```python
    env = pacman_env.parallel_env(map="house", settings={"clyde.speed_mps": 0.35})
    observations, infos = env.reset(seed=0)
    actions = {agent: env.action_space(agent).sample(observations[agent]["action_mask"]) for agent in env.agents}
    observations, rewards, terminations, truncations, infos = env.step(actions)
    ```

    - Agents: `pacman`, and the ghosts whose behaviour is `"policy"`: `clyde`, `blinky`, `pinky`, `inky` in this order.
    - Actions: `pacman` acts as in the Gymnasium environment. The action of a ghost is `Discrete(C)`: the candidate to
      go to; the last one makes it wander. A forbidden action makes the robot hold and the ghost wander. With the
      setting `observation.candidates` `"nearest"` all agents choose among the places nearest to the robot.
    - Observations: `pacman` observes as in the Gymnasium environment. A ghost observes the features with itself as
      Clyde, in the robot's frame. Settings of the observation apply to all agents.
    - Rewards: `pacman` gets the reward of the Gymnasium environment. The ghosts share its negative, or with the
      setting `zero_sum` False each gets `config.ghost_reward`. Episodes end for all agents together.
    - Arguments: as in the Gymnasium environment; `ghosts` is `("policy",)` by default. The setting `max_cycles`
      truncates episodes after that many decisions. With `flat=True` the mask is next to the flat observation.

    - Threads: use one environment per thread. Calls from another thread wait or are refused as in the Gymnasium
      environment.

    `docs/environments/pettingzoo.md` describes all of this in detail, PettingZoo's registry included.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "pacmanbot_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": RENDER_FPS,
        "is_parallelizable": True,
    }
    _own_state = ("_generators", "_next", "agents")
    render, close = shared(Display.render), exclusive(Display.close)

    @takes_env_arguments
    def __init__(self, *, arguments: EnvArguments) -> None:
        """Create the environment; raises ConfigError or MapError for arguments that cannot be played."""
        self._make_agents(1, arguments)
        self.agents: list[str] = []

    @exclusive
    def reset(self, seed: Seed = None, options: Options = None) -> tuple[Observations, Infos]:
        """Start a new episode; ``seed`` and ``options`` are as in the Gymnasium environment."""
        # PettingZoo's test passes an option with the name "options" and expects no effect.
        self._reset_games(checked_seed(seed), options, more=("options",))
        self.agents = list(self.possible_agents)
        if self.render_mode == "human":
            self.render()
        return self._result()

    @exclusive
    def step(
        self, actions: dict[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Play one decision of every agent.

        Raises ValueError, without any change, if an agent has no action or one outside its space, and ResetNeeded
        before the first reset.
        """
        self._runner.require_reset()
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
        observations, infos = self._result()
        ends, cuts = (dict.fromkeys(agents, bool(flags[0])) for flags in (terminated, truncated))
        return observations, rewards, ends, cuts, infos

    @property
    def np_random(self) -> np.random.Generator:
        """Return the generator of the episode seeds, as in Gymnasium; SuperSuit's ``frame_skip_v0`` also uses it."""
        generator = self._generators[0] or seeding.np_random()[0]
        self._generators[0] = generator
        return generator

    def checked(self, agent: str, action: Any) -> Any:
        """Convert one agent's action for the game; raises ValueError outside the space (velocities are clipped)."""
        return checked_action(self.action_spaces[agent], action, f" of {agent}")

    @shared
    def state(self) -> NDArray[np.float64]:
        """Return the state (S,) with columns ``state_names``; raises ResetNeeded before the first reset."""
        return self._states()[0]

    def _result(self) -> tuple[Observations, Infos]:
        info = self._runner.infos.of_first(self._runner.observer.allowed)
        infos = {agent: dict(info) for agent in self.possible_agents}
        if MASK in info:
            for agent, observer in self._observers().items():
                infos[agent][MASK] = observer.allowed[0].copy()
        return self._observations(first=True), infos


class _InTurn(Guarded, parallel_to_aec_wrapper):
    """Wrapper like PettingZoo's that refuses a wrong action immediately, not after the action of the last agent."""

    reset, close = exclusive(parallel_to_aec_wrapper.reset), exclusive(parallel_to_aec_wrapper.close)

    @exclusive
    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if not (self.terminations[agent] or self.truncations[agent]):
            self.env.checked(agent, action)
        super().step(action)


parallel_env = PacManBotParallelEnv


def env(*arguments: Any, **named: Any) -> AECEnv[str, Any, Any]:
    """Create :class:`PacManBotParallelEnv` as an AEC environment: ``pacman`` acts first, then the ghosts."""
    return OrderEnforcingWrapper(_InTurn(PacManBotParallelEnv(*arguments, **named)))


env.__signature__ = inspect.signature(PacManBotParallelEnv)  # type: ignore[attr-defined]
