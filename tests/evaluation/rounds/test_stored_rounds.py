"""Evaluation commands continue with the rounds that were kept."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.rounds import stored_rounds
from pacman_env.evaluation.rounds.matchups import Matchup, play_all
from pacman_env.evaluation.rounds.scenarios import Levels
from pacman_env.evaluation.rounds.stored_rounds import StoredRounds
from pacman_env.executors.executor import InProcess
from pacman_env.policies.learned import PRETRAINED
from pacman_env.policies.registry import make_policy
from tests.evaluation.helpers import CONFIG, LEVELS, LEVELS_CONFIG, without_times

SHORT = ["--episodes", "6", "--spacing", "3", "--time-limit", "60"]


def matchup(policy: str = "nearest", rounds: int = 6, **changes: Any) -> Matchup:
    return Matchup("house", CONFIG.with_fields(**changes), policy, episode_seeds(5, rounds))


def play(folder: Path, *matchups: Matchup) -> int:
    """How many rounds were played, with the records compared."""
    rounds, ended = StoredRounds(folder, matchups, resume=True), []
    left = rounds.left
    found = rounds.play(InProcess(), ended.append)
    for (records, times), (expected, _) in zip(found, play_all(matchups, InProcess()), strict=True):
        np.testing.assert_array_equal(records, expected)
        assert len(times) > 0
    assert sum(ended) == left
    return left


def test_interrupted_run_keeps_ended_rounds(tmp_path: Path) -> None:
    ended: list[int] = []

    def interrupt(number: int) -> None:
        ended.append(number)
        if sum(ended) > 4:  # in the second matchup
            raise KeyboardInterrupt

    matchups = [matchup(rounds=4), matchup("random_pellet", rounds=4)]
    with pytest.raises(KeyboardInterrupt):
        StoredRounds(tmp_path, matchups, resume=True).play(InProcess(), interrupt)
    assert play(tmp_path, *matchups) == 4


def test_kept_rounds_are_found_for_any_division(tmp_path: Path) -> None:
    assert play(tmp_path, matchup(rounds=4)) == 4
    assert play(tmp_path, matchup(rounds=6), matchup("random_pellet")) == 8
    assert play(tmp_path, matchup("random_pellet", rounds=5), matchup(rounds=6), matchup(rounds=2)) == 0
    levels = Matchup(LEVELS, LEVELS_CONFIG, "nearest", episode_seeds(5, 6))
    assert play(tmp_path, levels) == 6
    assert play(tmp_path, levels) == 0
    power = matchup(**{"power.pellets": 4, "power.shortest_s": 20.0, "clyde.ghosts": ("chase", "chase")})
    assert [play(tmp_path, power), play(tmp_path, power)] == [6, 0]


def test_key_contains_everything_that_determines_rounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    play(tmp_path, matchup(rounds=2))
    others = [
        matchup("random_pellet", rounds=2),
        matchup(str(PRETRAINED), rounds=2),
        matchup(rounds=2, time_limit_s=30.0),
        matchup(rounds=2, **{"clyde.ghosts": ("chase",)}),
        Matchup("maze", CONFIG, "nearest", episode_seeds(5, 2)),
        Matchup(Levels("test", count=1), CONFIG, "nearest", episode_seeds(5, 2)),
        Matchup("house", CONFIG, "nearest", episode_seeds(6, 2)),
    ]
    assert StoredRounds(tmp_path, others, resume=True).left == 14
    assert StoredRounds(tmp_path, [matchup(rounds=2)], resume=True).left == 0
    monkeypatch.setattr(stored_rounds, "package_hash", lambda: "other")
    assert StoredRounds(tmp_path, [matchup(rounds=2)], resume=True).left == 2


def test_planner_key_depends_on_file_content_only() -> None:
    by_name, by_path = (stored_rounds.describe_policy(make_policy(spec), spec) for spec in ("ppo", str(PRETRAINED)))
    assert by_name == by_path
    bases = "ppo", str(PRETRAINED), "nearest"
    of_ppo, of_file, of_nearest = (
        stored_rounds.describe_policy(make_policy("search", base=base), "search") for base in bases
    )
    assert of_ppo == of_file != of_nearest


def test_factory_is_described_by_its_source_and_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    described = []
    for number, made in enumerate(('"lookahead"', '"lookahead", wait_s=1.0', '"nearest"')):
        text = f"from pacman_env.policies.registry import make_policy\n\ndef mine():\n    return make_policy({made})\n"
        (tmp_path / f"factory_{number}.py").write_text(text)
        spec = f"factory_{number}:mine"
        described.append({**stored_rounds.describe_policy(make_policy(spec), spec), "name": "mine"})
    assert len({str(about) for about in described}) == 3
    assert [about["class"].rpartition(":")[2] for about in described] == ["Lookahead", "Lookahead", "Nearest"]


@pytest.mark.parametrize(
    "made", ["functools.partial(POLICIES.find('nearest'))", "type('Own', (Child,), {})", "Behaviour('mine', target)"]
)
def test_helper_of_any_policy_or_ghost_is_described(made: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    name = f"of_{made.partition('(')[0].rpartition('.')[2]}"
    helper, spec = tmp_path / f"helper_{name}.py", f"{name}:MINE"
    helper.write_text(
        "from pacman_env.policies.registry import *\nfrom pacman_env.game.ghosts import Behaviour\n"
        "class Child(LearnedPlanner): pass\ndef target(view, parameters): return view.robot_x, view.robot_y\n"
    )
    (tmp_path / f"{name}.py").write_text(f"import functools\nfrom helper_{name} import *\nMINE = {made}\n")
    is_ghost = made.startswith("Behaviour")
    described = []
    for _ in range(2):
        described.append(
            stored_rounds.describe_ghost(spec) if is_ghost else stored_rounds.describe_policy(make_policy(spec), spec)
        )
        helper.write_text(helper.read_text() + "CHANGED = True\n")
    assert None not in described
    assert described[0] != described[1]
    assert stored_rounds.describe_ghost("chase") is None


@pytest.mark.parametrize("damage", ["torn", "changed", "foreign", "short", "renamed"])
def test_damaged_file_is_reported_and_rounds_played_again(
    damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    play(tmp_path, matchup())
    (path,) = tmp_path.iterdir()
    text = path.read_text()
    if damage == "foreign":
        play(tmp_path, matchup("random_pellet"))
        (other,) = set(tmp_path.iterdir()) - {path}
        other.replace(path)
    else:
        part = json.loads(text)
        if damage == "renamed":
            part["rounds"]["missed"] = part["rounds"].pop("lost")
            part["sha256"] = stored_rounds.content_hash(part["rounds"])
        else:
            part["rounds"]["end"].pop() if damage == "short" else part["rounds"]["collected"].insert(0, 99)
        path.write_text(text[:-100] if damage == "torn" else json.dumps(part))
    assert play(tmp_path, matchup()) == 6
    assert capsys.readouterr().err.startswith(f"damaged, is played again: {path}: ")
    assert path.read_text().startswith(f'{{"schema":{stored_rounds.SCHEMA},')
    assert play(tmp_path, matchup()) == 0


def test_kept_rounds_are_ignored_without_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [*SHORT, "--policies", "nearest"]
    assert main(words) == 0
    assert "6/6" in capsys.readouterr().err
    assert main([*words, "--parts", "results/compare.parts", "--json", "other.json"]) == 0
    told = capsys.readouterr().err
    assert "1 parts in results/compare.parts are played again: without --resume\n" in told
    assert "6/6" in told
    assert main([*words, "--parts", "results/compare.parts", "--json", "resumed.json", "--resume"]) == 0
    assert "6 of 6 episodes are taken over from results/compare.parts, 0 are played" in capsys.readouterr().err
    assert without_times(tmp_path / "other.json") == without_times(tmp_path / "resumed.json")
    assert not (tmp_path / "other.parts").exists()
