from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacman_env.config import make_config, parse_settings
from pacman_env.world.maps.map_check import MapReport, check_map
from pacman_env.world.maps.occupancy import OccupancyMap

NO_PELLETS = (np.zeros((0, 2)), np.zeros(0, np.int64))
RADIUS_M = 0.15
CONFIG = make_config(**{"robot.inscribed_radius_m": RADIUS_M, "robot.radius_m": RADIUS_M})
PICKUP_M = CONFIG.execution.pickup_radius_m


def picture(*lines: str, yaw: float = 0.0, **changes: object) -> OccupancyMap:
    """``.`` free, ``#`` occupied, ``?`` unknown; cells of 0.1 m, origin (0, 0)."""
    grey = {".": 254, "#": 0, "?": 205, "2": 220}
    pixels = np.array([[grey[c] for c in line] for line in lines], np.uint8)
    return OccupancyMap.from_pixels("picture", pixels, 0.1, (0.0, 0.0, yaw), **changes)  # type: ignore[arg-type]


def check(m: OccupancyMap, *cells: tuple[int, int], home: tuple[int, int] | None, free_grey: str = "250") -> MapReport:
    """Pellets and home given as (column, row); pellets lie on the cell's upper left corner as in the game."""
    corners = np.array([m.cell_to_world(c - 0.5, r - 0.5) for c, r in cells], dtype=float).reshape(-1, 2)
    start = None if home is None else tuple(float(v) for v in m.cell_to_world(*home))
    ids = np.arange(len(cells))
    config = CONFIG.with_fields(**parse_settings([f"pellets.free_grey={free_grey}"]))
    return check_map(m, corners, ids, config, home=start)  # type: ignore[arg-type]


def warnings_with(report: MapReport, words: str) -> list[str]:
    return [w for w in report.warnings if words in w]


def two_rooms(door: str) -> OccupancyMap:
    """Rooms of 5 x 5 cells; ``door`` is the wall column between them."""
    rows = [f"#.....{d}.....#" for d in door]
    return picture("#" * 13, *rows, "#" * 13)


def test_areas_count_cells_by_each_rule() -> None:
    report = check(picture("#####", "#.2?#", "#####"), home=None)
    assert report.game_free_m2 == pytest.approx(0.01)
    assert report.nav2_free_m2 == pytest.approx(0.02)  # 220 is bright enough for Nav2, 205 is not
    assert (report.width, report.height, report.resolution) == (5, 3, 0.1)


def test_no_step_over_a_corner_joins_parts_and_specks_are_not_counted() -> None:
    rows = [
        "#" * 12,
        "#....#....##",
        "#....#....##",
        "#....#....##",
        "#####.######",
        "#" * 12,
        "##........##",
        "#" * 12,
    ]
    report = check(picture(*rows), home=None)
    assert report.parts == 2  # a cell joins the rooms over two corners; 8 cells are below 0.1 m2
    assert report.largest_part_m2 == pytest.approx(0.12)


def test_a_pellet_behind_a_door_is_reachable_if_the_robot_fits_through() -> None:
    # a door of n cells has its middle (n + 1) / 2 cells from the wall's cells: 2 -> 0.1 m, 3 -> 0.2 m
    narrow, wide = two_rooms("##.." + "#"), two_rooms("#..." + "#")
    assert check(narrow, (3, 3), (9, 3), home=(3, 3)).unreachable == (1,)
    assert check(wide, (3, 3), (9, 3), home=(3, 3)).unreachable == ()
    assert check(narrow, (3, 3), (9, 3), home=(9, 3)).unreachable == (0,)


def test_beyond_the_image_nothing_is_free() -> None:
    assert check(picture("...", "...", "..."), (1, 1), home=(1, 1)).home == pytest.approx((0.15, 0.15))
    assert check(picture("..", ".."), (1, 1), home=(1, 1)).home is None  # all cells are 0.1 m from one outside


