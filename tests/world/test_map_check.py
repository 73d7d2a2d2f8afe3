import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacman_env.config import PelletConfig, make_config, parse_settings
from pacman_env.game.pellets import PelletSet, generate_pellets
from pacman_env.world.map_check import MapReport, check_map
from pacman_env.world.maps.occupancy import OccupancyMap, load_map
from tests.shared import SHARED, shared_path

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


def test_areas_are_counted_by_each_rule() -> None:
    report = check(picture("#####", "#.2?#", "#####"), home=None)
    assert report.game_free_m2 == pytest.approx(0.01)
    assert report.nav2_free_m2 == pytest.approx(0.02)  # 220 is bright enough for Nav2, 205 is not
    assert (report.width, report.height, report.resolution) == (5, 3, 0.1)


def test_parts_exclude_corners_and_specks() -> None:
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


def test_nothing_is_free_beyond_the_image() -> None:
    assert check(picture("...", "...", "..."), (1, 1), home=(1, 1)).home == pytest.approx((0.15, 0.15))
    assert check(picture("..", ".."), (1, 1), home=(1, 1)).home is None  # all cells are 0.1 m from one outside


def test_unreachable_pellets_are_warned_of() -> None:
    report = check(two_rooms("#####"), (3, 3), (9, 3), (8, 3), home=(3, 3))
    assert warnings_with(report, "2 of 3 pellets are unreachable from home: 1, 2")
    assert [(p.id, p.reachable) for p in report.pellets] == [(0, True), (1, False), (2, False)]


@pytest.mark.parametrize("home", [None, (0, 0), (1, 1), (-5, 3), (400, 3)])
def test_absent_or_impossible_home_becomes_the_widest_place(home: tuple[int, int] | None) -> None:
    rows = ["#" * 17, *["#.....#.........#"] * 5, "#" * 17]
    report = check(picture(*rows), (3, 3), (11, 3), home=home)
    assert bool(warnings_with(report, "the widest place of the largest part is used")) == (home is not None)
    assert report.home == pytest.approx((0.95, 0.35))  # first of the middle row of the right room
    assert report.unreachable == (0,)


def test_good_map_causes_no_warning() -> None:
    assert check(picture("#####", "#...#", "#...#", "#...#", "#####"), (2, 2), home=(2, 2)).warnings == ()


@pytest.mark.parametrize("rows", [("###", "#.#", "###"), ("###", "###", "###")])
def test_narrow_map_has_no_home(rows: tuple[str, ...]) -> None:
    report = check(picture(*rows), (1, 1), home=(1, 1))
    assert report.home is None
    assert report.unreachable == (0,)
    assert warnings_with(report, "nor is any place")


@pytest.mark.parametrize(
    ("m", "words"),
    [
        (picture("#####", "#.22#", "#####"), "pellets.free_grey=219"),
        (picture("#####", "#.??#", "#####", free_thresh=0.25), "unknown loads as free"),
        (picture("#####", "#...#", "#####", mode="raw"), "free to the game, but not to Nav2"),
        (picture("#####", "#...#", "#####", free_thresh=0.65), "free_thresh 0.65 is not below"),
        (picture("#####", "#...#", "#####", yaw=0.5), "pacman-env map turn MAP.yaml"),
        (picture("#####", "#....", "#####"), "touches the image border"),
        (picture("#####", "#...#", "#####"), "no pellets"),
    ],
)
def test_oddities_of_a_map_are_warned_of(m: OccupancyMap, words: str) -> None:
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


def test_few_unsure_pixels_cause_no_warning() -> None:
    rows = ["#" * 20, *["#" + "." * 18 + "#"] * 8, "#." + "2" + "." * 16 + "#", "#" * 20]
    assert not warnings_with(check(picture(*rows), home=None), "unknown loads as free")


@given(cells=st.lists(st.tuples(st.integers(0, 12), st.integers(0, 6)), max_size=6), yaw=st.floats(-math.pi, math.pi))
@settings(max_examples=40)
def test_turned_map_frame_changes_no_answer(cells: list[tuple[int, int]], yaw: float) -> None:
    straight = two_rooms("##..#")
    turned = OccupancyMap.from_pixels("turned", straight.grey, 0.1, (3.0, -2.0, yaw))
    assert check(turned, *cells, home=(3, 3)).unreachable == check(straight, *cells, home=(3, 3)).unreachable


