"""What the project says of itself is the same everywhere: authors, licence, Pythons."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from tools.figures import store

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHONS = [
    version for text in PROJECT["classifiers"] for version in re.findall(r"^Programming Language .* :: (3\.\d+)$", text)
]


def test_citations_name_title_and_authors_of_project() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    authors = [author["name"] for author in PROJECT["authors"]]
    assert authors == [author["name"] for author in citation["authors"]]
    (entry,) = re.findall(r"```bibtex\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert f"author = {{{{{' and '.join(authors)}}}}}" in entry
    assert f"title = {{{citation['title']}}}" in entry


def test_licence_is_mit_in_every_file() -> None:
    assert (ROOT / "LICENSE").read_text().startswith("MIT License")
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["license"] == "MIT"
    assert 'license="MIT"' in (ROOT / "setup.py").read_text()
    assert '<license file="LICENSE">MIT</license>' in (ROOT / "package.xml").read_text()
    assert card()["license"] == "mit"


def test_badges_name_supported_pythons_libraries_and_licence() -> None:
    badges = re.findall(r"!\[([^]]*)\]\(https://img\.shields\.io/badge/([^)]*)\)", (ROOT / "README.md").read_text())
    least = dict(re.findall(r"^(\w+)>=([\d.]+)", "\n".join(PROJECT["dependencies"]), re.MULTILINE))
    libraries = [f"{name} {least[name.lower()]} or newer" for name in ("Gymnasium", "PettingZoo")]
    assert [name for name, _ in badges] == [f"Python {PYTHONS[0]} to {PYTHONS[-1]}", *libraries, "Licence: MIT"]
    for name, badge in badges:
        assert all(number in badge for number in re.findall(r"\d+\.\d+", name))
    assert all(version in badges[0][1] for version in PYTHONS)
    assert f'python_requires=">={PYTHONS[0]}"' in (ROOT / "setup.py").read_text()


def test_model_card_names_shipped_planner() -> None:
    facts = card()
    assert facts["library_name"] == "onnx"
    assert "reinforcement-learning" in facts["tags"]
    assert facts["model_name"] == "ppo"
    assert (ROOT / "pacman_env" / "policies" / "pretrained" / f"{facts['model_name']}.onnx").is_file()


def test_model_index_contains_stored_figures() -> None:
    stored = [row for row in store.read()["house"]["values"] if row["policy"] == "ppo"]
    results = card()["model-index"][0]["results"]
    for row, result in zip(stored, results, strict=True):
        assert result["dataset"]["name"] == row["map"]
        assert result["dataset"]["args"] == {name: row[name] for name in ("clyde_speed", "episodes")}
        assert [metric["value"] for metric in result["metrics"]] == [round(100 * row["completion_rate"], 1)]


@pytest.mark.parametrize(
    "workflow", sorted((ROOT / ".github" / "workflows").glob("*.y*ml")), ids=lambda path: path.stem
)
def test_workflows_pin_actions_and_run_every_python(workflow: Path) -> None:
    text, content = workflow.read_text(), yaml.safe_load(workflow.read_text())
    actions = re.findall(r"uses: (.*)", text)
    assert actions
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action) for action in actions)
    assert content["permissions"] == {"contents": "read"}
    assert text.count("persist-credentials: false") == text.count("actions/checkout@")
    matrices = [job["strategy"]["matrix"] for job in content["jobs"].values() if "strategy" in job]
    pythons = [matrix["python"] for matrix in matrices if "python" in matrix]
    assert pythons == [PYTHONS] * (workflow.stem in ("tests", "release"))


def card() -> dict[str, Any]:
    """The YAML between the first two lines of dashes."""
    _, front, _ = (ROOT / "docs" / "model_card.md").read_text().split("---\n", 2)
    return yaml.safe_load(front)
