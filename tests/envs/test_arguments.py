"""The typed arguments of the environments: what says the same, and what is refused with its name."""

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.envs.parallel_vec_env import parallel_vec_env
from pacman_env.envs.pettingzoo_env import env, parallel_env
from pacman_env.world.maps.occupancy import MapError, shipped_maps
from tests.envs.helpers import make, same

REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"observation": "pictures"}, r"observation = 'pictures'.*features.*scan.*grid"),
    ({"observation": ()}, r"observation = \(\)"),
    ({"observation": ("scan", 3)}, r"observation = \('scan', 3\)"),
    ({"observation": 5}, "observation = 5"),
    ({"action": "fly"}, r"action = 'fly'.*goal.*velocity"),
    ({"settings": {"action_range": "unit"}}, "action_range = 'unit': must be physical if actions are goals"),
    ({"action": "velocity", "settings": {"action_range": "metric"}}, r"action_range = 'metric'.*physical.*unit"),
    (
        {"action": "velocity", "settings": {"observation.mask": "info"}},
        "observation.mask = 'info': velocities have no mask",
    ),
    (
        {"action": "velocity", "settings": {"observation.mask": "beside"}},
        "observation.mask = 'beside': velocities have no mask",
    ),
    (
        {"action": "velocity", "settings": {"observation.candidates": "nearest"}},
        "observation.candidates = 'nearest': velocities choose no",
    ),
    ({"ghosts": 0}, "ghosts = 0.*1 to 4"),
    ({"ghosts": 5}, "ghosts = 5.*1 to 4"),
    ({"ghosts": True}, "ghosts = True"),
    ({"ghosts": ("wander", 3)}, r"ghosts\[1\] = 3"),
    ({"ghosts": ()}, r"ghosts = \(\).*one to four"),
    ({"ghosts": "policy"}, r"ghosts\[0\] = 'policy'"),
    ({"settings": {"num_levels": 3}}, "num_levels are for map='generated'"),
    ({"map": "generated", "settings": {"home": (0.0, 0.0, 0.0)}}, "home: generated"),
    ({"map": "generated", "settings": {"num_levels": 2.5}}, r"num_levels = 2\.5"),
    ({"settings": Config(), "observation": "scan"}, "settings is a Config"),
    ({"settings": Config(), "flat": True}, "settings is a Config"),
    ({"flat": 1}, "flat = 1: must be True or False"),
    ({"settings": [1]}, r"settings = \[1\]"),
    ({"action": "goal", "settings": {"action": "velocity"}}, "action is given twice"),
    ({"settings": {"randomize.speed_mps": (0.2, 5.0)}}, r"randomize\.speed_mps = .*wheel_speed_mps"),
    ({"map": 3}, "map = 3: must be a name"),
    ({"preset": ["robot"]}, r"unknown preset \['robot'\]"),
    ({"settings": {"execution.rules": {}}}, r"execution.rules = {}: Expected `str`"),
    ({"map": "nowhere"}, f"nowhere.*{', '.join(shipped_maps())}"),
    ({"defaults": 3}, "^defaults = 3: must be values by the dotted names of fields$"),
    ({"defaults": {"endles": True}}, "endles"),
    ({"defaults": {"endless": True}, "settings": Config()}, "settings is a Config: .* and defaults are part of it"),
    ({"flat": True, "observation": ("flat", "grid")}, "'grid'"),
    ({"flat": True, "action": "velocity", "settings": {"decisions.when": "tick"}}, "velocities choose no candidate"),
]


@pytest.mark.parametrize("build", [PacManBotEnv, partial(PacManBotVectorEnv, 2)])
@pytest.mark.parametrize(("chosen", "message"), REFUSED)
def test_unplayable_argument_names_the_field(chosen: dict[str, Any], message: str, build: Callable[..., Any]) -> None:
    with pytest.raises((ConfigError, MapError), match=message):
        build(**chosen)


