from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pacman_env.config import make_config
from pacman_env.game.pellets import generate_pellets
from pacman_env.world.maps.map_check import MapReport, check_map
from pacman_env.world.maps.occupancy import load_map
from tests.shared import SHARED, shared_path


def published() -> list[dict[str, str]]:
    index = SHARED / "maps/INDEX.md"
    lines = [x for x in index.read_text().splitlines() if x.startswith("|")] if index.exists() else []
    cells = [[c.strip() for c in x.strip("|").split("|")] for x in lines]
    return [dict(zip(cells[0], r, strict=True)) for r in cells[2:]]


@pytest.mark.parametrize("entry", published() or [{"name": "pacmanbot_house"}], ids=lambda e: e["name"])
def test_a_real_map_has_the_published_size_and_areas(entry: dict[str, str]) -> None:
    m = load_map(shared_path(f"maps/{entry['name']}"))
    assert m.name == entry["name"]
    assert f"{m.width}x{m.height}" == entry["px"]
    assert m.resolution == float(entry["res m"])
    cell = m.resolution**2
    assert m.game_free().sum() * cell == pytest.approx(float(entry["free>250 m2"]), abs=0.1)
    assert (m.occupancy == 0).sum() * cell == pytest.approx(float(entry["nav2 m2"]), abs=0.1)


@pytest.mark.parametrize("suffix", ["png", "pgm", "bmp"])
def test_nav2s_own_test_map_gives_its_grid(tmp_path: Path, suffix: str) -> None:
    folder = shared_path("maps/nav2_testmap")
    keys = yaml.safe_load((folder / "map.yaml").read_text())
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(keys | {"image": str(folder / f"testmap.{suffix}")}))
    m = load_map(path)
    bottom_up = ["." * 10] + ["####..###."] * 2 + ["#........."] * 2 + ["#.....##.."] * 4 + ["#........."]
    expected = [[100 if c == "#" else 0 for c in line] for line in reversed(bottom_up)]
    assert m.occupancy.tolist() == expected
    assert (m.resolution, m.origin) == (0.1, (2.0, 3.0, 1.0))


def report_on(name: str) -> MapReport:
    m = load_map(shared_path(f"maps/{name}"))
    config = make_config()
    pellets = generate_pellets(m, config.pellets)
    return check_map(m, pellets.position, pellets.ids, config)


@pytest.mark.parametrize("entry", published() or [{"name": "pacmanbot_house"}], ids=lambda e: e["name"])
def test_the_check_warns_where_unknown_loads_as_free(entry: dict[str, str]) -> None:
    report = report_on(entry["name"])
    expected = entry["U->F"] == "yes" or "loads the outside as FREE" in entry["remarks"]
    assert any("unknown loads as free" in w for w in report.warnings) is expected
    assert report.game_free_m2 == pytest.approx(float(entry["free>250 m2"]), abs=0.1)
    assert report.nav2_free_m2 == pytest.approx(float(entry["nav2 m2"]), abs=0.1)
    assert len(report.pellets) == int(entry["pellets"].split("/")[0])


def test_every_pellet_of_the_experiments_house_is_reachable_from_its_home() -> None:
    report = report_on("pacmanbot_house")
    assert report.home == (0.0, 0.0)
    assert report.unreachable == ()
    far = np.array([[p.x, p.y] for p in report.pellets])
    assert np.isclose(far, (7.84, -1.69), rtol=0, atol=0.005).all(axis=1).any()


def test_pellets_behind_a_gap_too_narrow_for_the_robot_are_unreachable() -> None:
    report = report_on("pepper_apartment_elevator")
    assert len(report.pellets) - len(report.unreachable) == 25
