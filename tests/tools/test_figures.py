"""Figures of the documentation: pages show the stored results, and stale figures are noticed."""

import shutil
from pathlib import Path

import pytest

from tools.common import ROOT
from tools.figures import store
from tools.figures.__main__ import check, main, pages, stale
from tools.figures.inputs import INPUTS, SETTINGS, hashes
from tools.figures.measurements import measurements
from tools.figures.views import BLOCK, filled

ROW = {"map": "house", "policy": "ppo", "clyde_speed": 0.25, "completion_rate": 0.9, "completion_ci": [0.8, 0.95]}


def test_figures_are_current_and_pages_show_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check"]) == 0, capsys.readouterr().out


def test_every_figure_on_a_page_is_a_measurement() -> None:
    named = {block[2] for page in pages() for block in BLOCK.finditer(page.read_text(encoding="utf-8"))}
    known = set(measurements())
    assert named <= known
    assert set(store.read()) <= known


def test_every_input_of_a_measurement_exists() -> None:
    assert {one for measurement in measurements().values() for one in measurement.inputs} <= {*INPUTS, SETTINGS}


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the package that a test may change."""
    copy = tmp_path_factory.mktemp("figures") / "pacman_env"
    return Path(shutil.copytree(ROOT / "pacman_env", copy, ignore=shutil.ignore_patterns("__pycache__", "static")))


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("policies/pretrained/ppo.onnx", {"planner"}),
        ("observations/planner_features.py", {"features"}),
        ("sim/ticks.py", {"engine"}),
        ("sim/coarse_model.py", {"search"}),
        ("heuristics/simple.py", {"policies"}),
        ("web/server.py", set()),
    ],
)
def test_changed_file_changes_its_input_only(file: str, changed: set[str], package: Path) -> None:
    before, original = hashes(INPUTS, package), (package / file).read_bytes()
    (package / file).write_bytes(original + (b"\nX = 1\n" if file.endswith(".py") else b"x"))
    after = hashes(INPUTS, package)
    (package / file).write_bytes(original)
    assert {name for name in before if before[name] != after[name]} == changed


def test_comments_and_docstrings_do_not_change_an_input(package: Path) -> None:
    file, before = package / "observations" / "prediction.py", hashes(INPUTS, package)
    original = file.read_text(encoding="utf-8")
    file.write_text(original.replace('"""Predict', '"""Guess', 1) + "# a comment\n", encoding="utf-8")
    after = hashes(INPUTS, package)
    file.write_text(original, encoding="utf-8")
    assert after == before


def test_changed_planner_is_reported_with_figure_and_page(capsys: pytest.CaptureFixture[str]) -> None:
    now = {**store.read()["house"]["inputs"], "planner": "another"}
    assert "house" in [name for name, _ in stale(store.read(), now)]
    assert check(store.read(), now) == 1
    assert "house (README.md, docs/benchmark.md, docs/index.md, docs/model_card.md): planner" in capsys.readouterr().out


def test_block_is_filled_inline_and_as_a_table() -> None:
    records = {
        "house": {
            "values": [ROW],
            "version": "1.2.3",
            "commit": "0123abcdef",
            "date": "2026-01-02",
            "machine": "2 x Test",
        }
    }
    page = "ppo: <!-- figure: house/share ppo 0.25 -->old<!-- end --> (<!-- figure: house/stamp --><!-- end -->)"
    assert filled(page, records).count("90.0 % [80.0, 95.0]") == 1
    assert "1.2.3 at 0123abcd, 2026-01-02, 2 x Test<!-- end -->)" in filled(page, records)
    table = filled("<!-- figure: compare/terminal -->\n\nold\n\n<!-- end -->", store.read())
    assert table.startswith("<!-- figure: compare/terminal -->\n\n```")
    assert filled(table, store.read()) == table


@pytest.mark.parametrize("block", ["unknown/share", "house/unknown", "house/share ppo 0.45"])
def test_unknown_figure_or_view_is_refused(block: str) -> None:
    with pytest.raises(ValueError, match=r"figure|no row"):
        filled(f"<!-- figure: {block} --><!-- end -->", {"house": {"values": [ROW]}})
