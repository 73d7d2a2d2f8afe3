"""Write the pages of the ids with ``ids.md.j2`` from the code that they describe: ``python -m tools.ids``."""

import dataclasses
import inspect
import math
import operator
import re
import sys
from collections.abc import Iterator
from enum import IntEnum
from itertools import islice
from pathlib import Path
from typing import Any

import gymnasium as gym
import jinja2
import numpy as np
import pettingzoo
from gymnasium import spaces

from pacman_env.command_line.command import Parser, run_command
from pacman_env.config import Config
from pacman_env.config.described import description_of
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.registration import ENV_ID, FLAT_ID, IDS
from pacman_env.game.behaviour_belief import BELIEVED, OTHER
from pacman_env.levels.level_source import FixedMap
from pacman_env.observations.kinds import ObservationPart
from pacman_env.observations.observer import Observer
from pacman_env.observations.planner_columns import GHOST_TOKENS, CandidateColumn, GlobalColumn, TokenColumn
from pacman_env.render.frames import render_frame
from pacman_env.render.palette import THEMES, Theme
from tools.common import ROOT, SUFFIXES, add_check, as_arguments, literal, number, save_film, table, update
from tools.figures import store
from tools.figures.views import VIEWS
from tools.gallery import moments
from tools.reference import columns_of
from tools.scores import figure_of, read, scores_of

PAGES = ROOT / "docs" / "environments" / "ids"
_COLUMN = re.compile(r"^    ([A-Z_]+) = .*?  # (.+)$", re.MULTILINE)
_SETTINGS = (
    "clyde.speed_mps", "clyde.spawn_distance_m", "robot.speed_mps", "time_limit_s", "max_pellets", "endless", "timeout",
    "decisions.when", "decisions.longest_s", "execution.rules", "observation.candidates", "observation.normalize",
    "observation.mask", "observation.numeric_info", "reward.death", "reward.progress", "power.pellets",
    "localization.perfect", "randomize.speed_mps", "randomize.clyde_speed_mps", "num_levels",
)  # fmt: skip
_EVENTS = {  # shorter than the descriptions of other rewards
    "pellet": "a pellet is collected",
    "completion": "every pellet is collected",
    "death": "a ghost catches the robot",
    "timeout": "time limit",
    "tick": "every 0.5 s",
    "ghost_caught": "a frightened ghost is caught",
    "power": "a power pellet, in addition to the pellet",
    "progress": "each metre by which the path to the nearest pellet became shorter",
}
_LOADER, _STRICT = jinja2.FileSystemLoader(Path(__file__).parent), jinja2.StrictUndefined
_TEMPLATES = jinja2.Environment(loader=_LOADER, undefined=_STRICT, trim_blocks=True, lstrip_blocks=True)
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
        title = (ROOT / "docs" / f"{match[1]}.md").read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        return f"[{title}](../{path}.md)" if path != match[1] else f"[{title}](../../{path}.md)"

    parts = re.split(r"^## (.+)\n", inspect.getdoc(PacManBotEnv) or "", flags=re.MULTILINE)[1:]
    linked = [re.sub(r"`docs/((?:\w+/)*\w+)\.md`", link, part).strip() for part in parts]
    texts = dict(zip(linked[::2], linked[1::2], strict=True))
    example = texts["Arguments"].replace(ENV_ID, env_id, 1)
    texts["Arguments"] = example.replace('map="house", ', "", 1) if "map" in IDS[env_id].kwargs else example
    return texts


def page(env_id: str, env: Any) -> str:
    """Return the page of an id; ``env`` is an environment of this id."""
    records = store.read()
    config, entry, scores = env.config.observation, IDS[env_id], read(records)
    parts, observed, first = _parts(env), list[list[str]](), 0
    for key, part in parts.items():
        low, high = np.unique(part.low), np.unique(part.high)
        values = f"{number(low[0])} to {number(high[0])}" if len(low) == len(high) == 1 else "see below"
        end = first + int(np.prod(part.shape))
        place = [span(first, end)] if config.flat else []
        observed.append([*place, f"`{key}`", f"{part.shape}", np.dtype(part.dtype).name, values])
        first = end
    drives, info = isinstance(env.action_space, spaces.Box), env.reset(seed=0)[1]
    base = FLAT_ID if config.flat and not drives else ENV_ID
    variant = env_id != base
    shown_there = _parts(gym.make(base).unwrapped) if variant else {}
    shown = {
        "name": file_name(env_id),
        "plain_id": ENV_ID,
        "base": file_name(base),
        "variant": variant,
        "described": {key: part for key, part in parts.items() if key not in shown_there},
        "drives": drives,
        "fixed": isinstance(env.batch.source, FixedMap),
        "highest": _highest(env, info),
        "rewards": list(_rewards(env.config)),
        "settings": list(_settings(env.config)),
        "first_info": "".join(f'    "{key}": {literal(value)},\n' for key, value in info.items()),
        "figure": figure_of(env_id),
        "stamp": VIEWS["stamp"](figure_of(env_id), records, ()),
        "scores": scores_of(env_id, scores),
        "solvers": [f"`{name}`" for name, one in scores[env_id].items() if one["return"] >= (entry.solved or math.inf)],
        "episodes": scores[env_id]["random"]["episodes"],
        "agents": [] if entry.several is None else _agents(env_id),
        "common": sections(env_id),
        "planner": {"planner_candidates": _columns(CandidateColumn), "planner_globals": _global_columns()},
    }
    shown |= {"env_id": env_id, "env": env, "entry": entry, "config": config, "parts": parts, "observed": observed}
    text = _TEMPLATES.get_template("ids.md.j2").render(shown)
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def _parts(env: Any) -> dict[str, ObservationPart]:
    return Observer(env.batch, dataclasses.replace(env.config.observation, flat=False)).parts


