from __future__ import annotations

import numpy as np

from eval.episodes import episode_seeds, play
from eval.report_runs import Job, Task, level_source, play_jobs, round_map
from pacman_env.sim.records import COMPLETE, DEAD, TIMEOUT
from tests.eval.helpers import CONFIG, played

HOUSE = Task("house", "house")
LEVELS = Task("generated:test", "generated:test", 5)
SEEDS = episode_seeds(5, 12)


def test_rounds_on_a_map_are_those_of_the_comparison() -> None:
    ((records, times),) = play_jobs([Job(HOUSE, CONFIG, "nearest", SEEDS)])
    np.testing.assert_array_equal(records, played("nearest")[0])
    assert len(times) > 0


def test_an_endless_game_begins_with_the_round_of_its_seed() -> None:
    config = CONFIG.with_fields(endless=True)
    ((games, times),) = play_jobs([Job(HOUSE, config, "nearest", SEEDS)])
    assert len(times) == 0
    rounds = played("nearest")[0]
    np.testing.assert_array_equal(games["seed"], SEEDS)
    complete = rounds["end"] == COMPLETE
    assert 0 < complete.sum() < len(complete)
    np.testing.assert_array_equal(games["pellets"][~complete], rounds["collected"][~complete])
    np.testing.assert_array_equal(games["end"][~complete], rounds["end"][~complete])
    assert (games["rounds"][~complete] == 0).all()
    assert (games["rounds"][complete] >= 1).all()
    spawned = rounds["spawned"][0]
    assert (games["pellets"] >= games["rounds"] * spawned).all()
    assert (games["pellets"] < (games["rounds"] + 1) * spawned).all()
    assert np.isin(games["end"], (DEAD, TIMEOUT)).all()


def test_a_level_is_the_same_map_alone_and_among_others() -> None:
    ((records, _),) = play_jobs([Job(LEVELS, CONFIG, "nearest", SEEDS)])
    assert len(set(records["spawned"])) > 1  # several houses
    for k in (0, 5):
        alone, _ = play(round_map(LEVELS, CONFIG, SEEDS[k]), CONFIG, "nearest", SEEDS[k : k + 1])
        for name in ("seed", "end", "collected", "time_s"):
            np.testing.assert_array_equal(alone[name], records[name][k : k + 1])


def test_levels_stay_prepared_whatever_the_speed() -> None:
    fast = CONFIG.with_fields(**{"clyde.speed_mps": 0.5})
    level = level_source(LEVELS, CONFIG).first
    number = int(level_source(LEVELS, CONFIG).levels_of(SEEDS[:1])[0])
    assert level_source(LEVELS, CONFIG).prepare(number) is level_source(LEVELS, fast).prepare(number)
    wider = CONFIG.with_fields(**{"pellets.spacing_m": 2.0})
    assert level_source(LEVELS, wider).first.pellets != level.pellets


def test_two_processes_give_the_records_of_one() -> None:
    ended: list[int] = []
    jobs = [
        Job(HOUSE, CONFIG, "nearest", SEEDS[:6]),
        Job(HOUSE, CONFIG.with_fields(endless=True), "random", SEEDS[:3]),
    ]
    one, two = play_jobs(jobs), play_jobs(jobs, workers=2, on_end=ended.append)
    for (first, _), (second, _) in zip(one, two, strict=True):
        np.testing.assert_array_equal(first, second)
    assert ended == [3, 3, 2, 1]
