"""SuperSuit: the two-player game as one vector environment of all agents, stacked and padded.

The game is the two-player PacManBotFlat-v2, where every agent has one array; ``observation.mask=info`` leaves the mask
out of it, so that ``frame_stack``, ``pad_observations`` and all other wrappers for arrays take it.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import pettingzoo
import supersuit

import pacman_env  # noqa: F401 - registers the environments

GAMES = 2
ENV_ID = "pacman_env/PacManBotFlat-v2"


def vectorized(game: Any, processes: int = 0) -> Any:
    """Return vectorized games with one agent per row."""
    return supersuit.concat_vec_envs_v1(supersuit.pettingzoo_env_to_vec_env_v1(game), GAMES, num_cpus=processes)


def play(envs: Any, steps: int, seed: int, given: list[np.ndarray] | None = None) -> list[tuple[Any, ...]]:
    """Actions, and all that is returned, of each step; without ``given`` allowed ones at random, by the infos."""
    rng = np.random.default_rng(seed)
    observation, infos = envs.reset(seed=seed)
    played: list[tuple[Any, ...]] = [(None, observation, infos)]
    for k in range(steps):
        if given is None:
            actions = np.array([rng.choice(np.flatnonzero(info["action_mask"])) for info in played[-1][-1]])
        else:
            actions = given[k]
        played.append((actions, *envs.step(actions)))
        assert envs.observation_space.contains(played[-1][1][0])
    envs.close()
    return played


def main() -> None:
    """Check each wrapper, and compare the vector environment with single games."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--map", default="house")
    options.add_argument("--decisions", type=int, default=2000, help="of all agents, with all wrappers")
    options.add_argument("--seed", type=int, default=0)
    arguments = options.parse_args()

    def game(**named: Any) -> Any:
        settings = {"observation.mask": "info", "max_cycles": 30}
        return pettingzoo.make("parallel", ENV_ID, map=arguments.map, **{"settings": settings, **named})

    made = {
        "one process": lambda: vectorized(game()),
        "frame_stack_v1": lambda: vectorized(supersuit.frame_stack_v1(game(), 4)),
        "pad_observations_v0": lambda: vectorized(supersuit.pad_observations_v0(game(observation=("scan", "flat")))),
        "agent_indicator_v0": lambda: vectorized(supersuit.agent_indicator_v0(game())),
        "clip_reward_v0": lambda: vectorized(supersuit.clip_reward_v0(game(), -1, 1)),
        "frame_skip_v0": lambda: vectorized(supersuit.frame_skip_v0(game(), (2, 4))),
        "sticky_actions_v0": lambda: vectorized(supersuit.sticky_actions_v0(game(), 0.25)),
    }
    steps = max(arguments.decisions // (2 * GAMES * len(made)), 40)  # an episode ends in them
    played = {}
    for name, make in made.items():
        played[name] = play(make(), steps, arguments.seed)
        print(f"{name}: {steps} steps, observations {played[name][-1][1].shape}")

    first = played["one process"][1:]
    # With several processes the infos of a reset are SuperSuit's own compressed ones: the same actions again.
    second = play(vectorized(game(), 2), steps, arguments.seed, [actions for actions, *_ in first])[1:]
    for here, there in zip(first, second, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(here[:-1], there[:-1], strict=True))
    alone, episodes = game(), 1
    alone.reset(seed=arguments.seed)
    for actions, observation, rewards, *_ in first:
        seen, earned, *_ = alone.step(dict(zip(alone.agents, actions, strict=False)))
        if not alone.agents:
            seen, _ = alone.reset()
            episodes += 1
        for row, agent in enumerate(alone.agents):
            assert np.array_equal(observation[row], seen[agent])
            assert rewards[row] == np.float32(earned[agent])
    print(f"the first game is the game alone, and the same in a process of its own: {steps} steps, {episodes} episodes")


if __name__ == "__main__":
    main()
