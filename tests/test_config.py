from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import pytest

from pacman_env.config import EXECUTIONS, PRESETS, Config, ConfigError, differences, make_config
from pacman_env.config.validation import Share, convert, require


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("execution", EXECUTIONS)
def test_preset_composes_with_every_execution(preset: str, execution: str) -> None:
    config = make_config(preset, execution, **{"clyde.speed_mps": 0.35, "time_limit_s": 60.0})
    wanted = {**PRESETS[preset], **EXECUTIONS[execution], "clyde.speed_mps": 0.35}
    for name, value in wanted.items():
        group, leaf = name.split(".")
        assert getattr(getattr(config, group), leaf) == value, name
    assert config.time_limit_s == 60.0


def test_single_fields_override_preset_and_execution() -> None:
    changes = {"robot.speed_mps": 0.2, "execution.switch": "cancel_then_send"}
    config = make_config("robot", "robust", **changes)
    assert (config.robot.speed_mps, config.execution.switch) == (0.2, "cancel_then_send")


def test_robot_and_ideal_presets_have_documented_values() -> None:
    robot, ideal = make_config("robot"), make_config("ideal")
    assert (robot.robot.speed_mps, robot.localization.perfect) == (0.256, False)
    assert (ideal.robot.speed_mps, ideal.localization.perfect) == (0.306, True)
    assert (robot.execution.tick_s, robot.physics_step_s, robot.nav2.planner_period_s) == (0.5, 0.05, 1.0)


def test_with_fields_changes_only_named_fields_of_copy() -> None:
    before = make_config()
    after = before.with_fields(**{"clyde.speed_mps": 0.4, "clyde.spawn": "anywhere", "max_pellets": 30})
    assert before == make_config()
    assert after.clyde == dataclasses.replace(before.clyde, speed_mps=0.4, spawn="anywhere")
    assert dataclasses.replace(after, clyde=before.clyde, max_pellets=None) == before


@pytest.mark.parametrize(
    ("name", "meant"),
    [("clyde.spead_mps", r"clyde\.speed_mps"), ("speed_step_mps", r"clyde\.speed_step_mps"), ("endles", "endless")],
)
def test_mistyped_field_is_answered_with_similar_name(name: str, meant: str) -> None:
    with pytest.raises(ConfigError, match=f"unknown configuration field '{name}': did you mean {meant}"):
        make_config(**{name: 1.0})


@pytest.mark.parametrize("name", ["speed", "clyde.spead_mps", "ghost.speed_mps", "max_pellets.x"])
def test_unknown_field_is_named(name: str) -> None:
    with pytest.raises(ConfigError, match=f"unknown configuration field '{name}'"):
        make_config(**{name: 1.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("fast",), "unknown preset 'fast'.*ideal.*robot"), (("robot", "x"), "unknown execution 'x'.*as_built.*robust")],
)
def test_unknown_preset_or_execution_is_refused_with_choices(arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make_config(*arguments)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("robot.radius_m", 0.0),
        ("robot.speed_mps", -0.1),
        ("robot.mass_kg", math.nan),
        ("robot.omega_radps", "fast"),
        ("robot.inscribed_radius_m", 0.1),
        ("localization.sigma_xy_m", -0.01),
        ("localization.update_distance_m", 0.0),
        ("nav2.goal_tolerance_m", 0),
        ("nav2.accept_delay_s", -0.1),
        ("nav2.abort_rate", 1.01),
        ("nav2.stuck_abort_s", math.inf),
        ("pellets.spacing_m", 0.0),
        ("pellets.free_grey", 255),
        ("clyde.speed_mps", -0.25),
        ("clyde.spawn", "nearby"),
        ("execution.death_radius_m", 0.0),
        ("execution.pose_source", "odom"),
        ("execution.on_abort", "retry"),
        ("execution.switch", "send"),
        ("execution.min_dwell_s", -0.5),
        ("execution.success_margin_m", -0.1),
        ("show.start_s", 61.0),
        ("show.spin_radps", 2.0),
        ("show.start_s", -1.0),
        ("show.home_retries", -1),
        ("robot.velocity_timeout_s", 0.0),
        ("nav2.recovery_wait_s", math.nan),
        ("nav2.clear_distance_m", -0.5),
        ("clyde.click_distance_m", -0.25),
        ("clyde.ghosts", ()),
        ("localization.converges_m", 0.0),
        ("refuges.clearance_m", -0.3),
        ("randomize.sigma_xy_m", (0.2, 0.1)),
        ("refuges.nooks", -1),
        ("time_limit_s", 0.0),
        ("max_pellets", 0),
    ],
)
def test_value_out_of_range_is_named_with_field(name: str, value: object) -> None:
    with pytest.raises(ConfigError) as error:
        make_config(**{name: value})
    assert name.rpartition(".")[2] in str(error.value)
    assert repr(value) in str(error.value)


