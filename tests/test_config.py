from __future__ import annotations

import dataclasses
import json
import math
import re
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import pytest

from pacman_env.config import EXECUTIONS, PRESETS, Config, ConfigError, differences, make_config
from pacman_env.config.validation import Share, convert


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("execution", EXECUTIONS)
def test_preset_composes_with_every_execution(preset: str, execution: str) -> None:
    config = make_config(preset, execution, **{"clyde.speed_mps": 0.35, "time_limit_s": 60.0})
    wanted = {**PRESETS[preset], **EXECUTIONS[execution], "clyde.speed_mps": 0.35}
    for name, value in wanted.items():
        group, leaf = name.split(".")
        assert getattr(getattr(config, group), leaf) == value, name
    assert config.time_limit_s == 60.0


def test_robot_and_ideal_presets_have_documented_values() -> None:
    robot, ideal = make_config("robot"), make_config("ideal")
    assert robot == Config()
    assert (robot.robot.speed_mps, robot.localization.perfect) == (0.285, False)
    assert (ideal.robot.speed_mps, ideal.localization.perfect) == (0.306, True)
    assert (robot.execution.tick_s, robot.physics_step_s, robot.nav2.planner_period_s) == (0.5, 0.05, 1.0)
    dwell = {name: make_config(execution=name).execution.min_dwell_s for name in EXECUTIONS}
    assert dwell == {"as_built": 0.0, "robust": 1.0}


def test_with_fields_changes_only_named_fields_of_copy() -> None:
    before = make_config()
    after = before.with_fields(**{"clyde.speed_mps": 0.4, "clyde.spawn": "anywhere", "max_pellets": 30})
    assert before == make_config()
    assert after.clyde == dataclasses.replace(before.clyde, speed_mps=0.4, spawn="anywhere")
    assert dataclasses.replace(after, clyde=before.clyde, max_pellets=None) == before


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("clyde.spead_mps", r": did you mean clyde\.speed_mps"),
        ("speed_step_mps", r": did you mean clyde\.speed_step_mps"),
        ("endles", ": did you mean endless"),
        *((name, "") for name in ("speed", "ghost.speed_mps", "max_pellets.x", "time_limit_s.real", "clyde.")),
        *((name, "") for name in ("with_fields", "as_dict")),
    ],
)
def test_unknown_field_is_answered_with_similar_name(name: str, answer: str) -> None:
    with pytest.raises(ConfigError, match=f"unknown configuration field '{name}'{answer}"):
        make_config(**{name: 1.0})


#: Values that fields must not have, out of range or of another type, and these fields.
WRONG: list[tuple[object, str]] = [
    (0.0, "robot.radius_m robot.velocity_timeout_s localization.update_distance_m localization.converges_m"),
    (0.0, "nav2.goal_tolerance_m pellets.spacing_m execution.death_radius_m time_limit_s"),
    (-0.1, "robot.speed_mps localization.sigma_xy_m nav2.accept_delay_s nav2.clear_distance_m clyde.speed_mps"),
    (-0.1, "clyde.click_distance_m execution.min_dwell_s execution.success_margin_m show.start_s refuges.clearance_m"),
    (-1, "show.home_retries refuges.nooks"),
    (0, "max_pellets"),
    (1.01, "nav2.abort_rate"),
    (1.5, "refuges.spread"),
    (2.0, "show.spin_radps"),
    (61.0, "show.start_s"),
    (255, "pellets.free_grey"),
    (0.1, "robot.inscribed_radius_m"),
    (math.nan, "robot.mass_kg nav2.recovery_wait_s reward.death"),
    (math.inf, "nav2.stuck_abort_s"),
    ("other", "robot.omega_radps reward.pellet max_pellets localization.perfect clyde.spawn"),
    ("other", "execution.pose_source execution.on_abort execution.switch"),
    ((), "clyde.ghosts"),
    ((0.2, 0.1), "randomize.sigma_xy_m"),
    (None, "clyde robot"),
]


@pytest.mark.parametrize(("name", "value"), [(name, value) for value, names in WRONG for name in names.split()])
def test_wrong_value_is_refused_with_its_field(name: str, value: object) -> None:
    with pytest.raises(ConfigError, match=rf"\b{name.rpartition('.')[2]} = {re.escape(repr(value))}: \w"):
        make_config(**{name: value})


