"""The pages of the ids on the site: spaces, rewards, ends, arguments and scores, from the code and its docstring."""

import dataclasses
import inspect
import re
from pathlib import Path
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
import pettingzoo
from gymnasium import spaces

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.registration import ENV_ID, IDS
from pacman_env.policies.registry import make_policy
from pacman_env.sim.maps.level_source import FixedMap
from pacman_env.sim.observation.kinds import MASK, ObservationPart
from pacman_env.sim.observation.observer import Observer
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from tools.common import as_arguments, number, table
from tools.reference import columns_of
from tools.scores import policies_of, read, scores_of

#: Sections of the class's docstring that hold for every id, in the order of the page.
_COMMON = ("Rewards", "Starting State", "Episode End", "Information", "Arguments", "Settings", "Reset")
_COMMON += ("Version History",)
_NAMES = {"planner_candidates": CANDIDATE_FEATURES, "planner_globals": GLOBAL_FEATURES}
_PLANNER = Path("pacman_env/sim/observation/planner_features.py")
_EXAMPLE = """```python
import gymnasium as gym
import pacman_env

env = gym.make("{}")
observation, info = env.reset(seed=0)
terminated = truncated = False
while not (terminated or truncated):
    action = env.action_space.sample({})
    observation, reward, terminated, truncated, info = env.step(action)
print(info)
```
"""


def file_name(env_id: str) -> str:
    return env_id.removeprefix("pacman_env/")


def sections() -> dict[str, str]:
    """Return the docstring of the environment's class by its headings, with links to pages."""

    def link(match: re.Match[str]) -> str:
        path = match[1].removeprefix("environments/")
        return f"[](../{path}.md)" if path != match[1] else f"[](../../{path}.md)"  # Sphinx writes the title

    parts = re.split(r"^## (.+)\n", inspect.getdoc(PacManBotEnv) or "", flags=re.MULTILINE)[1:]
    linked = [re.sub(r"`docs/((?:\w+/)*\w+)\.md`", link, part) for part in parts]
    return {name: body.strip() for name, body in zip(linked[::2], linked[1::2], strict=True)}


def write(env_id: str, folder: Path) -> None:
    """Write the page of an id and its picture."""
    entry, name = IDS[env_id], file_name(env_id)
    env: Any = gym.make(env_id, render_mode="rgb_array").unwrapped
    cv2.imwrite(str(folder / f"{name}.png"), cv2.cvtColor(_played(env), cv2.COLOR_RGB2BGR))
    common = sections()
    common |= {"Episode End": _end(env, common["Episode End"]), "Arguments": _arguments(env_id, common["Arguments"])}
    parts = {
        "Make it": _example(env_id),
        "Action space": _actions(env),
        "Observation space": _observations(env),
        "Reference scores": _scores(env_id),
        **({} if entry.several is None else {"Several agents": _several(env_id, entry.several)}),
        **{f"{title[:1]}{title[1:].lower()}": f"{common[title]}\n" for title in _COMMON},
    }
    text = f"# {name}\n\n**{entry.purpose[:1].upper()}{entry.purpose[1:]}.**\n\n![A round of {name}]({name}.png)\n\n"
    text += (f"{common['Description']}\n\n" if env_id == ENV_ID else "") + _summary(env_id, env)
    text += "".join(f"\n## {title}\n\n{part}" for title, part in parts.items())
    text += "\n[All ids](../ids.md), [examples for every argument](../pacmanbot.md), "
    text += "[what libraries that learn need](../../use_with/README.md)\n"
    (folder / f"{name}.md").write_text(text, encoding="utf-8")


def _played(env: PacManBotEnv) -> Any:
    """Return a picture of the first round after some decisions: of the policy nearest, or straight ahead."""
    env.reset(seed=1)
    policy = make_policy("nearest")
    policy.reset(np.ones(1, dtype=np.bool_), env.config)
    drives = env.config.action == "velocity"
    for _ in range(40 if env.config.decisions.when == "tick" else 5):
        action = np.array([0.1, 0.2]) if drives else env.action_of(policy.select(env.situation))[0]
        if any(env.step(action)[2:4]):
            break
    return env.render()


def _parts(env: PacManBotEnv) -> dict[str, ObservationPart]:
    return Observer(env.batch, dataclasses.replace(env.config.observation, flat=False)).parts


def _summary(env_id: str, env: PacManBotEnv) -> str:
    seen = f"`Box(-1, 1, {env.observation_space.shape}, float32)`"
    if isinstance(env.observation_space, spaces.Dict):
        seen = "`Dict`: " + ", ".join(f"`{key}`" for key in _parts(env))
    when = "every 0.5 s" if env.config.decisions.when == "tick" else "when there is something to decide"
    rows = [["Action space", _space(env.action_space)], ["Observation space", seen], ["A decision", when]]
    rows += [["Registered with", "Gymnasium" + (", PettingZoo" if IDS[env_id].several is not None else "")]]
    return table(("Id", f"`{env_id}`"), rows)


def _space(space: spaces.Space[Any]) -> str:
    if isinstance(space, spaces.Box):
        low, high = (", ".join(map(number, side)) for side in (space.low.tolist(), space.high.tolist()))
        return f"`Box([{low}], [{high}], float32)`"
    return f"`{space}`"


def _example(env_id: str) -> str:
    kwargs = IDS[env_id].kwargs
    mask = 'env.unwrapped.action_masks().astype("int8")' if kwargs.get("flat") else 'observation["action_mask"]'
    text = _EXAMPLE.format(env_id, "" if kwargs.get("action") == "velocity" else mask)
    return text + (f'\nIt is `gym.make("{ENV_ID}", {as_arguments(kwargs)})`.\n' if kwargs else "")