@pytest.mark.parametrize(
    ("name", "value", "place"),
    [
        ("randomize.speed_mps", (0.0, 0.2), r"randomize\.speed_mps\[0\] = 0\.0"),
        ("randomize.abort_rate", (0.5, 1.5), r"randomize\.abort_rate\[1\] = 1\.5"),
        ("clyde.ghosts", ("wander", 3), r"clyde\.ghosts\[1\] = 3"),
    ],
)
def test_wrong_value_in_list_is_named_with_place(name: str, value: object, place: str) -> None:
    with pytest.raises(ConfigError, match=f"^{place}: Expected "):
        make_config(**{name: value})


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


@pytest.mark.parametrize(
    "name",
    [
        "execution.tick_s",
        "execution.check_period_s",
        "clyde.update_period_s",
        "localization.scan_period_s",
        "nav2.planner_period_s",
    ],
)
@pytest.mark.parametrize("value", [0.12, 0.02])
def test_period_must_be_multiple_of_physics_step(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"{name} = {value}: must be a whole number of physics steps of 0\.05 s"):
        make_config(**{name: value})
    allowed = {"execution.tick_s": 1.5, "execution.check_period_s": 0.25}.get(name, 0.15)
    assert make_config(**{name: allowed}).as_dict() != make_config().as_dict()


def test_check_period_must_divide_tick() -> None:
    with pytest.raises(ConfigError, match=r"check_period_s = 0\.2: must divide execution\.tick_s = 0\.5 s"):
        make_config(**{"execution.check_period_s": 0.2})


def test_physics_step_must_divide_every_period() -> None:
    with pytest.raises(ConfigError, match=r"physics steps of 0\.03 s"):
        make_config(physics_step_s=0.03)
    assert make_config(physics_step_s=0.025).physics_step_s == 0.025


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


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("reward.pellet", "a", "Expected `float`"),
        ("reward.death", math.nan, "must be a finite number"),
        ("refuges.spread", 1.5, "Expected `int`"),
        ("localization.perfect", "yes", "Expected `bool`"),
        ("max_pellets", "x", r"Expected `int \| null`"),
        ("clyde", None, "must be a ClydeConfig"),
        ("robot", 5, "must be a RobotConfig"),
    ],
)
def test_value_of_wrong_type_is_refused_with_rule(name: str, value: object, rule: str) -> None:
    with pytest.raises(ConfigError, match=rf"{name.rpartition('.')[2]} = .*: {rule}"):
        make_config(**{name: value})


@pytest.mark.parametrize("name", ["with_fields", "time_limit_s.real", "clyde.", "as_dict"])
def test_methods_and_partial_names_are_not_fields(name: str) -> None:
    with pytest.raises(ConfigError, match="unknown configuration field"):
        make_config(**{name: 1})


def test_robot_speed_must_not_exceed_wheel_speed() -> None:
    with pytest.raises(ConfigError, match=r"speed_mps = 0\.46: must be at most wheel_speed_mps = 0\.306"):
        make_config(**{"robot.speed_mps": 0.46})
    assert make_config(**{"robot.speed_mps": 0.46, "robot.wheel_speed_mps": 0.46}).robot.speed_mps == 0.46


def test_planner_period_must_not_outlast_the_plan() -> None:
    with pytest.raises(ConfigError, match=r"planner_period_s = 5\.0: the robot would drive more than 0\.8 m"):
        make_config(**{"nav2.planner_period_s": 5.0})


def test_numpy_numbers_become_python_numbers() -> None:
    config = make_config(**{"clyde.speed_mps": np.float32(0.5), "refuges.spread": np.int64(3)})
    assert (type(config.clyde.speed_mps), type(config.refuges.spread)) == (float, int)
    json.dumps(config.as_dict())


def test_dwell_time_is_set_by_robust_execution_only() -> None:
    dwell = {name: make_config(execution=name).execution.min_dwell_s for name in EXECUTIONS}
    assert dwell == {"as_built": 0.0, "robust": 1.0}


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


def test_refused_path_is_shown_as_text() -> None:
    with pytest.raises(ConfigError, match=r"^clyde = 'nope': is for --measure$"):
        require(False, "clyde", Path("nope"), "is for --measure")
