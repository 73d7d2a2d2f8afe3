"""The class docstring of the environment is its documentation page, and tells the truth."""

from __future__ import annotations

import inspect
import re
from typing import Any

import gymnasium as gym
import numpy as np

from pacman_env.config import Config, ObservationConfig, RewardConfig, make_config
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.sim.maps.level_source import TEST_LEVEL, TEST_LEVELS
from pacman_env.sim.observation import raster
from pacman_env.sim.observation import robot_features as columns
from tests.envs.helpers import make

EVERYTHING: dict[str, Any] = {"ghosts": 3, "observation": ("features", "scan", "grid")}


def table(section: str) -> list[list[str]]:
    """Cells of the rows of the table in a section of the class docstring, headings left out."""
    text = (PacManBotEnv.__doc__ or "").split(f"## {section}")[1].split("##")[0]
    rows = [[cell.strip() for cell in line.strip(" |").split(" | ")] for line in text.splitlines() if "|" in line]
    return rows[2:]


def words(phrase: str) -> set[str]:
    return set(re.findall(r"[a-z]+", phrase.lower()))


def test_the_docstring_names_the_columns_in_their_order() -> None:
    rows = {cells[0].strip("`"): cells[1:] for cells in table("Observation Space")}
    env = make(**EVERYTHING)
    assert set(rows) == set(env.observation_space)
    assert set(make().observation_space) == {"robot", "clyde", "candidates", "round", "action_mask"}
    letters = {"C": int(env.action_space.n), "G": 3, "K": 4, "R": 360, "S": 64}
    elliptic = {"cos_heading": "cos", "cos_bearing": "cos", "cos_way": "cos", "velocity_left": "left"}
    for key, (shape, text) in rows.items():
        for letter, number in letters.items():
            shape = shape.replace(letter, str(number))
        assert shape == str(env.observation_space[key].shape), key
        if key in ("action_mask", "scan", "grid"):
            continue
        named = getattr(columns, f"{key.upper().removesuffix('S')}_COLUMNS")
        text = re.sub("^with .*: ", "", text)
        pieces = re.split(r", | and ", re.sub(r" \([^)]*\)", "", text))
        assert len(pieces) == len(named) == env.observation_space[key].shape[-1]
        for piece, (name, *_) in zip(pieces, named, strict=True):
            assert words(elliptic.get(name, name.replace("_", " "))) <= words(piece), (key, name, piece)
        units = {"m", "m/s", "rad/s", "s"}
        documented = {unit.split(",")[0] for unit in re.findall(r"\(([^)]*)\)", text)}
        assert documented == {re.split("[, ]", column[3])[0] for column in named} & units


def test_the_docstring_numbers_the_candidates_as_they_are() -> None:
    env = make(settings={"max_pellets": 15})
    count, pellets = int(env.action_space.n), 15
    observation, _ = env.reset(seed=0)
    rows = [(index, words(text)) for index, text in table("Action Space")]
    assert [index for index, _ in rows] == ["0 ... P-1", "P ... C-2", "C-1"]
    for kind, (_, text) in zip(("pellets", "refuges", "hold"), rows, strict=True):
        assert kind in text
    kinds = observation["candidates"][:, :3].argmax(axis=1).tolist()
    assert kinds == [0] * pellets + [1] * (count - 1 - pellets) + [2]
    np.testing.assert_array_equal(env.batch.assets.goal_xy[env.batch.assets.pellets], env.batch.assets.grid.home[:2])


def test_the_docstrings_numbers_are_those_of_the_configuration() -> None:
    text = re.sub(r"\s+", " ", PacManBotEnv.__doc__ or "")
    c, r, o = Config(), RewardConfig(), ObservationConfig()
    for sentence in (
        f"At every decision ({c.execution.tick_s} s)",
        f"(pymunk, {round(1 / c.physics_step_s)} Hz)",
        f"capped at {columns.FAR_M:.0f} m",
        f"{r.pellet:+.0f} for each pellet collected, {r.tick} every {c.execution.tick_s} s",
        f"{r.death:.0f} when Clyde catches",
        f"{r.completion:+.0f} when the round is complete, {r.timeout:.0f} at the time limit",
        f"at least {c.clyde.spawn_distance_m} m away",
        f"within {c.execution.death_radius_m} m of Clyde",
        f"v from 0 to {c.robot.wheel_speed_mps} m/s",
        f"omega from -{c.robot.omega_radps} to {c.robot.omega_radps} rad/s",
        f"`R = {o.scan_rays}` rays of {o.scan_minimum_m} to {o.scan_maximum_m} m with {o.scan_noise:.0%} noise".replace(
            "%", " %"
        ),
        f"`K = {o.nearest_pellets}` pellets",
        f"v is 0 at -1 and {c.robot.wheel_speed_mps} m/s at 1",
        f"omega is -{c.robot.omega_radps} rad/s at -1 and {c.robot.omega_radps} rad/s at 1",
        f"`S = {o.grid_pixels}` pixels of {o.grid_pixel_m} m",
        f"Clyde {c.clyde.speed_step_mps} m/s faster",
        f"to its corner within {c.clyde.arcade_distance_m} m",
        f"0 to {TEST_LEVEL - 1:,} to train, {TEST_LEVEL:,} to {TEST_LEVEL + TEST_LEVELS - 1:,} to test",
        f"Time limit of {c.time_limit_s:.0f} s (`time_limit_s`",
        "`outcome` (" + ", ".join(f"`{outcome}`" for outcome in OUTCOMES) + ")",
    ):
        assert sentence in text


def test_the_docstring_names_the_infos_in_their_order() -> None:
    text = (PacManBotEnv.__doc__ or "").split("## Information")[1].split("##")[0]
    documented = re.findall(r"`(\w+)`", re.sub(r"\((`speed_mps`)\)", r"\1", text))
    documented = [name for name in documented if name not in {*OUTCOMES, "randomize"}]
    plain, always = make().reset(seed=0)[1], 6
    assert documented[:always] == list(plain)
    settings = {"randomize.speed_mps": (0.2, 0.3)}
    _, info = make(map="generated", settings={**settings, "num_levels": 1, "endless": True}).reset(seed=0)
    assert documented == list(info)


def test_the_docstring_names_every_argument() -> None:
    text = (PacManBotEnv.__doc__ or "").split("## Arguments")[1].split("## ")[0]
    documented = {
        name for line in re.findall(r"^ *- (.*?):", text, re.MULTILINE) for name in re.findall(r"`(\w+)`", line)
    }
    arguments = set(inspect.signature(PacManBotEnv.__init__).parameters) - {"self"}
    assert documented == arguments
    assert "or a whole `Config`" in text


def test_the_docstrings_velocity_space_and_channels_are_those_of_the_environment() -> None:
    env = make(action="velocity", observation="grid")
    assert env.action_space.shape == (2,)
    assert env.action_space.dtype == np.float32
    assert "action_mask" not in env.observation_space
    order = [raster.WALLS, raster.PELLETS, raster.GHOSTS, raster.ROBOT]
    assert order == list(range(env.observation_space["grid"].shape[-1]))
    assert "channels walls, pellets, ghosts, robot" in (PacManBotEnv.__doc__ or "")


def test_the_docstrings_call_runs() -> None:
    call = re.search(r"```python\n(.*?)```", PacManBotEnv.__doc__ or "", re.DOTALL)
    assert call
    env = eval(call[1].strip(), {"gymnasium": gym})
    assert env.unwrapped.config == make_config(**{"clyde.speed_mps": 0.35})
