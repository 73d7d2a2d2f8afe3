from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.evaluation.checks.planner_answers import (
    Pair,
    clearances_m,
    compare,
    distances_m,
    length_m,
    our_path,
    read_answers,
    resampled,
)
from pacman_env.evaluation.checks.validation import main
from pacman_env.world.maps.occupancy import OccupancyMap, load_map
from pacman_env.world.navigation.grid import DriveGrid, build_grid

GOLDEN = Path(__file__).parent / "golden"
#: Answers of Nav2 1.3.13's NavFn with the experiment's inflation, and with that of config/nav2.yaml.
ANSWERS = [GOLDEN / "navfn_experiment.json", GOLDEN / "navfn_nav2_yaml.json"]


def room(width_m: float = 4.0, height_m: float = 3.0) -> DriveGrid:
    """An empty room with its lower left corner at (0, 0)."""
    pixels = np.zeros((round(height_m / 0.05) + 4, round(width_m / 0.05) + 4), dtype=np.uint8)
    pixels[2:-2, 2:-2] = 254
    occupancy = OccupancyMap.from_pixels("room", pixels, 0.05, (-0.1, -0.1, 0.0))
    config = make_config("robot", home=(1.0, 1.0, 0.0))
    return build_grid(occupancy, config.robot, config.nav2, config.pellets, config.home)


def a_path(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points)


@pytest.mark.parametrize("answers", ANSWERS, ids=lambda path: path.stem)
def test_paths_stay_close_to_paths_of_nav2_planner(answers: Path) -> None:
    """The bounds are what was measured in thousands of pairs (docs/validation.md), and a little more."""
    result = compare(answers)
    assert list(result) == ["house", "loop", "maze", "open_plan"]
    for name, f in result.items():
        assert f["pairs"] == 32, name
        assert f["only_theirs"] == 0, name  # wherever NavFn has a path, we have one
        assert f["only_ours"] <= 3, name  # NavFn loses its way along its own gradient now and then
        assert 0.95 <= f["length_ratio"] <= 1.01, (name, f)
        assert 0.90 <= f["length_ratio_5"] <= f["length_ratio_95"] <= 1.04, (name, f)
        assert f["apart_m"] <= 0.14, (name, f)
        assert f["another_way"] <= 0.13, (name, f)
        assert abs(f["clearance_m"] - f["clearance_theirs_m"]) <= 0.03, (name, f)


def test_paths_end_alike_near_unreachable_goals() -> None:
    for path in ANSWERS:
        _, config, maps = read_answers(path)
        tolerance = config.nav2.unreachable_tolerance_m
        ended = 0
        for name, answers in maps.items():
            grid = build_grid(load_map(name), config.robot, config.nav2, config.pellets)
            fields = grid.path_fields()
            for answer in answers:
                goal = np.array(answer["goal"])
                if grid.cells_under(goal[None])[0] >= 0 or not answer["path"]:
                    continue
                ours = our_path(grid, fields, np.array(answer["start"]), goal, tolerance)
                assert ours is not None
                off, their_off = (float(np.hypot(*(end - goal))) for end in (ours[-1], answer["path"][-1]))
                assert abs(off - their_off) <= 0.08, (name, goal)  # both search cells, half a cell apart
                ended += 1
        assert ended >= 12


def test_path_in_open_room_is_straight() -> None:
    grid = room()
    path = our_path(grid, grid.path_fields(), np.array([1.0, 1.0]), np.array([3.0, 1.0]), 0.5)
    assert path is not None
    assert length_m(path) == pytest.approx(2.0, abs=0.06)
    np.testing.assert_allclose(path[-1], (3.0, 1.0))
    assert our_path(grid, grid.path_fields(), np.array([1.0, 1.0]), np.array([9.0, 1.0]), 0.5) is None


def test_distances_are_measured_to_nearest_polyline_point() -> None:
    corner = a_path((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    np.testing.assert_allclose(distances_m(a_path((0.5, 0.2), (2.0, 1.0), (-1.0, 0.0)), corner), (0.2, 1.0, 1.0))
    assert length_m(corner) == 2.0
    points = resampled(corner)
    assert np.hypot(*np.diff(points, axis=0).T).max() <= 0.02 + 1e-9
    beside = Pair(corner, corner + np.array((0.0, 0.1)))
    assert beside.apart_m().max() == pytest.approx(0.1)


def test_clearance_is_interpolated_between_cells() -> None:
    grid = room()
    along = clearances_m(grid, a_path((1.3, 1.0), (2.7, 1.0)))
    np.testing.assert_allclose(along, 1.025, atol=1e-6)  # the wall's first cells have their centres at -0.025
    towards = clearances_m(grid, a_path((2.0, 0.2), (2.0, 1.2)))
    assert (np.diff(towards) > 0.0).all()


def test_command_prints_row_for_each_map(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["--planner-answers", str(ANSWERS[0]), "--markdown", str(tmp_path / "table.md")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "NavFn of nav2_navfn_planner 1.3.13" in lines[0]
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["house", "loop", "maze", "open_plan"]
    assert (tmp_path / "table.md").read_text().splitlines() == lines
