from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from pacman_env.evaluation.compare.plot import save_plot
from pacman_env.evaluation.compare.text_table import group_title, render, verdict
from pacman_env.evaluation.rounds.summary import Row, make_row
from tests.evaluation.helpers import FIVE, OTHER_FIVE


def rows(
    policies: tuple[str, str] = ("clyde_aware", "nearest"), speed: float = 0.25, endless: bool = False
) -> list[Row]:
    abouts = [{"map": "home", "policy": policy, "clyde_speed": speed} for policy in policies]
    times = np.array([0.5])
    first = make_row(abouts[0], [(FIVE, times)], endless=endless)
    return [first, make_row(abouts[1], [(OTHER_FIVE, times)], [FIVE], endless=endless)]


def test_table_row_contains_every_number() -> None:
    title, header, first, second = render(rows()).splitlines()[:4]
    assert title == "home: 8 pellets, Clyde at 0.25 m/s, 5 episodes"
    assert header.split("  ")[0] == "policy"
    assert first.split()[:4] == ["clyde_aware", "40.0", "[11.8,", "76.9]"]
    assert first.split()[4:7] == ["60.0", "[23.1,", "88.2]"]
    assert first.split()[7:] == ["5.00", "20.0", "20.0", "20.0", "30.0", "0.500", "0.500", "-"]
    assert second.split()[-3] == "-20.0"
    assert len(header) == len(first) == len(second)


@pytest.mark.parametrize("endless", [False, True])
def test_table_fits_a_terminal_of_80_columns(endless: bool) -> None:
    wide, narrow = render(rows(endless=endless)).splitlines(), render(rows(endless=endless), 80).splitlines()
    assert max(map(len, narrow)) <= 80
    for k in range(2, 4):  # the policies' lines
        parts = [line.split() for line in narrow if line.startswith(wide[k].split()[0])]
        assert [parts[0][0], *(word for part in parts for word in part[1:])] == wide[k].split()


def test_table_has_one_block_for_each_speed() -> None:
    text = render(rows() + rows(speed=0.4))
    assert text.count("policy  ") == 2
    assert "Clyde at 0.4 m/s" in text


def test_table_explains_compared_policy_and_shortens_long_names() -> None:
    text = render(rows(("runs/" + "x" * 200 + "/best.onnx", "nearest")))
    assert max(map(len, text.splitlines())) <= 140
    assert "best.onnx" in text
    assert "minus that of clyde_aware" in render(rows()).replace("\n", " ")


@pytest.mark.parametrize(
    ("interval", "expected"),
    [
        ([0.1, 0.3], "Completes more than clyde_aware: nearest (+20.0 points)."),
        ([-0.3, -0.1], "Completes less than clyde_aware: nearest (-20.0 points)."),
        ([-0.1, 0.3], "No difference shown: nearest."),
    ],
)
def test_verdict_names_better_and_worse_policies(interval: list[float], expected: str) -> None:
    first, second = rows()
    second |= {"paired_difference": 0.2 if interval[1] > 0 else -0.2, "paired_ci": interval}
    assert verdict([first, second]) == expected
    assert verdict([first]) == ""


def test_endless_games_have_their_own_columns() -> None:
    text = render(rows(endless=True))
    title, header, first, second = text.splitlines()[:4]
    assert title == "home: 8 pellets, Clyde at 0.25 m/s, 5 endless games"
    words = "policy pellets per game median rounds most caught cleared time limit time s p50 ms p99 ms difference"
    assert " ".join(header.split()) == words
    assert first.split()[:2] == ["clyde_aware", "5.0"]
    assert first.split()[4:] == ["7", "0.00", "0", "20.0", "20.0", "20.0", "30.0", "0.500", "0.500", "-"]
    assert second.split()[-3] == "-2.6"
    assert len(header) == len(first) == len(second)


@pytest.mark.parametrize("endless", [False, True])
def test_power_pellets_add_a_column_of_caught_ghosts(endless: bool) -> None:
    first, second = rows(endless=endless)
    first |= {"ghosts_caught_mean": 1.4, "ghosts_caught_ci": [0.9, 2.0]}
    plain, shown = (render([first, second], power=power).splitlines() for power in (False, True))
    assert " ghosts " not in plain[1]
    assert " ghosts " in shown[1]
    assert "  1.4 [0.9, 2.0]  " in shown[2]
    assert len(shown[1]) == len(shown[2]) == len(shown[3])


def test_title_of_levels_shows_number_and_pellet_range() -> None:
    row = rows()[0] | {"levels": 31, "pellets_least": 4}
    assert group_title(row) == "home: 4 to 8 pellets on 31 levels, Clyde at 0.25 m/s, 5 episodes"


@pytest.mark.parametrize("endless", [False, True])
def test_plot_is_png_with_one_band_per_speed(tmp_path: Path, endless: bool) -> None:
    path, speeds = tmp_path / "plot.png", (0.25, 0.3, 0.35)
    save_plot([row for speed in speeds for row in rows(speed=speed, endless=endless)], path, "title")
    assert path.read_bytes().startswith(b"\x89PNG")
    image = imageio.imread(path)
    assert image.shape[1] > 1000
    assert image.shape[0] > 150 * (1 + len(speeds))
    assert image.std() > 10  # something is drawn
    assert list(tmp_path.iterdir()) == [path]