def _end(env: PacManBotEnv, text: str) -> str:
    """Return the section on ends with the end that the time limit is with this id's settings."""
    endless = ", and games are endless" if env.config.endless else ""
    return f"With this id the time limit is a **{env.config.timeout}**{endless}.\n\n{text}"


def _arguments(env_id: str, text: str) -> str:
    """Return the section on arguments with this id in its example, and the arguments that the id sets."""
    kwargs = IDS[env_id].kwargs
    text = text.replace(ENV_ID, env_id, 1)
    if "map" in kwargs:
        text = text.replace('map="house", ', "", 1)
    own = f"This id sets `{as_arguments(kwargs)}`; an argument of your own replaces the one of the same name.\n\n"
    return (own if kwargs else "") + text


def _actions(env: PacManBotEnv) -> str:
    observation = env.config.observation
    if isinstance(env.action_space, spaces.Box):
        v, omega = (number(most) for most in (env.config.robot.wheel_speed_mps, env.config.robot.omega_radps))
        first, second = "v, m/s", "omega, rad/s"
        if env.config.action_range == "unit":
            first, second = f"v = (a + 1) / 2 x {v} m/s", f"omega = a x {omega} rad/s"
        low, high = (
            list(map(number, side)) for side in (env.action_space.low.tolist(), env.action_space.high.tolist())
        )
        rows = [["0", low[0], high[0], f"{first}, forwards"], ["1", low[1], high[1], f"{second}, counter-clockwise"]]
        text = table(("Index", "Low", "High", "Unit, meaning"), rows)
        return f"{text}\nHeld for one decision of 0.5 s. There is no mask.\n"
    pellets, last = env.batch.pellet_slots, env.batch.candidates - 1
    kinds = ["the pellets of the map by number", "the refuges: home, spread-out places, nooks"]
    if observation.candidates == "nearest":
        pellets, last = observation.nearest_pellets, observation.nearest_pellets + observation.nearest_refuges
        kinds = ["the nearest pellets by path length, the nearest first", "the nearest refuges, the nearest first"]
    rows = [[_range(0, pellets), kinds[0]], [_range(pellets, last), kinds[1]], [str(last), "hold: stop and stay"]]
    where = f'`observation["{MASK}"]` and `action_masks()` tell'
    if observation.mask == "method":
        where = "`action_masks()` tells"
    house = observation.candidates == "all" and isinstance(env.batch.source, FixedMap)
    text = table(("Action on the map `house`" if house else "Action", "Candidate"), rows)
    return f"{text}\n{where} which are allowed; any other makes the robot hold.\n"


def _range(first: int, end: int) -> str:
    return f"{first} to {end - 1}" if end - first > 1 else str(first)


def _observations(env: PacManBotEnv) -> str:
    config, parts = env.config.observation, _parts(env)
    rows, first = [], 0
    for key, part in parts.items():
        low, high = np.unique(part.low), np.unique(part.high)
        values = f"{number(low[0])} to {number(high[0])}" if len(low) == len(high) == 1 else "see below"
        end = first + int(np.prod(part.shape))
        place = [_range(first, end)] if config.flat else []
        rows.append([*place, f"`{key}`", f"{part.shape}", np.dtype(part.dtype).name, values])
        first = end
    text = table((*(("Numbers", "Part") if config.flat else ("Key",)), "Shape", "dtype", "Values"), rows)
    if config.flat:
        text += "\nThe parts one after the other, each row by row, are one array of float32."
    if config.normalize and any(part.columns for part in parts.values()):
        text += " Numbers are scaled to -1 to 1; the units below are those before."
    text += "\n" if config.flat or config.normalize else ""
    for key, part in parts.items():
        if part.columns:
            text += columns_of(key, part)
        elif key in _NAMES:
            names = ", ".join(f"{k}\N{NO-BREAK SPACE}`{name}`" for k, name in enumerate(_NAMES[key]))
            scaled = ", divided by 5" if config.normalize else ""
            text += f"\n### `{key}`\n\nA planner's numbers{scaled}, without units: {names}. They are computed by "
            text += f"[{_PLANNER.name}](../../../{_PLANNER}).\n"
    return text


def _scores(env_id: str) -> str:
    known = read()
    episodes = known[env_id]["random"]["episodes"]
    text = f"{scores_of(env_id, known)}\n{episodes} episodes, seeds 0 to {episodes - 1}; "
    text += f"`python -m tools.scores {env_id}` plays them again.\n"
    if len(policies_of(env_id)) == 1:
        text += "`random` draws from the action space; the other policies of the package choose goals.\n"
    return text


def _several(env_id: str, kwargs: dict[str, Any]) -> str:
    env = pettingzoo.make("parallel", env_id)
    rows = []
    for agent in env.possible_agents:
        space = env.observation_space(agent)
        keys = space.items() if isinstance(space, spaces.Dict) else ()
        shapes = ", ".join(f"`{key}` {one.shape}" for key, one in keys)
        rows.append([f"`{agent}`", _space(env.action_space(agent)), shapes])
    text = f'In PettingZoo: `pettingzoo.make("parallel", "{env_id}")`, or `"aec"`'
    text += f"; it is `pacman_env.parallel_env({as_arguments(kwargs)})`.\n\n"
    text += table(("Agent", "Action space", "Observation"), rows)
    return text + "\nRewards, turns and the state of the whole game: [two players and more](../pettingzoo.md).\n"
