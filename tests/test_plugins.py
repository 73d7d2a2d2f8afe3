"""Names of plug-ins: what they stand for, what is said where they stand for nothing, and the example being played."""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import pacman_env
from pacman_env.config import make_config, preset_names
from pacman_env.game.ghosts import find_behaviour
from pacman_env.observations.kinds import KINDS
from pacman_env.plugins import PluginError, Registry
from pacman_env.policies.registry import make_policy, policy_names
from tests.envs.helpers import QUICK, make, make_vector
from tests.plugin_example import install

GROUP = "pacman_env.tests"
OWN = {"one": 1, "two": 2}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path with an installed package of three entry points."""
    facts = tmp_path / "added-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: added\nVersion: 1.0\n")
    points = {"three": "added_things:THREE", "gone": "added_things:FOUR", "bad": "torn:X"}
    (facts / "entry_points.txt").write_text(
        f"[{GROUP}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
    )
    (tmp_path / "added_things.py").write_text("THREE = 3\nclass Box:\n    FIVE = 5\n")
    (tmp_path / "torn.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("added_things", None)


def test_registry_finds_own_names_entry_points_and_attributes(package: Path) -> None:
    registry = Registry("thing", GROUP, OWN)
    assert registry.names() == ["one", "two", "bad", "gone", "three"]
    found = [registry.find(name) for name in ("one", "two", "three", "added_things:THREE", "added_things:Box.FIVE")]
    assert found == [1, 2, 3, 3, 5]


@pytest.mark.parametrize(
    ("group", "name", "find"),
    [
        ("pacman_env.ghosts", "chase", find_behaviour),
        ("pacman_env.policies", "nearest", make_policy),
        ("pacman_env.observations", "features", KINDS.find),
        ("pacman_env.presets", "ideal", make_config),
        (GROUP, "two", Registry("thing", GROUP, OWN).find),
    ],
)
def test_entry_point_with_used_name_is_reported_once(
    package: Path, group: str, name: str, find: Callable[[str], object]
) -> None:
    (package / "added-1.0.dist-info" / "entry_points.txt").write_text(f"[{group}]\n{name} = added_things:THREE\n")
    with pytest.warns(RuntimeWarning, match=f"'{name}': added_things:THREE of added is not used") as told:
        assert find(name) != 3
    assert len(told) == 1
    find(name)  # does not warn again


def test_registered_name_belongs_to_one_registry_only() -> None:
    registry = Registry("thing", GROUP, OWN)
    registry.register("six", 6)
    assert registry.find("six") == 6
    assert "six" not in OWN
    with pytest.raises(ValueError, match="thing 'six' is registered already"):
        registry.register("six", 7)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("thre", r"unknown thing 'thre': did you mean three\?"),
        ("five", "unknown thing 'five': choose one of one, two, bad, gone, three, or module:name"),
        (
            "no_such_module:X",
            r"thing 'no_such_module:X': module no_such_module cannot be imported \(is it installed or on PYTHONPATH",
        ),
        ("../added_things:THREE", "unknown thing"),
        ("added_things.py:THREE", r"thing 'added_things.py:THREE': ModuleNotFoundError: .*not a package"),
        ("added_things:THREE()", "unknown thing"),
        ("added_things:FOUR", "thing 'added_things:FOUR': AttributeError: .*no attribute 'FOUR'"),
        ("gone", "thing 'gone': AttributeError: .*'added_things' has no attribute 'FOUR'"),
        ("bad", "thing 'bad': ZeroDivisionError: division by zero"),
        ("torn:X", "thing 'torn:X': ZeroDivisionError: division by zero"),
        ("", "unknown thing ''"),
    ],
)
def test_unknown_name_is_refused_with_reason(package: Path, name: str, message: str) -> None:
    with pytest.raises(PluginError, match=message):
        Registry("thing", GROUP, OWN).find(name)


class Twice:
    """A kind that adds what the features hold already."""

    name = "twice"

    def parts(self, batch: Any) -> dict[str, Any]:
        return {"robot": None}


def make_ghost(name: str) -> None:
    make(ghosts=name)


def make_kinds(kinds: tuple[str, ...]) -> None:
    make(settings={"observation.kinds": kinds})


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("plugin"))


@pytest.fixture
def example(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The example package is installed."""
    monkeypatch.syspath_prepend(site)
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "pacman_plugin"]:
        del sys.modules[name]


