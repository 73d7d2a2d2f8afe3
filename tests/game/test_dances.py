import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import ShowConfig
from pacman_env.game.events import STAND_S, angular_velocity

SHOW = ShowConfig()

PERIOD = 0.05


def played(motion: str) -> list[float]:
    """Commands of a 20 Hz timer until the motion is over."""
    commands: list[float] = []
    while (command := angular_velocity(motion, len(commands) * PERIOD, SHOW)) is not None:  # type: ignore[arg-type]
        commands.append(command)
    return commands


def test_start_spin_turns_one_way_for_8_s() -> None:
    assert set(played("spin")) == {1.5}
    assert len(played("spin")) * PERIOD == pytest.approx(8.0)


def test_death_shake_lasts_5_s_and_returns() -> None:
    commands = played("shake")
    standing = round(STAND_S / PERIOD)
    assert set(commands[:standing]) == {0.0}
    assert set(commands[standing:]) == {1.5, -1.5}
    assert len(commands) * PERIOD == pytest.approx(5.0)
    turned = [sum(commands[:k]) * PERIOD for k in range(len(commands) + 1)]
    assert max(map(abs, turned)) < 0.3
    assert abs(turned[-1]) < 0.1
    changes = sum(a != b for a, b in itertools.pairwise(commands))
    assert changes == 19  # the first from the stand


@given(st.sampled_from(["spin", "shake", "stop"]), st.floats(-1e9, 1e9))
def test_motions_keep_speed_and_duration_limits(motion: str, elapsed: float) -> None:
    command = angular_velocity(motion, elapsed, SHOW)  # type: ignore[arg-type]
    assert command is None or abs(command) <= SHOW.spin_radps
    if elapsed < 0 or elapsed >= max(SHOW.start_s, SHOW.death_s) or motion == "stop":
        assert command is None


def test_speed_and_swing_follow_the_configuration() -> None:
    show = ShowConfig(spin_radps=0.7, swing_s=1.0, death_s=2.0)
    for at, command in ((0.0, 0.0), (0.4, 0.0), (0.6, 0.7), (0.9, 0.7), (1.1, -0.7), (1.9, -0.7), (2.0, None)):
        assert angular_velocity("shake", at, show) == command
