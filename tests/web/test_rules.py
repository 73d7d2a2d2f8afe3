"""What can be chosen on the page, and what is refused with which words."""

from pathlib import Path
from urllib.parse import parse_qs

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.levels.level_source import TEST_LEVEL
from pacman_env.web.game_interface import Refused
from pacman_env.web.page_messages import Setup
from pacman_env.web.rules import Choices, Rules
from pacman_env.world.maps.occupancy import OccupancyMap, load_map


def test_every_offered_choice_is_playable() -> None:
    choices = Choices()
    facts = choices.facts()
    for name in facts["maps"]:
        choices.prepare(Rules(map=name), 0.3)
    for setting in facts["settings"]:
        config, _, _ = choices.prepare(Rules(preset="ideal", settings={setting["name"]: setting["value"]}), None)
        assert config.value(setting["name"]) == setting["value"]
        assert setting["type"] in ("number", "integer", "bool", "choice", "text")
        assert setting["type"] != "choice" or setting["value"] in setting["options"]


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        (Rules(map="/etc/passwd"), "map '/etc/passwd': choose one of house, loop"),
        (Rules(policy="os:system"), "policy 'os:system': choose one of"),
        (Rules(second="nobody"), "policy 'nobody': choose one of"),
        (Rules(preset="dream"), "preset 'dream': choose one of"),
        (Rules(ghosts=("policy",)), "behaviour 'policy': choose one of"),
        (Rules(settings={"action": "velocity"}), "setting 'action': cannot be set on this page"),
        (Rules(settings={"clyde.speed": 3}), "setting 'clyde.speed': cannot be set on this page"),
        (Rules(settings={"robot.speed_mps": 9.0}), "robot.speed_mps"),
        (Rules(settings={"time_limit_s": 1e9}), "at most 3600 s here"),
        (Rules(level=3), "level 3: map 'house' has none"),
        (Rules(map="generated", level=10**9), "level 1000000000: must be 0 to"),
    ],
)
def test_unknown_choice_is_refused_by_its_name(rules: Rules, words: str) -> None:
    with pytest.raises(Refused, match=words):
        Choices().prepare(rules, None)


def test_chosen_level_is_played_in_every_round() -> None:
    for level in (5, TEST_LEVEL + 1):
        _, source, _ = Choices().prepare(Rules(map="generated", level=level), None)
        assert source.levels_of(np.arange(3, dtype=np.uint64)).tolist() == [level] * 3


def test_setup_changes_only_named_rules() -> None:
    rules = Rules(map="generated", level=3, policy="nearest").changed(Setup(map="maze", ghosts=("chase",)))
    assert rules == Rules(map="maze", level=None, policy="nearest", ghosts=("chase",))


@given(seed=st.integers(0, 2**53 - 1), speed=st.floats(0.05, 2.0))
def test_link_contains_all_rules_of_round(seed: int, speed: float) -> None:
    rules = Rules(map="a map & more", ghosts=("wander", "chase"), settings={"pellets.spacing_m": 1.5})
    link = {name: values[0] for name, values in parse_qs(rules.link(seed, speed)).items()}
    assert link["map"] == "a map & more"
    assert link["ghosts"].split(",") == ["wander", "chase"]
    assert int(link["seed"]) == seed
    assert float(link["clyde"]) == speed
    assert float(link["set.pellets.spacing_m"]) == 1.5


def own_map(folder: Path) -> tuple[str, bytes]:
    path = load_map("house").save(folder / "mine.yaml")
    return path.read_text(), (folder / "mine.pgm").read_bytes()


def test_uploaded_map_is_checked_and_chosen(tmp_path: Path) -> None:
    choices = Choices()
    text, image = own_map(tmp_path)
    text = text.replace("mine.pgm", "../../elsewhere.pgm") + "resolution: 0.1\n"  # the first counts, as on the robot
    answer = choices.add_map("mine", text, image)
    assert answer["map"] == "mine"
    assert "0.05 m per px" in answer["words"]
    assert "resolution" in answer["words"]
    assert "mine" in choices.facts()["maps"]
    choices.prepare(Rules(map="mine"), None)


@pytest.mark.parametrize(
    ("name", "text", "image", "words"),
    [
        ("mine", "a: [", b"P5", "mine.yaml: not a plain YAML file"),
        ("mine", "just words", b"P5", "mine.yaml: "),
        ("mine", None, b"GIF89a", "mine.yaml: key 'image'"),
        ("mine", "image: x.pgm\nresolution: 0.05\norigin: [0, 0, 0]", b"P5 nothing", "mine.yaml"),
        ("mine", "image: x.pgm\nresolution: 0\norigin: [0, 0, 0]", b"P5\n2 2\n255\nabcd", "is missing"),
        ("house", None, None, "a shipped map has this name"),
    ],
)
def test_unusable_map_is_refused_with_the_reason(
    name: str, text: str | None, image: bytes | None, words: str, tmp_path: Path
) -> None:
    whole = own_map(tmp_path)
    with pytest.raises(Refused, match=words) as refused:
        Choices().add_map(name, text or whole[0], image or whole[1])
    assert "/tmp" not in str(refused.value)


def test_map_without_free_space_is_refused(tmp_path: Path) -> None:
    walls = OccupancyMap.from_pixels("walls", np.zeros((40, 40), dtype=np.uint8), 0.05, (0.0, 0.0, 0.0))
    path = walls.save(tmp_path / "walls.yaml")
    with pytest.raises(Refused, match="the map walls cannot be played on"):
        Choices().add_map("walls", path.read_text(), (tmp_path / "walls.pgm").read_bytes())


def test_twenty_maps_are_kept_and_replaceable(tmp_path: Path) -> None:
    choices = Choices()
    text, image = own_map(tmp_path)
    for number in range(20):
        choices.add_map(f"mine-{number}", text, image)
    with pytest.raises(Refused, match="20 maps are stored"):
        choices.add_map("mine-20", text, image)
    choices.add_map("mine-3", text, image)


def test_map_file_given_at_start_is_offered(tmp_path: Path) -> None:
    load_map("house").save(tmp_path / "flat.yaml")
    assert "flat" in Choices(maps=[str(tmp_path / "flat.yaml")]).facts()["maps"]
    with pytest.raises(ValueError, match="nobody"):
        Choices(policies=["nobody"])
