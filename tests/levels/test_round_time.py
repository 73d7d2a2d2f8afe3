import re

import pytest

from pacman_env.config import make_config
from pacman_env.levels.assets import map_assets
from pacman_env.levels.round_time import time_warning
from pacman_env.world.maps.occupancy import shipped_maps
from tests.shared import shared_path

#: Real maps on which most rounds are completed (docs/model_card.md).
PLAYABLE = ("irl_lab", "aws_small_house", "pacmanbot_house", "ipa_kitchen", "mh_amcl_lab", "irl_aws_house")
PLAYABLE += ("f1tenth_levine", "ecn_amphiE", "elsabot_upstairs", "ecn_batS", "tb4_maze")


def warning(source: str, **settings: object) -> str | None:
    config = make_config("robot", **settings)
    return time_warning(map_assets(source, config), config)


@pytest.mark.parametrize("name", shipped_maps())
def test_shipped_map_has_time_for_its_pellets(name: str) -> None:
    assert warning(name) is None
    assert warning(name, **{"robot.speed_mps": 0.05}) is not None


@pytest.mark.parametrize("name", PLAYABLE)
def test_playable_real_map_has_time_for_its_pellets(name: str) -> None:
    assert warning(str(shared_path(f"maps/{name}"))) is None


def test_large_map_is_warned_of_with_useful_settings() -> None:
    source = str(shared_path("maps/nav2_depot"))
    text = warning(source)
    assert text is not None
    longer, also = (float(number) for number in re.findall(r"time_limit_s=(\d+)", text))
    (spacing,) = re.findall(r"pellets\.spacing_m=([\d.]+)", text)
    assert warning(source, time_limit_s=longer) is None
    assert warning(source, time_limit_s=also, **{"pellets.spacing_m": float(spacing)}) is None