def test_example_plugin_is_found_by_its_names(example: None) -> None:
    assert "shy" in policy_names()
    assert "sleepy" in preset_names()
    assert make_policy("shy", haste=1.0).name == make_policy("pacman_plugin.policy:Shy").name == "shy"
    assert make_config("sleepy").clyde.speed_mps == make_config("pacman_plugin.preset:SLEEPY").clyde.speed_mps == 0.1


def test_example_plugin_plays_in_gymnasium(example: None) -> None:
    arguments: dict[str, Any] = {"preset": "sleepy", "observation": ("features", "compass")}
    env = make(**arguments)
    check_env(env, skip_render_check=True)
    vector = make_vector(3, **arguments)
    observations, _ = vector.reset(seed=2)
    observation, _ = env.reset(seed=2 + 1)
    policy = make_policy("shy")
    policy.reset(np.ones(3, dtype=np.bool_), env.config)
    for _ in range(30):
        np.testing.assert_array_equal(observations["compass"][1], observation["compass"])
        goals = policy.select(vector.situation)
        observation, *_ = env.step(goals[1])
        observations, *_ = vector.step(goals)
    assert env.config.clyde.speed_mps == 0.1
    assert np.hypot(*observation["compass"]) > 0.0


def test_example_plugin_plays_in_pettingzoo(example: None) -> None:
    env = pacman_env.parallel_env(preset="sleepy", observation="compass", ghosts=("policy", "ambush"), settings=QUICK)
    observations, _ = env.reset(seed=0)
    while env.agents:
        assert set(observations["pacman"]) == {"compass", "action_mask"}
        actions = {agent: env.action_space(agent).sample(observations[agent]["action_mask"]) for agent in env.agents}
        observations, *_ = env.step(actions)


def test_example_ghost_waits_ahead_of_robot(example: None) -> None:
    env = make(ghosts=("ambush", "wander"), preset="ideal", settings={"execution.death_radius_m": 0.01})
    env.reset(seed=4)
    for _ in range(60):
        env.step(env.batch.hold)  # it stands at home and looks along x
    x, y, _ = env.batch.assets.grid.home
    ambush, wander = env.batch.ghosts[0]
    assert np.hypot(ambush["x"] - x - 1.0, ambush["y"] - y) < 0.3
    assert np.hypot(wander["x"] - x - 1.0, wander["y"] - y) > 0.3


@pytest.mark.parametrize(
    ("made", "argument", "message"),
    [
        *((make_policy, spec, f"policy '{spec}': .* is no") for spec in ("json:decoder", "collections:OrderedDict")),
        *((make_config, preset, preset) for preset in ("json:decoder", "json:loads")),
        (make_config, "tests.test_plugins:OWN", "unknown configuration field 'one'"),
        (make_ghost, "sulk", r"unknown ghost behaviour 'sulk': choose one of .*, ambush, or"),
        (make_ghost, "json:loads", r"clyde\.ghosts = \('json:loads',\): .*, must be a Behaviour"),
        (make_kinds, ("features", "tests.test_plugins:Twice"), "kind 'twice': 'robot' is in the observation"),
        (make_kinds, ("thrice",), r"observation.kinds = .*unknown observation kind 'thrice'"),
    ],
)
def test_object_of_another_kind_is_refused(
    example: None, made: Callable[[Any], object], argument: object, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        made(argument)


@pytest.mark.parametrize("workers", ["1", "2"])
def test_example_policy_is_compared_with_others(example: None, tmp_path: Path, workers: str) -> None:
    from pacman_env.evaluation.compare.__main__ import main

    out = tmp_path / "out.json"
    policies = ["nearest", "shy", "pacman_plugin.policy:Shy"]
    rules = ["--preset", "sleepy", "--set", "clyde.ghosts=ambush"]
    asked = ["--policies", *policies, *rules, "--episodes", "2", "--workers", workers]
    assert main([*asked, "--json", str(out)]) == 0
    rows = json.loads(out.read_text())["rows"]
    assert {row["policy"] for row in rows} == set(policies)
