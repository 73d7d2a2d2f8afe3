"""A page for each registered id: what it is, spaces, rewards, ends, arguments, reference scores, its picture."""

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
from tools.common import table
from tools.reference import as_arguments, number
from tools.scores import policies_of, read, scores_of

#: Sections of the class's docstring that hold for every id, in the order of the page.
_COMMON = (
    "Rewards",
    "Starting State",
    "Episode End",
    "Information",
    "Arguments",
    "Settings",
    "Reset",
    "Version History",
)
_BEFORE_THE_PICTURE = 40  # decisions
_NAMES = {"planner_candidates": CANDIDATE_FEATURES, "planner_globals": GLOBAL_FEATURES}
_PLANNER = Path("pacman_env/sim/observation/planner_features.py")
_UNIT = "-1 to 1"


def file_name(env_id: str) -> str:
    return env_id.removeprefix("pacman_env/")


def sections() -> dict[str, str]:
    """The docstring of the environment's class by its headings; paths of pages are links."""
    text = inspect.getdoc(PacManBotEnv) or ""
    parts = re.split(r"^## (.+)\n", text, flags=re.MULTILINE)[1:]
    linked = [re.sub(r"`docs/((?:\w+/)*\w+)\.md`", _link, part) for part in parts]
    return {name: body.strip() for name, body in zip(linked[::2], linked[1::2], strict=True)}


def _link(match: re.Match[str]) -> str:
    path = match[1].removeprefix("environments/")
    return f"[](../{path}.md)" if path != match[1] else f"[](../../{path}.md)"  # Sphinx writes the title


def page(env_id: str, pictures: Path) -> str:
    entry = IDS[env_id]
    env: Any = gym.make(env_id, render_mode="rgb_array").unwrapped
    picture = pictures / f"{file_name(env_id)}.png"
    cv2.imwrite(str(picture), cv2.cvtColor(_played(env), cv2.COLOR_RGB2BGR))
    common = sections()
    common |= {"Episode End": _end(env, common["Episode End"]), "Arguments": _arguments(env_id, common["Arguments"])}
    text = f"# {file_name(env_id)}\n\n**{entry.purpose[:1].upper()}{entry.purpose[1:]}.**\n\n"
    text += f"![A round of {file_name(env_id)}]({picture.name})\n\n"
    if env_id == ENV_ID:
        text += f"{common['Description']}\n\n"
    text += _summary(env_id, env) + "\n## Make it\n\n" + _example(env_id, entry.kwargs)
    text += "\n## Action space\n\n" + _actions(env) + "\n## Observation space\n\n" + _observations(env)
    text += "\n## Reference scores\n\n" + _scores(env_id)
    if entry.several is not None:
        text += "\n## Several agents\n\n" + _several(env_id, entry.several)
    for name in _COMMON:
        title = name[:1] + name[1:].lower()
        text += f"\n## {title}\n\n{common[name]}\n"
    text += "\n[All ids](../ids.md), [examples for every argument](../pacmanbot.md), "
    return text + "[what libraries that learn need](../../use_with/README.md)\n"


def _played(env: PacManBotEnv) -> Any:
    """A picture of the first round after some decisions: of the policy nearest, or straight ahead."""
    env.reset(seed=1)
    policy = make_policy("nearest")
    policy.reset(np.ones(1, dtype=np.bool_), env.config)
    drives = env.config.action == "velocity"
    for _ in range(_BEFORE_THE_PICTURE if env.config.decisions.when == "tick" else 5):
        action = np.array([0.1, 0.2]) if drives else env.action_of(policy.select(env.situation))[0]
        if any(env.step(action)[2:4]):
            break
    return env.render()


def _summary(env_id: str, env: PacManBotEnv) -> str:
    unflat = Observer(env.batch, dataclasses.replace(env.config.observation, flat=False)).parts
    seen = f"`Box({_UNIT.replace(' to ', ', ')}, {env.observation_space.shape}, float32)`"
    if isinstance(env.observation_space, spaces.Dict):
        seen = "`Dict`: " + ", ".join(f"`{key}`" for key in unflat)
    known = "Gymnasium" + (", PettingZoo" if IDS[env_id].several is not None else "")
    return table(
        ("Id", f"`{env_id}`"),
        [
            ["Action space", _space(env.action_space)],
            ["Observation space", seen],
            [
                "A decision",
                "every 0.5 s" if env.config.decisions.when == "tick" else "when there is something to decide",
            ],
            ["Registered with", known],
        ],
    )


def _space(space: spaces.Space[Any]) -> str:
    if isinstance(space, spaces.Box):
        low, high = (", ".join(map(number, side)) for side in (space.low.tolist(), space.high.tolist()))
        return f"`Box([{low}], [{high}], float32)`"
    return f"`{space}`"


