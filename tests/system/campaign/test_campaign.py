"""The campaign's command as far as it needs no ROS; that it plays is tested with the nodes."""

from __future__ import annotations

import pytest

from tests.system.campaign.__main__ import main
from tests.system.campaign.results import Verdict, blocks, table
from tests.system.campaign.verdict import waits


def test_the_table_counts_each_game_under_everything_that_happened_in_it() -> None:
    verdicts = [
        Verdict(0, "house", "ppo", ["abort", "reject", "no markers"], "complete"),
        Verdict(1, "house", "ppo", ["abort", "abort"], "lost", violations=["a turn of 9 s", "hangs"]),
        Verdict(2, "house", "ppo", [], "reset"),
    ]
    rows = {line[:34].strip(): list(map(int, line[34:].split())) for line in table(verdicts)[1:]}
    assert rows["all games"] == [3, 1, 1, 1, 0, 0, 2]
    assert rows["nothing"] == [1, 0, 0, 1, 0, 0, 0]
    assert rows["abort"] == [2, 1, 1, 0, 0, 0, 2]
    assert rows["reject"] == rows["no markers"] == rows["several faults"] == [1, 1, 0, 0, 0, 0, 0]
    assert rows["pose_lost"] == [0] * 7


@pytest.mark.parametrize(
    ("state", "pursued", "clyde_moved_m", "waiting"),
    [
        ("running", -1, 0.0, True),
        ("running", -1, 1.9, True),
        ("running", -1, 2.0, False),
        ("running", 3, 0.0, False),
        ("returning_home", -1, 0.0, False),
    ],
)
def test_a_planner_that_holds_waits_for_a_clyde_that_stays_and_for_no_other(
    state: str, pursued: int, clyde_moved_m: float, waiting: bool
) -> None:
    assert waits(state, {"pursued": pursued}, clyde_moved_m) == waiting
    assert not waits(state, {}, clyde_moved_m)


def test_a_row_names_seed_outcome_and_faults() -> None:
    line = Verdict(7, "loop, 3 m", "random", ["abort", "start"], "lost", 99.0, transcript="0123456789ab").line()
    assert line.split() == [
        "7",
        "loop,",
        "3",
        "m",
        "random",
        "lost",
        "99",
        "01234567",
        "abort;",
        "1",
        "interferences",
    ]


def test_the_same_nodes_play_the_seeds_of_ten() -> None:
    assert list(blocks([19, 3, 10, 7, 30])) == [[3, 7], [10, 19], [30]]


@pytest.mark.parametrize("arguments", [["--games", "0"], ["--only", "x"], ["--jobs", "0"], ["--speed", "10"]])
def test_bad_arguments_are_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    assert exit_info.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
