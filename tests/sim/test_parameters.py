"""What is drawn for an episode belongs to its seed, lies in its range and reaches the game."""

import dataclasses

import numpy as np

from pacman_env.config import RandomizeConfig, make_config
from pacman_env.levels.draws import draw_below
from pacman_env.rng import LEVEL, LIDAR
from pacman_env.sim.parameters import draw_episodes, drawn_values, next_seeds

SEEDS = np.arange(2000, dtype=np.uint64) * np.uint64(0x1234567)
#: The range of each field that can be drawn, and the fixed value that it stands for.
FIELDS = {
    "speed_mps": ((0.1, 0.3), "robot.speed_mps"),
    "clyde_speed_mps": ((0.0, 0.5), "clyde.speed_mps"),
    "sigma_xy_m": ((0.01, 0.1), "localization.sigma_xy_m"),
    "sigma_yaw_rad": ((0.02, 0.2), "localization.sigma_yaw_rad"),
    "update_distance_m": ((0.1, 0.4), "localization.update_distance_m"),
    "update_angle_rad": ((0.1, 0.3), "localization.update_angle_rad"),
    "accept_delay_s": ((0.0, 1.0), "nav2.accept_delay_s"),
    "abort_rate": ((0.0, 0.5), "nav2.abort_rate"),
    "pickup_radius_m": ((0.2, 0.4), "execution.pickup_radius_m"),
}
RANGES = {name: limits for name, (limits, _) in FIELDS.items()}
SETTINGS = {f"randomize.{name}": limits for name, limits in RANGES.items()}


def test_draws_are_uniform_and_independent() -> None:
    config = make_config("robot", **SETTINGS)
    values = drawn_values(draw_episodes(SEEDS, config), config)
    assert list(values) == list(RANGES) == [f.name for f in dataclasses.fields(RandomizeConfig)]
    shares = np.stack([(values[name] - low) / (high - low) for name, (low, high) in RANGES.items()])
    assert (shares >= 0).all()
    assert (shares <= 1).all()
    for row in np.delete(shares, list(RANGES).index("accept_delay_s"), axis=0):  # that one has 21 values
        counts, _ = np.histogram(row, bins=10, range=(0, 1))
        assert (np.abs(counts - 200) < 5 * np.sqrt(200)).all()
    steps = values["accept_delay_s"] / config.physics_step_s
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert len(set(np.rint(steps))) == 21
    assert np.abs(np.corrcoef(shares) - np.eye(len(shares))).max() < 5 / np.sqrt(len(SEEDS))


def test_seed_draws_the_same_alone() -> None:
    config = make_config("robot", **SETTINGS)
    together = draw_episodes(SEEDS[:50], config)
    for i in (0, 7, 49):
        assert draw_episodes(SEEDS[i : i + 1], config)[0] == together[i]


def test_range_without_width_is_the_fixed_value() -> None:
    for name, ((_, value), fixed_name) in FIELDS.items():
        drawn = make_config("robot", **{f"randomize.{name}": (value, value)})
        fixed = make_config("robot", **{fixed_name: value})
        assert (draw_episodes(SEEDS[:20], drawn) == draw_episodes(SEEDS[:20], fixed)).all()
        found = drawn_values(draw_episodes(SEEDS[:20], drawn), drawn)[name]
        np.testing.assert_allclose(found, value, rtol=1e-12)


def test_perfect_localization_has_no_error() -> None:
    config = make_config("ideal", **SETTINGS)
    values = drawn_values(draw_episodes(SEEDS, config), config)
    assert not values["sigma_xy_m"].any()
    assert not values["sigma_yaw_rad"].any()


def test_episodes_without_ranges_have_fixed_values() -> None:
    config = make_config("robot")
    episodes = draw_episodes(SEEDS, config)
    np.testing.assert_array_equal(episodes["episode_seed"], SEEDS)
    episodes["episode_seed"] = 0
    assert (episodes == episodes[0]).all()
    assert episodes[0]["speed_limit"] == config.robot.speed_mps
    assert drawn_values(episodes, config) == {}


def test_next_seeds_are_new_and_below_limit() -> None:
    first = next_seeds(SEEDS)
    second = next_seeds(first)
    everything = np.concatenate([SEEDS, first, second])
    assert len(np.unique(everything)) == len(everything)
    assert everything.max() < 2**63
    np.testing.assert_array_equal(next_seeds(SEEDS[3:5]), first[3:5])


def test_numbers_below_a_bound_are_uniform() -> None:
    for count in (1, 2, 10, 1_000_000):
        numbers = draw_below(SEEDS, LEVEL, count)
        assert 0 <= numbers.min() <= numbers.max() < count
    counts = np.bincount(draw_below(SEEDS, LEVEL, 10))
    assert (np.abs(counts - 200) < 5 * np.sqrt(200)).all()
    assert (numbers != draw_below(SEEDS, LIDAR, count)).mean() > 0.8  # another purpose