def _highest(env: Any, first: dict[str, Any]) -> str:
    reward = env.config.reward
    if env.config.endless:
        return "no limit"
    if not isinstance(env.batch.source, FixedMap):
        return f"the number of pellets + {number(reward.completion)}, minus time"
    most = number(first["spawned"] * reward.pellet + reward.completion)
    return f"{most}, minus time" + (", plus ghosts caught" if env.config.power.pellets else "")


def _rewards(config: Config) -> Iterator[list[str]]:
    for name in dict.fromkeys([*_EVENTS, *(field.name for field in dataclasses.fields(config.reward))]):
        value = getattr(config.reward, name)
        if config.power.pellets if name in ("ghost_caught", "power") else value:
            yield [_EVENTS.get(name) or description_of(config.reward, name), f"{value:+g}", f"`reward.{name}`"]


def _settings(config: Config) -> Iterator[tuple[str, str, str]]:
    """Yield the name, the value and the description of each setting that is shown."""
    for name in _SETTINGS:
        group, _, leaf = name.rpartition(".")
        owner = operator.attrgetter(group)(config) if group else config
        yield name, literal(getattr(owner, leaf)), description_of(owner, leaf)


def _columns(kind: type[IntEnum], first: int = 0, prefix: str = "") -> list[list[str]]:
    """Return number, name and meaning of each column; the comments of the source are the meanings."""
    named = zip(kind, _COLUMN.findall(inspect.getsource(kind)), strict=True)
    return [[str(first + column), f"`{prefix}{column.name.lower()}`", text] for column, (_, text) in named]


def _global_columns() -> list[list[str]]:
    rows = _columns(GlobalColumn)
    for k in range(GHOST_TOKENS):
        rows += _columns(TokenColumn, len(rows), f"ghost_{k}_")
        for name in BELIEVED[1:]:
            what = "any other behaviour" if name == BELIEVED[OTHER] else f"the behaviour `{name}`"
            rows.append([str(len(rows)), f"`ghost_{k}_{name}`", f"probability of {what}"])
    return rows


def _agents(env_id: str) -> list[list[str]]:
    env, rows = pettingzoo.make("parallel", env_id), []
    for agent in env.possible_agents:
        seen = env.observation_space(agent)
        keys = seen.items() if isinstance(seen, spaces.Dict) else ()
        shapes = ", ".join(f"`{key}` {one.shape}" for key, one in keys)
        rows.append([f"`{agent}`", _space(env.action_space(agent)), shapes])
    return rows


def write(env_id: str, folder: Path) -> None:
    """Write a light and a dark film of an id, and show them on the page, which the folder contains."""
    env: Any = gym.make(env_id).unwrapped
    name = file_name(env_id)
    decisions, frame_ms = (48, 250) if env.config.decisions.when == "tick" else (20, 1000)
    films: dict[Theme, list[Any]] = {theme: [] for theme in THEMES}
    for _ in islice(moments(env, 1, "nearest"), 0, decisions + 1, 2):
        for theme, frames in films.items():
            frames.append(render_frame(env.batch, 0, height=360, theme=theme))
    for theme, frames in films.items():
        save_film(frames, folder / f"{name}{SUFFIXES[theme]}.webp", frame_ms, frame_ms + 1500)
    file, film = folder / f"{name}.md", f"![The beginning of a round of {name}, animated]({name}.webp)"
    page_text = re.sub(r"!\[.*?\]\(.*?\)", film, file.read_text(encoding="utf-8"), count=1)
    file.write_text(page_text, encoding="utf-8")


def write_pages(check: bool) -> int:
    pages = {PAGES / f"{file_name(env_id)}.md": page(env_id, gym.make(env_id).unwrapped) for env_id in IDS}
    complaint = "is out of date: python -m tools.ids"
    return max(update(file, text, check, complaint) for file, text in pages.items())


if __name__ == "__main__":
    parser = Parser(prog="python -m tools.ids", description="Write docs/environments/ids.")
    add_check(parser)
    sys.exit(run_command(parser, None, lambda given: write_pages(given.check)))
