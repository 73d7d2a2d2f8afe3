"""What the project says of itself is the same everywhere: authors, licence, Pythons."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHONS = [
    version for text in PROJECT["classifiers"] for version in re.findall(r"^Programming Language .* :: (3\.\d+)$", text)
]


def test_citation_names_authors_of_project() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert [author["name"] for author in PROJECT["authors"]] == [author["name"] for author in citation["authors"]]


def test_licence_is_mit_in_every_file() -> None:
    assert (ROOT / "LICENSE").read_text().startswith("MIT License")
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["license"] == "MIT"
    assert 'license="MIT"' in (ROOT / "setup.py").read_text()
    assert '<license file="LICENSE">MIT</license>' in (ROOT / "package.xml").read_text()
    assert card()["license"] == "mit"


def test_badges_name_supported_pythons_and_licence() -> None:
    badges = re.findall(r"!\[([^]]*)\]\(https://img\.shields\.io/badge/([^)]*)\)", (ROOT / "README.md").read_text())
    assert dict(badges).keys() == {f"Python {PYTHONS[0]} to {PYTHONS[-1]}", "Licence: MIT"}
    shown = " ".join(text for _, text in badges)
    assert all(version in shown for version in PYTHONS)
    assert "-MIT-" in shown
    assert f'python_requires=">={PYTHONS[0]}"' in (ROOT / "setup.py").read_text()


def test_model_card_names_shipped_planner() -> None:
    facts = card()
    assert facts["library_name"] == "onnx"
    assert "reinforcement-learning" in facts["tags"]
    assert facts["model_name"] == "ppo"
    assert (ROOT / "pacman_env" / "policies" / "pretrained" / f"{facts['model_name']}.onnx").is_file()


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


def card() -> dict[str, str]:
    """The YAML between the first two lines of dashes."""
    _, front, _ = (ROOT / "docs" / "model_card.md").read_text().split("---\n", 2)
    return yaml.safe_load(front)