PERIODS = (
    *("execution.tick_s", "execution.check_period_s", "clyde.update_period_s", "localization.scan_period_s"),
    "nav2.planner_period_s",
)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        *((name, value, rf"{name} = {value}: must be a whole num") for name in PERIODS for value in (0.12, 0.02)),
        ("execution.check_period_s", 0.2, r"check_period_s = 0\.2: must divide execution\.tick_s = 0\.5 s"),
        ("physics_step_s", 0.03, r"physics steps of 0\.03 s"),
        ("robot.speed_mps", 0.46, r"speed_mps = 0\.46: must be at most wheel_speed_mps = 0\.306"),
        ("nav2.planner_period_s", 5.0, r"planner_period_s = 5\.0: the robot would drive more than 0\.8 m"),
        ("randomize.speed_mps", (0.0, 0.2), r"^randomize\.speed_mps\[0\] = 0\.0: Expected "),
        ("randomize.abort_rate", (0.5, 1.5), r"^randomize\.abort_rate\[1\] = 1\.5: Expected "),
        ("clyde.ghosts", ("wander", 3), r"^clyde\.ghosts\[1\] = 3: Expected "),
        ("preset", "fast", "unknown preset 'fast'.*ideal.*robot"),
        ("execution", "x", "unknown execution 'x'.*as_built.*robust"),
    ],
)
def test_value_is_refused_with_reason(name: str, value: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make_config(**{name: value})


@pytest.mark.parametrize(
    "changes",
    [
        *({name: {"execution.tick_s": 1.5, "execution.check_period_s": 0.25}.get(name, 0.15)} for name in PERIODS),
        {"physics_step_s": 0.025},
        {"robot.speed_mps": 0.46, "robot.wheel_speed_mps": 0.46},
    ],
)
def test_values_that_suit_each_other_are_accepted(changes: dict[str, float]) -> None:
    assert make_config(**changes) == make_config().with_fields(**changes) != make_config()


class Entry(msgspec.Struct):
    word: Literal["yes", "no"]
    shares: tuple[Share, Share] = (0.0, 0.0)
    inner: Entry | None = None


class Entries(msgspec.Struct):
    listed: Annotated[tuple[Entry, ...], msgspec.Meta(min_length=1)]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({}, r"listed\[1\]: Object missing required field `word`"),
        ({"word": "perhaps"}, r"listed\[1\]\.word = 'perhaps': must be one of \('yes', 'no'\)"),
        ({"word": "no", "shares": [0, 2]}, r"listed\[1\]\.shares\[1\] = 2: Expected `float` <= 1"),
        ({"word": "no", "inner": {"word": 3}}, r"listed\[1\]\.inner\.word = 3: Expected `str`"),
    ],
)
def test_wrong_field_in_list_entry_is_named(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=f"^{message}"):
        convert({"listed": [{"word": "yes"}, wrong]}, Entries)


def _leaves(value: object) -> list[object]:
    if isinstance(value, dict):
        return [leaf for v in value.values() for leaf in _leaves(v)]
    if isinstance(value, list):
        return [leaf for v in value for leaf in _leaves(v)]
    return [value]


def test_as_dict_contains_every_field_as_plain_data() -> None:
    config = make_config("ideal", "as_built", max_pellets=12)
    data = config.as_dict()
    assert json.loads(json.dumps(data)) == data
    assert {type(leaf) for leaf in _leaves(data)} <= {int, float, str, bool, type(None)}
    fields = [f for f in dataclasses.fields(config) if dataclasses.is_dataclass(getattr(config, f.name))]
    rebuilt: dict[str, Any] = dict(data)
    for f in fields:
        rebuilt[f.name] = type(getattr(config, f.name))(**data[f.name])
    assert Config(**rebuilt) == config


def test_configuration_is_frozen_and_hashable() -> None:
    config = make_config()
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.time_limit_s = 1.0  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.clyde.speed_mps = 1.0  # type: ignore[misc]
    assert hash(config) == hash(make_config())


def test_numpy_numbers_become_python_numbers() -> None:
    config = make_config(**{"clyde.speed_mps": np.float32(0.5), "refuges.spread": np.int64(3)})
    assert (type(config.clyde.speed_mps), type(config.refuges.spread)) == (float, int)
    json.dumps(config.as_dict())


def test_configuration_hash_depends_on_field_values() -> None:
    config = make_config()
    assert config.hash == make_config().hash
    assert len(config.hash) == 12
    assert int(config.hash, 16) >= 0
    others = [make_config(**{name: value}) for name, value in (("show.death_s", 4.0), ("endless", True))]
    assert len({c.hash for c in (config, *others)}) == 3


def test_differences_list_fields_with_both_values() -> None:
    one, other = make_config(), make_config(**{"clyde.speed_mps": 0.3, "clyde.ghosts": ("chase",), "endless": True})
    assert differences(one.as_dict(), one.as_dict()) == {}
    assert differences(one.as_dict(), other.as_dict()) == {
        "clyde.ghosts": (["wander"], ["chase"]),
        "clyde.speed_mps": (0.25, 0.3),
        "endless": (False, True),
    }
    older = one.as_dict()
    del older["show"], older["clyde"]["spawn"]
    assert differences(older, one.as_dict()) == {
        "clyde.spawn": (None, "connected"),
        "show": (None, one.as_dict()["show"]),
    }
