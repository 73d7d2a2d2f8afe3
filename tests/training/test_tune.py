"""A study finds, goes on, and ends in a file that the training takes."""

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")
pytest.importorskip("optuna")

from pacman_env.training import train, tune
from pacman_env.training.arguments import load_hyperparameters
from pacman_env.training.tune import SPACE, Study, hyperparameters, main, search
from tests.training.test_arguments import section, tiny

PARAMS: dict[str, Any] = {
    "learning_rate": 5e-4,
    "ent_coef": 1e-3,
    "n_epochs": 3,
    "width": 48,
    "discount": 0.01,
    "gae_lambda": 0.9,
    "clip_range": 0.15,
    "batch_size": 1024,
    "reward_scale": 0.5,
    "imitation": 2.0,
}


def settings(folder: Path, **changes: Any) -> Study:
    fixed = {"decisions": 64, "segments": 2, "evaluation": 1, "threads": 1, "progress": False, "trials": 2}
    return Study(out=folder / "study", config=section(folder), **{**fixed, **changes})


def trials(study: Study) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (study.out / "trials.jsonl").read_text().splitlines()[1:]]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A study of three trials, of which the third learns from the others."""
    study = settings(tmp_path_factory.mktemp("whole"), trials=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tune, "_STARTUP", 2)
        search(study)
    return study


def test_study_records_one_line_per_trial(whole: Study) -> None:
    found = trials(whole)
    assert [trial["trial"] for trial in found] == [0, 1, 2]
    for trial in found:
        assert trial["state"] in ("COMPLETE", "PRUNED")
        assert trial["params"].keys() == SPACE.keys()
        assert set(trial["segments"]) <= {"0", "1"}
        assert trial["state"] == "PRUNED" or trial["completed"] == trial["segments"]["1"]
    assert len({json.dumps(trial["params"]) for trial in found}) == 3


def test_interrupted_trial_is_resumed(whole: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "_STARTUP", 2)
    study = settings(tmp_path, trials=1)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("optuna.trial.Trial.report", interrupt)
        with pytest.raises(KeyboardInterrupt):
            search(study)
    before = json.loads((study.out / "trial-0" / "run.json").read_text())["segments"]
    assert len(before) == 1
    search(study)
    after = json.loads((study.out / "trial-0" / "run.json").read_text())["segments"]
    assert after[:1] == before  # times included: it was not played again
    assert trials(study) == trials(whole)[:1]


def test_file_of_best_trial_loads_and_trains(whole: Study, tmp_path: Path) -> None:
    best = whole.out / "best.yaml"
    before, found = load_hyperparameters(whole.config, "headline"), load_hyperparameters(best, "headline")
    finished = [trial for trial in trials(whole) if trial["state"] == "COMPLETE"]
    params = max(finished, key=lambda trial: trial["completed"])["params"]
    assert found == hyperparameters(before, params)
    options = ["--decisions", "64", "--threads", "1", "--evaluation", "0", "--no-progress", "--imitation", "0"]
    assert train.main(["--config", str(best), *options, "--out", str(tmp_path / "run")]) == 0


def test_proposal_changes_only_searched_hyperparameters() -> None:
    before = tiny().hyper
    found = hyperparameters(before, PARAMS)
    assert found.learning_rate == pytest.approx((5e-4, 5e-5))  # the section's falls to a tenth
    assert found.ent_coef == pytest.approx((1e-3, 2e-4))
    assert found.gamma == pytest.approx(0.99)
    assert found.imitation == 2 * before.imitation
    for name in ("n_epochs", "width", "gae_lambda", "clip_range", "batch_size", "reward_scale"):
        assert getattr(found, name) == PARAMS[name]
    changed = {name for name, value in dataclasses.asdict(found).items() if value != getattr(before, name)}
    assert changed == {*PARAMS, "gamma"} - {"discount"}


def written(study: Study, states: list[str], share: float) -> Study:
    """The study with trials behind it, as if they had been played."""
    study.out.mkdir()
    hyper = load_hyperparameters(study.config, study.section)
    lines: list[dict[str, Any]] = [tune._plain(study, hyper)]
    for number, state in enumerate(states):
        shares = {"0": share, "1": share} if state == "COMPLETE" else {}
        completed = share if state == "COMPLETE" else None
        lines.append({"trial": number, "state": state, "completed": completed, "params": PARAMS, "segments": shares})
    (study.out / "trials.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return dataclasses.replace(study, resume=True, trials=len(states) + 1)


def test_trial_below_median_is_stopped_also_in_resumed_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tune, "_STARTUP", 2)  # so that the last trial learns from the others
    records = []
    for name, parts in (("whole", [7]), ("interrupted", [6, 7])):
        (tmp_path / name).mkdir()
        study = written(settings(tmp_path / name, segments=3, decisions=96), ["COMPLETE"] * 5, 1.0)
        for count in parts:
            best = search(dataclasses.replace(study, trials=count))
        stopped = trials(study)[5]
        assert stopped["state"] == "PRUNED"
        assert set(stopped["segments"]) == {"0", "1"}  # not after the first segment already, and not played to the end
        records.append((study.out / "trials.jsonl").read_bytes())
    assert records[0] == records[1]
    assert "trial 5: given up: 0.0% of validation rounds after 64 decisions" in capsys.readouterr().out
    assert "Trial 0 of 7" in best.read_text()


def test_diverged_trial_is_recorded_and_skipped(tmp_path: Path) -> None:
    study = dataclasses.replace(settings(tmp_path), config=section(tmp_path, {"learning_rate": [1e-9, 1e25]}))
    with pytest.raises(ValueError, match=r"trials\.jsonl: none of 2 trials could be finished"):
        search(study)
    assert [(trial["state"], trial["completed"]) for trial in trials(study)] == [("FAIL", None)] * 2
    assert not (study.out / "best.yaml").exists()
    with pytest.raises(ValueError, match="none of 2 trials"):
        search(dataclasses.replace(study, resume=True))


def test_existing_study_is_not_overwritten(whole: Study) -> None:
    with pytest.raises(ValueError, match="study: there is a study already; give --resume or another --out"):
        search(whole)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"seed": 1}, "seed = 0, not 1"), ({"decisions": 128}, "decisions = 64, not 128"), ({}, "gamma = 0.998, not 0.5")],
)
def test_resuming_with_other_settings_names_changed_field(
    changes: dict[str, Any], message: str, whole: Study, tmp_path: Path
) -> None:
    study = settings(tmp_path, resume=True, **changes)
    shutil.copytree(whole.out, study.out)
    if not changes:
        section(tmp_path, {"gamma": 0.5})
    with pytest.raises(ValueError, match=rf"trials\.jsonl: was started with {message}"):
        search(study)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('{"trial": 1', "", "no study to resume"),
        ('"trial": 1', '"trial": 2', "line 3: no trial of this search: the trials are not in order"),
        ("COMPLETE", "DONE", "line 2: no trial of this search"),
        ('"n_epochs": 3', '"n_epochs": 30', "line 2: no trial of this search"),
        ('"n_epochs": 3', '"epochs": 3', "line 2: no trial of this search"),
        ('"segments": {"0"', '"segments": {"a"', "line 2: no trial of this search"),
    ],
)
def test_invalid_record_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    study = written(settings(tmp_path), ["COMPLETE"] * 2, 0.5)
    path = study.out / "trials.jsonl"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=rf"trials\.jsonl: {message}"):
        search(study)


def test_command_writes_best_file_and_names_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--config", str(section(tmp_path)), "--out", str(tmp_path / "study"), "--trials", "1"]
    options += ["--decisions", "32", "--segments", "1", "--evaluation", "1", "--threads", "1", "--no-progress"]
    assert main(options) == 0
    assert f"pacman-env train --config {tmp_path / 'study' / 'best.yaml'}" in capsys.readouterr().out


def test_numbers_out_of_range_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="trials = 0: Expected `int` >= 1"):
        settings(tmp_path, trials=0)