def _example(env_id: str, kwargs: dict[str, Any]) -> str:
    flat = bool(kwargs.get("flat"))
    drives = kwargs.get("action") == "velocity"
    mask = "" if drives else ('env.unwrapped.action_masks().astype("int8")' if flat else 'observation["action_mask"]')
    text = f"""```python
import gymnasium as gym
import pacman_env

env = gym.make("{env_id}")
observation, info = env.reset(seed=0)
terminated = truncated = False
while not (terminated or truncated):
    action = env.action_space.sample({mask})
    observation, reward, terminated, truncated, info = env.step(action)
print(info)
```
"""
    if kwargs:
        text += f'\nIt is `gym.make("{ENV_ID}", {as_arguments(kwargs)})`.\n'
    return text


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
    if isinstance(env.action_space, spaces.Box):
        unit = env.config.action_range == "unit"
        v, omega = env.config.robot.wheel_speed_mps, env.config.robot.omega_radps
        first = f"v = (a + 1) / 2 x {number(v)} m/s" if unit else "v, m/s"
        second = f"omega = a x {number(omega)} rad/s" if unit else "omega, rad/s"
        means = (f"{first}, forwards", f"{second}, counter-clockwise")
        sides = zip(env.action_space.low.tolist(), env.action_space.high.tolist(), means, strict=True)
        rows = [[str(k), number(low), number(high), meaning] for k, (low, high, meaning) in enumerate(sides)]
        text = table(("Index", "Low", "High", "Unit, meaning"), rows)
        return f"{text}\nHeld for one decision of 0.5 s. There is no mask.\n"
    pellets, refuges = env.batch.pellet_slots, env.batch.candidates - env.batch.pellet_slots - 1
    if env.config.observation.candidates == "nearest":
        pellets, refuges = env.config.observation.nearest_pellets, env.config.observation.nearest_refuges
        kinds = ("the nearest pellets by path length, the nearest first", "the nearest refuges, the nearest first")
    else:
        kinds = ("the pellets of the map by number", "the refuges: home, spread-out places, nooks")
    last = pellets + refuges
    rows = [[_range(0, pellets), kinds[0]], [_range(pellets, last), kinds[1]], [str(last), "hold: stop and stay"]]
    at_hand = env.config.observation.mask == "method"
    where = "`action_masks()` tells" if at_hand else f'`observation["{MASK}"]` and `action_masks()` tell'
    house = env.config.observation.candidates == "all" and isinstance(env.batch.source, FixedMap)
    text = table(("Action on the map `house`" if house else "Action", "Candidate"), rows)
    return f"{text}\n{where} which are allowed; any other makes the robot hold.\n"


def _range(first: int, end: int) -> str:
    return f"{first} to {end - 1}" if end - first > 1 else str(first)


def _observations(env: PacManBotEnv) -> str:
    config = env.config.observation
    parts = Observer(env.batch, dataclasses.replace(config, flat=False)).parts
    rows, first = [], 0
    for key, part in parts.items():
        size = int(np.prod(part.shape))
        place = [_range(first, first + size)] if config.flat else []
        rows.append([*place, f"`{key}`", f"{part.shape}", np.dtype(part.dtype).name, _values(part)])
        first += size
    head = ("Key", "Shape", "dtype", "Values")
    text = table(("Numbers", "Part", *head[1:]) if config.flat else head, rows)
    if config.flat:
        text += "\nThe parts one after the other, each row by row, are one array of float32."
    if config.normalize and any(part.columns for part in parts.values()):
        text += " Numbers are scaled to -1 to 1; the units below are those before."
    text += "\n" if config.flat or config.normalize else ""
    for key, part in parts.items():
        if part.columns:
            columns = [_column(k, column, config.normalize, part) for k, column in enumerate(part.columns)]
            text += f"\n### `{key}`\n\n" + table(("Column", "Name", "Low", "High", "Unit, meaning"), columns)
        elif key in _NAMES:
            names = ", ".join(f"{k}\N{NO-BREAK SPACE}`{name}`" for k, name in enumerate(_NAMES[key]))
            scaled = ", divided by 5" if config.normalize else ""
            text += f"\n### `{key}`\n\nA planner's numbers{scaled}, without units: {names}. They are computed by "
            text += f"[{_PLANNER.name}](../../../{_PLANNER}).\n"
    return text


def _values(part: ObservationPart) -> str:
    low, high = np.unique(part.low), np.unique(part.high)
    return f"{number(low[0])} to {number(high[0])}" if len(low) == len(high) == 1 else "see below"


def _column(k: int, column: tuple[str, float, float, str], scaled: bool, part: ObservationPart) -> list[str]:
    name, _, _, unit = column
    meaning = unit or "no unit"
    if scaled:
        return [str(k), f"`{name}`", "-1", "1", meaning]
    low, high = (np.asarray(bound).reshape(-1, part.shape[-1])[0] for bound in (part.low, part.high))
    return [str(k), f"`{name}`", number(low[k]), number(high[k]), meaning]


def _scores(env_id: str) -> str:
    known = read()
    one = known[env_id][policies_of(env_id)[0]]
    text = scores_of(env_id, known)
    text += f"\n{one['episodes']} episodes, seeds 0 to {one['episodes'] - 1}; "
    text += f"`python -m tools.scores {env_id}` plays them again.\n"
    if len(policies_of(env_id)) == 1:
        text += "`random` draws from the action space; the other policies of the package name goals.\n"
    return text


def _several(env_id: str, kwargs: dict[str, Any]) -> str:
    env = pettingzoo.make("parallel", env_id)
    rows = []
    for agent in env.possible_agents:
        space = env.observation_space(agent)
        shapes = (
            ", ".join(f"`{key}` {one.shape}" for key, one in space.items()) if isinstance(space, spaces.Dict) else ""
        )
        rows.append([f"`{agent}`", _space(env.action_space(agent)), shapes])
    text = f'In PettingZoo: `pettingzoo.make("parallel", "{env_id}")`, or `"aec"`'
    text += f"; it is `pacman_env.parallel_env({as_arguments(kwargs)})`.\n\n"
    text += table(("Agent", "Action space", "Observation"), rows)
    return text + "\nRewards, turns and the state of the whole game: [two players and more](../pettingzoo.md).\n"
