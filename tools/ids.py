"""Write the site's pages of the ids with ``ids.md.j2``: spaces, rewards, ends, arguments and scores, from the code."""

import dataclasses
import inspect
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import gymnasium as gym
import jinja2
import numpy as np
import pettingzoo
from gymnasium import spaces

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.registration import ENV_ID, IDS
from pacman_env.evaluation.replay import save_video
from pacman_env.policies.registry import make_policy
from pacman_env.render.frames import render_frame
from pacman_env.sim.maps.level_source import FixedMap
from pacman_env.sim.observation.observer import Observer
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from tools.common import as_arguments, number, table
from tools.reference import columns_of
from tools.scores import read, scores_of

_TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=jinja2.StrictUndefined,
)
_TEMPLATES.filters["code"] = "`{}`".format


def _space(space: spaces.Space[Any]) -> str:
    if isinstance(space, spaces.Box):
        low, high = (", ".join(map(number, side)) for side in (space.low.tolist(), space.high.tolist()))
        return f"`Box([{low}], [{high}], float32)`"
    return f"`{space}`"


def span(first: int, end: int) -> str:
    return f"{first} to {end - 1}" if end - first > 1 else str(first)


_TEMPLATES.globals.update(table=table, number=number, as_arguments=as_arguments, columns_of=columns_of)
_TEMPLATES.globals.update(space=_space, span=span)


def file_name(env_id: str) -> str:
    return env_id.removeprefix("pacman_env/")


def sections(env_id: str) -> dict[str, str]:
    """Return the sections of the environment's docstring by heading, adapted to an id, with links to pages."""

    def link(match: re.Match[str]) -> str:
        path = match[1].removeprefix("environments/")
        return f"[](../{path}.md)" if path != match[1] else f"[](../../{path}.md)"  # Sphinx writes the title

    parts = re.split(r"^## (.+)\n", inspect.getdoc(PacManBotEnv) or "", flags=re.MULTILINE)[1:]
    linked = [re.sub(r"`docs/((?:\w+/)*\w+)\.md`", link, part).strip() for part in parts]
    texts = dict(zip(linked[::2], linked[1::2], strict=True))
    example = texts["Arguments"].replace(ENV_ID, env_id, 1)
    texts["Arguments"] = example.replace('map="house", ', "", 1) if "map" in IDS[env_id].kwargs else example
    return texts


def page(env_id: str, env: Any) -> str:
    """Return the page of an id; ``env`` is an environment of this id."""
    config, entry, scores = env.config.observation, IDS[env_id], read()
    parts = Observer(env.batch, dataclasses.replace(config, flat=False)).parts
    observed, first = [], 0
    for key, part in parts.items():
        low, high = np.unique(part.low), np.unique(part.high)
        values = f"{number(low[0])} to {number(high[0])}" if len(low) == len(high) == 1 else "see below"
        end = first + int(np.prod(part.shape))
        place = [span(first, end)] if config.flat else []
        observed.append([*place, f"`{key}`", f"{part.shape}", np.dtype(part.dtype).name, values])
        first = end
    shown = {
        "name": file_name(env_id),
        "plain_id": ENV_ID,
        "drives": isinstance(env.action_space, spaces.Box),
        "fixed": isinstance(env.batch.source, FixedMap),
        "scores": scores_of(env_id, scores),
        "episodes": scores[env_id]["random"]["episodes"],
        "agents": [] if entry.several is None else _agents(env_id),
        "common": sections(env_id),
        "planner": {"planner_candidates": CANDIDATE_FEATURES, "planner_globals": GLOBAL_FEATURES},
    }
    shown |= {"env_id": env_id, "env": env, "entry": entry, "config": config, "parts": parts, "observed": observed}
    return _TEMPLATES.get_template("ids.md.j2").render(shown)


def _agents(env_id: str) -> list[list[str]]:
    env, rows = pettingzoo.make("parallel", env_id), []
    for agent in env.possible_agents:
        seen = env.observation_space(agent)
        keys = seen.items() if isinstance(seen, spaces.Dict) else ()
        shapes = ", ".join(f"`{key}` {one.shape}" for key, one in keys)
        rows.append([f"`{agent}`", _space(env.action_space(agent)), shapes])
    return rows


def pictures(env: Any) -> Iterator[Any]:
    """Yield pictures of the first round: after each decision of ``nearest``, or while driving a curve."""
    env.reset(seed=1)
    policy = make_policy("nearest")
    policy.reset(np.ones(1, dtype=np.bool_), env.config)
    drives = env.config.action == "velocity"
    for _ in range(48 if env.config.decisions.when == "tick" else 20):
        yield render_frame(env.batch, 0, height=360)
        action = np.array([0.1, 0.2]) if drives else env.action_of(policy.select(env.situation))[0]
        if any(env.step(action)[2:4]):
            break
    yield render_frame(env.batch, 0, height=360)


def write(env_id: str, folder: Path) -> None:
    """Write the page of an id and a film of it."""
    env: Any = gym.make(env_id).unwrapped
    name, between_s = file_name(env_id), 1.0 if env.config.decisions.when == "tick" else 4.0
    save_video(islice(pictures(env), 0, None, 2), folder / f"{name}.gif", between_s)
    (folder / f"{name}.md").write_text(page(env_id, env), encoding="utf-8")
