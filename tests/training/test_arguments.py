"""Hyperparameters and arguments say by name what is wrong with them; files and the command line fill them alike."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch
import yaml

from pacman_env.training.arguments import (
    FOLDER,
    Arguments,
    Hyperparameters,
    from_values,
    load_hyperparameters,
    parse,
)
from pacman_env.training.lineups import read

torch.set_num_threads(1)  # products as small as these wait for threads longer than they compute
SHIPPED = FOLDER / "PacManBot-v2.yaml"
#: A training of a moment, for all tests of the package.
TINY: dict[str, Any] = {
    "decisions": 128,
    "cycles": 1,
    "segment": 64,
    "games": 4,
    "n_steps": 8,
    "batch_size": 16,
    "n_epochs": 2,
    "learning_rate": [1e-3, 1e-4],
    "ent_coef": [0.005, 0.001],
    "gamma": 0.998,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
    "width": 8,
    "reward_scale": 0.2,
    "timeout": -5.0,
    "levels": 2,
    "clyde_speed": [0.2, 0.6],
    "robot_speed": [0.22, 0.306],
    "ghosts": ["wander"],
    "league_every": 0,
    "imitation": 64,
    "teacher_nodes": 3000,
    "decide": "tick",
}


def tiny(out: Path = Path("unused"), **changes: Any) -> Arguments:
    """Arguments of a tiny training; changes go to the hyperparameters where they have such a field."""
    names = {field.name for field in dataclasses.fields(Hyperparameters)}
    hyper = from_values({**TINY, **{name: changes[name] for name in names & set(changes)}}, "tiny")
    others = {name: changes[name] for name in set(changes) - names}
    return Arguments(hyper=hyper, out=out, **{"threads": 1, "evaluation": 0, "progress": False, **others})


def section(folder: Path, changes: dict[Any, Any] | None = None) -> Path:
    """A file with the tiny section, changed; a change to None leaves the field out."""
    values = {name: value for name, value in {**TINY, **(changes or {})}.items() if value is not None}
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump({"headline": values}))
    return path


@pytest.mark.parametrize("name", ["headline", "fine_tune", "quick"])
def test_shipped_hyperparameter_sections_load(name: str) -> None:
    hyper = load_hyperparameters(SHIPPED, name)
    assert hyper.segments * hyper.segment == hyper.decisions
    assert hyper.learning_rate[0] > hyper.learning_rate[1]
    assert hyper.rollout % hyper.batch_size == 0


def test_hyperparameters_are_read_unchanged(tmp_path: Path) -> None:
    plain = dataclasses.asdict(load_hyperparameters(section(tmp_path), "headline"))
    assert {name: list(v) if isinstance(v, tuple) else v for name, v in plain.items()} == TINY


def test_number_in_yaml_string_is_parsed(tmp_path: Path) -> None:
    path = section(tmp_path, {"learning_rate": ["1e-3", "1e-4"]})
    assert load_hyperparameters(path, "headline").learning_rate[1] == 1e-4


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gamme": 1}, r"unknown \['gamme'\], missing \[\]"),
        ({3: 1}, r"unknown \['3'\], missing \[\]"),
        ({"gamma": None}, r"unknown \[\], missing \['gamma'\]"),
        ({"games": 4.0}, r"games = 4\.0: Expected `int`"),
        ({"games": 0}, "games = 0: Expected `int` >= 1"),
        ({"imitation": -1}, "imitation = -1: Expected `int` >= 0"),
        ({"gamma": "most"}, "gamma = 'most': Expected `float`"),
        ({"gamma": True}, "gamma = True: Expected `float`"),
        ({"gamma": 1.5}, r"gamma = 1\.5: Expected `float` <= 1"),
        ({"gae_lambda": float("nan")}, "gae_lambda = nan: must be a finite number"),
        ({"clip_range": -0.1}, r"clip_range = -0\.1: Expected `float` >= 0"),
        ({"reward_scale": float("inf")}, "reward_scale = inf: must be a finite number"),
        ({"learning_rate": 0.1}, r"learning_rate = 0\.1: Expected `array`"),
        ({"ent_coef": [1, 2, 3]}, r"ent_coef = \[1, 2, 3\]: Expected `array` of length 2"),
        ({"ent_coef": [float("nan"), 0]}, r"ent_coef\[0\] = nan: must be a finite number"),
        ({"clyde_speed": [-0.2, 0.3]}, r"clyde_speed\[0\] = -0\.2: Expected `float` >= 0"),
        ({"ghosts": "wander"}, "ghosts = 'wander': Expected `array`"),
        ({"ghosts": []}, r"ghosts = \[\]: Expected `array` of length >= 1"),
        ({"ghosts": ["wander", 1]}, r"ghosts\[1\] = 1: Expected `str`"),
        ({"ghosts": ["wander", "arcade,hunt"]}, r"ghosts\[1\] = 'arcade,hunt': unknown ghost behaviour 'hunt'"),
        ({"ghosts": ["wander", "arcade", "chase"]}, "games = 4: must be a multiple of the 3 line-ups in ghosts"),
        ({"ghosts": ["wander", "arcade"], "levels": 1}, "levels = 1: must be at least the 2 line-ups in ghosts"),
        ({"ghosts": ["arcade"], "teacher_nodes": 220}, "teacher_nodes = 220: must be at least 221"),
        ({"segment": 63}, r"segment = 63: must be a multiple of games \* n_steps = 32"),
        ({"batch_size": 1}, "batch_size = 1: leaves a minibatch of 1"),
        ({"batch_size": 31}, "batch_size = 31: leaves a minibatch of 1"),
    ],
)
def test_wrong_field_is_named_with_file_and_section(changes: dict[Any, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=rf"tiny\.yaml: headline: .*{message}"):
        load_hyperparameters(section(tmp_path, changes), "headline")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"quick: {}", "no section 'headline'"),
        (b"headline: 3", "no section 'headline'"),
        (b"- headline", "no section 'headline'"),
        (b"", "no section 'headline'"),
        (b"headline: [", "cannot be read"),
        (b"headline: {gamma: 0.9, gamma: 0.8}", "cannot be read: key 'gamma' is repeated"),
        (b"\xff\xfe\xff", "cannot be read"),
        (b"headline: !!python/object/apply:os.getcwd []", "cannot be read"),
        (None, "cannot be read"),
    ],
)
def test_invalid_hyperparameter_file_is_refused(content: bytes | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"bad\.yaml: {message}"):
        load_hyperparameters(path, "headline")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"threads": -1}, "threads = -1: Expected `int` >= 0"),
        ({"evaluation": -1}, "evaluation = -1: Expected `int` >= 0"),
        ({"ghosts": ["wander", "chase"], "evaluation": 1}, "evaluation = 1: must be 0 or at least the 2 line-ups"),
        ({"seed": -1}, "seed = -1: Expected `int` >= 0"),
        ({"seed": 2**32}, "seed = 4294967296: Expected `int` <= 4294967295"),
    ],
)
def test_arguments_out_of_range_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tiny(**changes)


def test_training_takes_at_least_requested_decisions() -> None:
    assert [tiny(decisions=n).hyper.segments for n in (1, 64, 65, 128)] == [1, 1, 2, 2]


def test_command_line_replaces_single_values(tmp_path: Path) -> None:
    path = section(tmp_path)
    options = ["--config", str(path), "--seed", "3", "--gamma", "0.9", "--learning-rate", "0.5", "0.25"]
    found = parse([*options, "--without", "refuges", "paths", "--curriculum", "--out", "there"])
    hyper = from_values({**TINY, "gamma": 0.9, "learning_rate": [0.5, 0.25]}, "")
    out = Path("there")
    assert found == Arguments(hyper=hyper, out=out, seed=3, without=("refuges", "paths"), curriculum=True)


def test_lineups_are_given_on_command_line() -> None:
    hyper = parse(["--ghosts", "wander", "arcade, chase", "wander", "wander,wander", "--teacher-nodes", "500"]).hyper
    assert hyper.ghosts == ("wander", "arcade,chase", "wander", "wander,wander")
    assert hyper.lineups == ("wander", "arcade,chase", "wander,wander")
    assert hyper.teacher_nodes == 500
    assert all(load_hyperparameters(SHIPPED, name).ghosts == ("wander",) for name in ("quick", "scratch"))


def test_headline_training_uses_1_to_4_ghosts() -> None:
    lineups = [read(lineup).behaviours for lineup in load_hyperparameters(SHIPPED, "headline").lineups]
    assert {name for lineup in lineups for name in lineup} == {"wander", "arcade", "chase", "learned"}
    assert {len(lineup) for lineup in lineups} == {1, 2, 4}


def test_quick_option_uses_its_own_section_and_folder() -> None:
    quick, full = parse(["--quick"]), parse([])
    assert quick.hyper == load_hyperparameters(SHIPPED, "quick") != full.hyper
    assert full.hyper == load_hyperparameters(SHIPPED, "headline")
    assert quick.out != full.out


def test_start_excludes_imitation() -> None:
    quick = dataclasses.replace(load_hyperparameters(SHIPPED, "quick"), imitation=0)
    for options, hyper in ([], load_hyperparameters(SHIPPED, "fine_tune")), (["--quick"], quick):
        started = parse([*options, "--start", "mine.onnx"])
        assert (started.hyper, started.start) == (hyper, Path("mine.onnx"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--start", "mine.onnx", "--imitation", "64"], "imitation = 64: must be 0"),
        (["--gamma", "much"], "gamma"),
        (["--without", "nothing"], "nothing"),
        (["--ghosts"], "ghosts = (): Expected `array` of length >= 1"),
        (["--nonsense"], "nonsense"),
    ],
)
def test_wrong_options_are_refused_with_status_2(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        parse(options)
    assert message in capsys.readouterr().err


def test_progress_restarts_with_each_cycle() -> None:
    hyper = tiny(decisions=128, cycles=2).hyper
    assert [hyper.progress(n) for n in (1, 32, 64, 65, 128, 200)] == [1 / 64, 0.5, 1.0, 1 / 64, 1.0, 1.0]


@pytest.mark.parametrize("cycles", [7, 12, 14, 28])
def test_progress_is_1_at_end_of_cycle(cycles: int) -> None:
    hyper = dataclasses.replace(load_hyperparameters(SHIPPED, "headline"), cycles=cycles)
    ends = [k * hyper.decisions // cycles for k in range(1, cycles + 1) if k * hyper.decisions % cycles == 0]
    assert hyper.decisions in ends
    assert {hyper.progress(n) for n in ends} == {1.0}
    assert all(0.0 < hyper.progress(n) <= 1.0 for n in range(hyper.rollout, hyper.decisions + 1, hyper.rollout))


@pytest.mark.parametrize("name", ["headline", "fine_tune", "quick", "scratch"])
def test_progress_of_shipped_sections_equals_share_of_decisions(name: str) -> None:
    """To the bit: their planners are trained again from it."""
    hyper = load_hyperparameters(SHIPPED, name)
    assert hyper.cycles == 1
    decisions = range(hyper.rollout, hyper.segments * hyper.segment + 1, hyper.rollout)
    assert [hyper.progress(n) for n in decisions] == [n / hyper.decisions for n in decisions]