@pytest.mark.parametrize(
    ("build", "chosen", "message"),
    [
        (PacManBotEnv, {"render_mode": "ansi"}, r"'ansi'.*rgb_array.*human"),
        (parallel_env, {"render_mode": "ansi"}, r"'ansi'.*rgb_array.*human"),
        (PacManBotVectorEnv, {"render_mode": "human"}, r"'human'.*rgb_array"),
        (PacManBotVectorEnv, {"num_envs": 0}, "num_envs = 0"),
        (PacManBotVectorEnv, {"max_episode_steps": 0}, "max_episode_steps = 0: must be a whole number of at least 1"),
        (PacManBotVectorEnv, {"max_episode_steps": True}, "max_episode_steps = True"),
        (parallel_vec_env, {"render_mode": "human"}, "render_mode = 'human'"),
        (parallel_vec_env, {"num_envs": 0}, "num_envs = 0: must be a whole number of at least 1"),
        (parallel_vec_env, {"autoreset_mode": "no"}, "'no' is not a valid AutoresetMode"),
        (parallel_vec_env, {"autoreset_mode": "NextStep"}, "must be AutoresetMode.SAME_STEP or DISABLED"),
    ],
)
def test_unplayable_argument_of_one_interface_is_named(build: Any, chosen: dict[str, Any], message: str) -> None:
    games = {} if build in (PacManBotEnv, parallel_env) else {"num_envs": 4}
    with pytest.raises(ValueError, match=message):
        build(**games | chosen)


def test_environments_take_shared_arguments_and_their_own() -> None:
    shared = {"map", "ghosts", "observation", "action", "preset", "settings", "render_mode", "flat", "defaults"}
    vector = {"num_envs", "num_threads", "autoreset_mode", "copy", "max_episode_steps"}
    for build, more in ((PacManBotEnv, set()), (PacManBotVectorEnv, vector), (parallel_env, set()), (env, set())):
        assert set(inspect.signature(build).parameters) == shared | more
    assert set(inspect.signature(parallel_vec_env).parameters) <= shared | vector
    with pytest.raises(TypeError, match="unexpected keyword argument 'nothing'"):
        PacManBotEnv(nothing=1)  # type: ignore[call-arg]


def test_user_settings_override_flat_defaults() -> None:
    flat = make(flat=True).config
    assert (flat.decisions.when, flat.observation.kinds, flat.observation.flat) == ("event", ("planner",), True)
    own = make(flat=True, observation="scan", settings={"decisions.when": "tick", "timeout": "truncation"}).config
    assert (own.decisions.when, own.timeout, own.observation.mask) == ("tick", "truncation", "method")
    assert (own.observation.kinds, own.observation.flat) == (("scan",), False)
    several = parallel_env(flat=True).config
    assert (several.decisions.when, several.observation.mask, several.observation.flat) == ("tick", "beside", True)


def test_arguments_and_settings_give_same_configuration() -> None:
    by_arguments = make(observation=("scan", "features"), action="velocity", ghosts=2, settings={"endless": True})
    settings = {
        "observation.kinds": ["features", "scan"],
        "action": "velocity",
        "clyde.ghosts": ["wander", "wander"],
        "endless": True,
    }
    assert make(settings=settings).config == by_arguments.config == make_config("robot", "robust", **settings)
    assert make(ghosts=np.int64(2)).config.clyde.ghosts == ("wander", "wander")
    scan = make(observation="scan").config
    assert make(observation=["scan"]).config == make(observation=("scan", "scan")).config == scan


@pytest.mark.parametrize(
    ("build", "action", "kinds"),
    [
        (PacManBotEnv, 3, (int, np.int64, np.int32, np.uint8, np.array)),
        (partial(PacManBotVectorEnv, 3), np.array([2, 0, 23]), (list, tuple, np.int32, np.uint8, np.uint64)),
    ],
)
def test_integers_of_any_type_are_accepted_as_actions(build: Any, action: Any, kinds: Any) -> None:
    plain, other = build(), build()
    plain.reset(seed=1)
    other.reset(seed=1)
    for kind in kinds:
        assert same(plain.step(action), other.step(kind(action)))
