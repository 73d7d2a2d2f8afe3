import pytest

from pacman_env.config import ConfigError, make_config, parse_settings


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("nav2.abort_rate=0.01", 0.01),
        ("refuges.spread=3", 3),
        ("localization.perfect=True", True),
        ("pellets.reachable_only=false", False),
        ("execution.on_abort=lose_pellet", "lose_pellet"),
        ("time_limit_s=60", 60.0),
        ("max_pellets=20", 20),
        ("pellets.spacing_m=.5", 0.5),
        ("time_limit_s=+60", 60.0),
        ("time_limit_s=5.", 5.0),
        ("time_limit_s=1_000", 1000.0),
        ("time_limit_s=1e3", 1000.0),
        ("max_pellets=+2_0", 20),
        ("max_pellets=2e1", 20),
        ("randomize.clyde_speed_mps=.2,+.5", (0.2, 0.5)),
        ("home=-1.,-.5e1,+0", (-1.0, -5.0, 0.0)),
        ("max_pellets=none", None),
        ("clyde.ghosts=chase,wander", ("chase", "wander")),
        ("randomize.clyde_speed_mps=0.2, 0.5", (0.2, 0.5)),
        ("randomize.clyde_speed_mps=none", None),
    ],
)
def test_setting_gets_type_of_its_field(text: str, value: object) -> None:
    name = text.partition("=")[0]
    changes = parse_settings([text])
    assert changes == {name: value}
    assert type(changes[name]) is type(value)
    make_config(**changes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nav2.abort_rate", "must be name=value"),
        ("nav2.abort=1", "unknown configuration field 'nav2.abort'"),
        ("physics_step_s.real=1", "unknown configuration field 'physics_step_s.real'"),
        ("refuges=1", r"'refuges' is a group: choose one of refuges\.spread"),
        ("nav2.abort_rate=often", "'often': Expected `float`"),
        *((f"time_limit_s={text}", "Expected `float`") for text in ("nan", "-inf", "infinity", "1e999", "0x10")),
        ("refuges.spread=1.5", "'1.5': Expected `int`"),
        ("localization.perfect=1", "'1': Expected `bool`"),
        ("randomize.clyde_speed_mps=0.2,fast", "'fast': Expected `float`"),
    ],
)
def test_wrong_setting_is_refused_with_reason(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_settings([text])
