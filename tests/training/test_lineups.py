"""Line-ups are read strictly, each has its share of the sub-batches, and its teacher is the rule for such ghosts."""

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.heuristics.search.search import Search
from pacman_env.training.lineups import checked, make_teacher, read, searches, sub_batches

EIGHT = ["wander", "wander", "wander,wander", "arcade", "chase", "arcade,chase", "wander,arcade,chase,wander", "chase"]


def test_spaces_are_removed_from_lineup() -> None:
    assert checked(" arcade, chase", "ghosts[0]") == "arcade,chase"
    assert read("wander,arcade").behaviours == ("wander", "arcade")


def test_lineup_accepts_speed_range() -> None:
    assert checked("arcade, learned@ 0.1 - 0.3", "ghosts[0]") == "arcade,learned@0.1-0.3"
    assert read("arcade,learned@0.1-0.3").behaviours == ("arcade", "learned")
    assert read("arcade,learned@0.1-0.3").speeds_mps == (0.1, 0.3)
    assert read("arcade").speeds_mps is None


@pytest.mark.parametrize(
    ("lineup", "message"),
    [
        ("", r"ghosts\[2\] = '': must be behaviours"),
        ("wander,", r"ghosts\[2\] = 'wander,': must be behaviours"),
        ("wander,hunt", r"ghosts\[2\] = 'wander,hunt': unknown ghost behaviour 'hunt'"),
        ("chase@", r"ghosts\[2\] = 'chase@': lowest and highest speed"),
        ("chase@0.3-0.1", r"ghosts\[2\] = 'chase@0.3-0.1': lowest and highest"),
        ("chase@0.1", r"ghosts\[2\] = 'chase@0.1': lowest and highest"),
        ("chase@0.1-x", r"ghosts\[2\] = 'chase@0.1-x': lowest and highest"),
        ("chase@0.1-inf", r"ghosts\[2\] = 'chase@0.1-inf': lowest and highest"),
        ("policy", r"ghosts\[2\] = 'policy': 'policy' is for a ghost that is sent from outside"),
        ("chase,chase,chase,chase,chase", r"ghosts\[2\] = 'chase,.*': must be at most 4 behaviours"),
    ],
)
def test_invalid_lineup_is_refused_with_reason(lineup: str, message: str) -> None:
    with pytest.raises(ValueError, match=rf"^{message}[^\n]*$"):
        checked(lineup, "ghosts[2]")


@pytest.mark.parametrize(
    ("ghosts", "games", "levels", "copies"),
    [
        (["wander", "chase"], 8, 8, 2),
        (["wander", "chase"], 6, 8, 1),  # 6 games are not shared by 4
        (["wander", "chase"], 8, 3, 1),  # 3 levels are not shared by 4
        (["wander", "wander", "arcade"], 12, 12, 2),
        (EIGHT, 16, 8, 1),
    ],
)
def test_every_lineup_gets_its_share_of_sub_batches(ghosts: list[str], games: int, levels: int, copies: int) -> None:
    assert sorted(sub_batches(ghosts, games, levels)) == sorted(ghosts * copies)


def test_both_halves_contain_equally_many_ghosts_and_searches() -> None:
    found = sub_batches(EIGHT, 256, 128)
    first, last = found[:4], found[4:]
    assert sum(map(searches, first)) - sum(map(searches, last)) in (-1, 0, 1)
    assert abs(sum(len(read(one).behaviours) for one in first) - sum(len(read(one).behaviours) for one in last)) <= 2
    assert sub_batches(["chase", "wander", "arcade"], 3, 3) == ["wander", "arcade", "chase"]


def test_teacher_searches_unless_every_ghost_wanders() -> None:
    named = {"wander": "lookahead", "wander,wander": "lookahead", "arcade": "search", "wander,chase": "search"}
    assert {lineup: make_teacher(lineup, 300).name for lineup in named} == named
    teacher = make_teacher("wander,chase", 300)
    assert isinstance(teacher, Search)
    assert (teacher.parameters.nodes, teacher.parameters.samples, teacher.base.name) == (300, 1, "lookahead")