def test_unreachable_pellets_are_listed_in_a_warning() -> None:
    report = check(two_rooms("#####"), (3, 3), (9, 3), (8, 3), home=(3, 3))
    assert warnings_with(report, "2 of 3 pellets are unreachable from home: 1, 2")
    assert [(p.id, p.reachable) for p in report.pellets] == [(0, True), (1, False), (2, False)]


@pytest.mark.parametrize("home", [(0, 0), (1, 1), (-5, 3), (400, 3)])
def test_a_home_where_the_robot_cannot_stand_is_replaced_by_the_widest_place(home: tuple[int, int]) -> None:
    rows = ["#" * 17, *["#.....#.........#"] * 5, "#" * 17]
    report = check(picture(*rows), (3, 3), (11, 3), home=home)
    assert warnings_with(report, "the widest place of the largest part is used")
    assert report.home == pytest.approx((0.95, 0.35))  # first of the middle row of the right room
    assert report.unreachable == (0,)


def test_without_a_home_the_widest_place_is_used_and_nobody_warned() -> None:
    report = check(picture("#####", "#...#", "#...#", "#...#", "#####"), home=None)
    assert report.home == pytest.approx((0.25, 0.25))
    assert not warnings_with(report, "home")


@pytest.mark.parametrize("rows", [("###", "#.#", "###"), ("###", "###", "###")])
def test_where_the_robot_fits_nowhere_there_is_no_home(rows: tuple[str, ...]) -> None:
    report = check(picture(*rows), (1, 1), home=(1, 1))
    assert report.home is None
    assert report.unreachable == (0,)
    assert warnings_with(report, "nor is any place")
    assert "home           none" in report.render()


def test_a_clean_map_has_no_warnings() -> None:
    report = check(picture("#####", "#...#", "#...#", "#...#", "#####"), (2, 2), home=(2, 2))
    assert report.warnings == ()


@pytest.mark.parametrize(
    ("m", "words"),
    [
        (picture("#####", "#.22#", "#####"), "pellets.free_grey=219"),
        (picture("#####", "#.??#", "#####", free_thresh=0.25), "unknown loads as free"),
        (picture("#####", "#...#", "#####", mode="raw"), "free to the game, but not to Nav2"),
        (picture("#####", "#...#", "#####", free_thresh=0.65), "free_thresh 0.65 is not below"),
        (picture("#####", "#...#", "#####", yaw=0.5), "turned by 0.5 rad"),
        (picture("#####", "#....", "#####"), "touches the image border"),
        (picture("#####", "#...#", "#..##"), "touches the image border"),
        (picture("#####", "#...#", "#####"), "no pellets"),
    ],
)
def test_what_is_odd_about_a_map_is_said(m: OccupancyMap, words: str) -> None:
    assert warnings_with(check(m, home=None), words)


@pytest.mark.parametrize("free_thresh", [0.196, 0.25])
def test_remedy_for_pale_free_cells_works(free_thresh: float) -> None:
    """Cartographer's free cells are grey; unknown ones (205) are free to Nav2 if free_thresh is 0.25."""
    m = picture("??????????", "?########?", *["?#222222#?"] * 5, "?########?", "??????????", free_thresh=free_thresh)
    pale = check(m, (5, 4), home=None)
    assert pale.home is None
    assert bool(warnings_with(pale, "free_thresh to 0.196")) is (free_thresh > 0.196)
    (warning,) = warnings_with(pale, "pellets.free_grey=")
    number = warning.partition("pellets.free_grey=")[2].partition(";")[0]
    remedied = check(m, (5, 4), home=None, free_grey=number)
    assert remedied.home is not None
    assert remedied.unreachable == ()
    assert not warnings_with(remedied, "pellets.free_grey=")


def test_a_few_unsure_pixels_are_no_reason_to_warn() -> None:
    rows = ["#" * 20, *["#" + "." * 18 + "#"] * 8, "#." + "2" + "." * 16 + "#", "#" * 20]
    assert not warnings_with(check(picture(*rows), home=None), "unknown loads as free")


