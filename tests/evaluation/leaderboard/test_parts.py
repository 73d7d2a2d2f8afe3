from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.evaluation.compare import parts
from pacman_env.evaluation.compare.parts import describe_map, describe_policy
from pacman_env.evaluation.compare.scenarios import Levels
from pacman_env.evaluation.leaderboard.parts import Part, PartFolder
from pacman_env.policies.learned import PRETRAINED
from pacman_env.policies.registry import make_policy
from tests.evaluation.helpers import FIVE

CONFIG = make_config("robot", "robust")
PART = Part(describe_policy(make_policy("nearest"), "nearest"), describe_map("house", CONFIG), CONFIG, 0, 5)
POLICY = """\
from pacman_env.heuristics.simple import Nearest


class Mine(Nearest):
    pass
"""


def test_a_part_is_read_as_it_was_written(tmp_path: Path) -> None:
    folder = PartFolder(tmp_path, "abc")
    assert folder.read(PART) is None
    written = folder.write(PART, FIVE)
    read = PartFolder(tmp_path, "def").read(PART)
    assert read == written
    assert read is not None
    assert read.commit == "abc"
    np.testing.assert_array_equal(read.rounds.ends(), FIVE["end"])
    assert read.rounds.collected == tuple(FIVE["collected"].tolist())
    assert read.rounds.time_s == (10.0, 20.0, 30.0, 40.0, 50.0)
    assert [path.name for path in tmp_path.iterdir()] == [f"{PART.key}.json"]


def test_whatever_decides_the_rounds_makes_another_part(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = {
        PART.key,
        dataclasses.replace(PART, seed=1).key,
        dataclasses.replace(PART, rounds=6).key,
        dataclasses.replace(PART, policy=describe_policy(make_policy("random"), "random")).key,
        dataclasses.replace(PART, map=describe_map("maze", CONFIG)).key,
        dataclasses.replace(PART, map=describe_map(Levels("test", count=2), CONFIG)).key,
        dataclasses.replace(PART, map=describe_map(Levels("test", count=3), CONFIG)).key,
        *(
            dataclasses.replace(PART, config=CONFIG.with_fields(**{name: value})).key
            for name, value in (
                ("clyde.speed_mps", 0.3),
                ("clyde.ghosts", ("chase",)),
                ("clyde.ghosts", ("chase", "chase")),
                ("time_limit_s", 50.0),
            )
        ),
    }
    assert len(keys) == 11
    monkeypatch.setattr(parts, "__version__", "0.0.0")
    assert dataclasses.replace(PART).key not in keys


def test_a_planner_is_its_file_by_whatever_name() -> None:
    named, by_path = (describe_policy(make_policy(spec), spec) for spec in ("ppo", str(PRETRAINED)))
    assert named == by_path
    assert len(named["sha256"]) == 64


def test_a_search_is_its_base_too(tmp_path: Path) -> None:
    by_name, by_path, nearest = (
        describe_policy(make_policy("search", base=base), "search") for base in ("ppo", str(PRETRAINED), "nearest")
    )
    assert by_name == by_path != nearest
    assert by_name["base"] == describe_policy(make_policy("ppo"), "ppo")


def test_a_policy_of_another_package_is_its_source_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for name, text in (("one_policy", POLICY), ("same_policy", POLICY), ("other_policy", POLICY + "\n")):
        (tmp_path / f"{name}.py").write_text(text)
    one, same, other = (
        describe_policy(make_policy(f"{name}_policy:Mine"), "mine")["code"] for name in ("one", "same", "other")
    )
    assert one == same != other
    assert PART.policy["code"] is None


def test_a_function_that_makes_a_policy_of_the_package_is_its_source_and_what_it_makes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    seen = []
    for number, made in enumerate(('"lookahead"', '"lookahead", wait_s=1.0', '"nearest"')):
        text = f"from pacman_env.policies.registry import make_policy\n\ndef mine():\n    return make_policy({made})\n"
        (tmp_path / f"factory_{number}.py").write_text(text)
        spec = f"factory_{number}:mine"
        seen.append({**describe_policy(make_policy(spec), spec), "name": "mine"})
    assert len({str(about) for about in seen}) == 3
    assert [about["class"].rpartition(":")[2] for about in seen] == ["Lookahead", "Lookahead", "Nearest"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"CCLDT"', '"CCLDC"', "sha256"),
        ('"CCLDT"', '"CCLDX"', "rounds.end"),
        ('"seed":0', '"seed":1', "of another part"),
        ('"commit"', '"author"', "no such field"),
        ("}\n", "", "no JSON that can be read"),
    ],
)
def test_a_damaged_part_is_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    folder = PartFolder(tmp_path, "abc")
    folder.write(PART, FIVE)
    path = folder.path(PART)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the message is compared below)
        folder.read(PART)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_a_part_of_fewer_rounds_is_named(tmp_path: Path) -> None:
    folder = PartFolder(tmp_path, "abc")
    folder.write(PART, FIVE[:4])
    with pytest.raises(ValueError, match=r"\.json: rounds: must be 5$"):
        folder.read(PART)


def test_what_decides_a_part_is_plain_data() -> None:
    assert json.loads(json.dumps(PART.decides)) == PART.decides