def test_pellet_within_pick_up_radius_is_reachable() -> None:
    m = picture("#" * 11, *["#" + "." * 9 + "#"] * 9, "#" * 11)  # the robot's centre stays two cells off the wall
    report = check(m, *((c, 5) for c in range(5)), home=(5, 5))
    assert report.unreachable == (0,)  # its pellet is 0.25 m and more from the nearest centre; the wall's, 0.15 m
    config = CONFIG.with_fields(**{"execution.pickup_radius_m": 0.1})
    places, ids = np.array([[p.x, p.y] for p in report.pellets]), np.arange(5)
    assert check_map(m, places, ids, config, home=(0.55, 0.55)).unreachable == (0, 1)


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
def test_reachable_pellets_are_those_of_flood_fill(seed: int) -> None:
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


def test_report_is_plain_data_and_text() -> None:
    report = check(two_rooms("#####"), (3, 3), (9, 3), home=(3, 3))
    data = json.loads(json.dumps(dataclasses.asdict(report)))
    assert data["pellets"][1] == {"id": 1, "x": pytest.approx(0.9), "y": pytest.approx(0.4), "reachable": False}
    assert data["home"] == pytest.approx([0.35, 0.35])
    assert "unreachable" in report.render()
    with pytest.raises(ValueError, match="shorter"):  # ids and places
        check_map(two_rooms("#####"), np.zeros((1, 2)), np.arange(2), CONFIG)


# Real maps


def published() -> list[dict[str, str]]:
    index = SHARED / "maps/INDEX.md"
    lines = [x for x in index.read_text().splitlines() if x.startswith("|")] if index.exists() else []
    cells = [[c.strip() for c in x.strip("|").split("|")] for x in lines]
    return [dict(zip(cells[0], r, strict=True)) for r in cells[2:]]


@pytest.mark.parametrize("suffix", ["png", "pgm", "bmp"])
def test_nav2_test_map_gives_its_grid(tmp_path: Path, suffix: str) -> None:
    folder = shared_path("maps/nav2_testmap")
    keys = yaml.safe_load((folder / "map.yaml").read_text())
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(keys | {"image": str(folder / f"testmap.{suffix}")}))
    m = load_map(path)
    bottom_up = ["." * 10] + ["####..###."] * 2 + ["#........."] * 2 + ["#.....##.."] * 4 + ["#........."]
    expected = [[100 if c == "#" else 0 for c in line] for line in reversed(bottom_up)]
    assert m.occupancy.tolist() == expected
    assert (m.resolution, m.origin) == (0.1, (2.0, 3.0, 1.0))


def pellets_of(m: OccupancyMap, spacing_m: float = 2.0) -> PelletSet:
    return generate_pellets(m, PelletConfig(spacing_m=spacing_m))


def report_on(name: str) -> MapReport:
    m = load_map(shared_path(f"maps/{name}"))
    pellets = pellets_of(m)
    return check_map(m, pellets.position, pellets.ids, make_config())


@pytest.mark.parametrize("entry", published() or [{"name": "pacmanbot_house"}], ids=lambda e: e["name"])
def test_real_map_has_published_size_and_areas(entry: dict[str, str]) -> None:
    m = load_map(shared_path(f"maps/{entry['name']}"))
    assert m.name == entry["name"]
    assert f"{m.width}x{m.height}" == entry["px"]
    assert m.resolution == float(entry["res m"])
    report = report_on(entry["name"])
    expected = entry["U->F"] == "yes" or "loads the outside as FREE" in entry["remarks"]
    assert any("unknown loads as free" in w for w in report.warnings) is expected
    assert report.game_free_m2 == pytest.approx(float(entry["free>250 m2"]), abs=0.1)
    assert report.nav2_free_m2 == pytest.approx(float(entry["nav2 m2"]), abs=0.1)
    assert [len(pellets_of(m, spacing_m)) for spacing_m in (2.0, 1.0)] == [*map(int, entry["pellets"].split("/"))]
    assert len(report.pellets) == len(pellets_of(m))


def test_reachable_pellets_of_real_maps() -> None:
    report = report_on("pacmanbot_house")
    assert report.home == (0.0, 0.0)
    assert report.unreachable == ()
    far = [pellet.id for pellet in report.pellets if math.dist((pellet.x, pellet.y), (7.84, -1.69)) < 0.01]
    assert len(far) == 1
    report = report_on("pepper_apartment_elevator")  # behind a gap that is too narrow
    assert len(report.pellets) - len(report.unreachable) == 25