@given(
    cells=st.lists(st.tuples(st.integers(0, 12), st.integers(0, 6)), max_size=6),
    yaw=st.floats(-math.pi, math.pi),
)
@settings(max_examples=40)
def test_turning_the_map_frame_changes_no_answer(cells: list[tuple[int, int]], yaw: float) -> None:
    straight = two_rooms("##..#")
    turned = OccupancyMap.from_pixels("turned", straight.grey, 0.1, (3.0, -2.0, yaw))
    assert check(turned, *cells, home=(3, 3)).unreachable == check(straight, *cells, home=(3, 3)).unreachable


def test_a_pellet_is_reachable_if_the_robot_comes_as_near_as_it_collects_from() -> None:
    m = picture("#" * 11, *["#" + "." * 9 + "#"] * 9, "#" * 11)  # the robot's centre stays two cells off the wall
    report = check(m, *((c, 5) for c in range(5)), home=(5, 5))
    assert report.unreachable == (0,)  # its pellet is 0.25 m and more from the nearest centre; the wall's, 0.15 m
    config = CONFIG.with_fields(**{"execution.pickup_radius_m": 0.1})
    places, ids = np.array([[p.x, p.y] for p in report.pellets]), np.arange(5)
    assert check_map(m, places, ids, config, home=(0.55, 0.55)).unreachable == (0, 1)


def test_the_robot_does_not_drive_over_a_corner() -> None:
    rooms = ["#" * 14, *["#......#######"] * 6, *["#######......#"] * 6, "#" * 14]
    report = check(picture(*rooms), (3, 3), (10, 10), home=(3, 3))
    assert report.unreachable == (1,)


def flood(free: NDArray[np.bool_], start: tuple[int, int]) -> set[tuple[int, int]]:
    """(row, column) reached from start over cells 0.15 m or more from what is not free; the slow way."""
    height, width = free.shape
    walls = [(r, c) for r in range(-1, height + 1) for c in range(-1, width + 1)]
    walls = [(r, c) for r, c in walls if not (0 <= r < height and 0 <= c < width and free[r, c])]

    def fits(r: int, c: int) -> bool:
        return all(math.hypot(r - wr, c - wc) * 0.1 > RADIUS_M for wr, wc in walls)

    found, edge = set(), [start] if fits(*start) else []
    while edge:
        r, c = edge.pop()
        if (r, c) not in found and fits(r, c):
            found.add((r, c))
            edge += [(r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)]  # a diagonal step cuts a corner
    return found


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_reachable_is_what_a_flood_fill_reaches(seed: int) -> None:
    free = np.random.default_rng(seed).random((9, 9)) < 0.93
    m = OccupancyMap.from_pixels("m", np.where(free, 254, 0).astype(np.uint8), 0.1, (0.0, 0.0, 0.0))
    cells = [(c, r) for r in range(9) for c in range(9)]
    report = check(m, *cells, home=(4, 4))
    reached = {(r, c) for p, (c, r) in zip(report.pellets, cells, strict=True) if p.reachable}
    centres = flood(free, (4, 4))
    if centres:  # pellets lie on the corner of their cell
        assert reached == {
            (r, c) for c, r in cells if min(math.hypot(r - 0.5 - i, c - 0.5 - j) for i, j in centres) * 0.1 <= PICKUP_M
        }
    else:
        assert report.home is None or warnings_with(report, "is not free for the robot")


def test_the_report_is_plain_data_and_plain_text() -> None:
    report = check(two_rooms("#####"), (3, 3), (9, 3), home=(3, 3))
    data = json.loads(json.dumps(report.as_dict()))
    assert data["pellets"][1] == {
        "id": 1,
        "x": pytest.approx(0.9),
        "y": pytest.approx(0.4),
        "reachable": False,
    }
    assert data["home"] == pytest.approx([0.35, 0.35])
    text = report.render()
    assert "13 x 7 px, 0.1 m per px" in text
    assert "pellets        2, 1 of them unreachable" in text
    assert "    1  (0.90, 0.40)  unreachable" in text
    assert text.isascii()


def test_ids_and_places_must_match() -> None:
    with pytest.raises(ValueError, match="shorter"):
        check_map(two_rooms("#####"), np.zeros((1, 2)), np.arange(2), CONFIG)
