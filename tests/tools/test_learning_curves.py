import json
import re
from pathlib import Path

import msgspec
import pytest

pytest.importorskip("sb3_contrib")
from tools.common import IMAGES
from tools.learning_curves import draw, main, read, stored

FAST = "maskable_ppo_house"


@pytest.mark.parametrize(
    "name", [FAST, *(pytest.param(name, marks=pytest.mark.daily) for name in read() if name != FAST)]
)
def test_finished_run_is_not_repeated(name: str, tmp_path: Path) -> None:
    words = [name, "--quick", "--seeds", "1", "--out", str(tmp_path / "new")]
    assert main(words) == 0
    (file,) = (tmp_path / "new").iterdir()
    values = json.loads(file.read_text())["values"]
    assert {len(played["won"]) for played in values["tests"].values()} == {8}
    if read()[name].learner != "built-in":
        assert [point[0] for point in values["points"]] == [0, 256, 512]
    before = file.stat().st_mtime_ns
    assert main(words) == 0
    assert file.stat().st_mtime_ns == before


def test_result_of_other_configuration_is_missing(tmp_path: Path) -> None:
    baseline = read()[FAST]
    (file := tmp_path / "run.json").write_text(json.dumps({"configuration": baseline.facts}))
    assert stored(file, msgspec.structs.replace(baseline, seeds=9)) is not None
    assert stored(file, msgspec.structs.replace(baseline, decisions=1)) is None


def test_committed_picture_shows_committed_results(tmp_path: Path) -> None:
    draw(tmp_path / "drawn.svg")
    drawn, committed = (
        re.findall(">(.* of .*)</text>", path.read_text(encoding="utf-8"))
        for path in (tmp_path / "drawn.svg", IMAGES / "baselines.svg")
    )
    assert drawn == committed != []
