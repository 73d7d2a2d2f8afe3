"""The reference of the robot's side and the file of all parameters are what the nodes declare."""

from pathlib import Path

import pytest

from pacman_env.ros.game_nodes import MODULES
from tools.robot_reference import PARAMETERS, Described, describe_all, main, page


@pytest.fixture(scope="module")
def nodes(domain: int) -> dict[str, Described]:
    return describe_all()


def test_robot_reference_is_what_nodes_declare(domain: int, tmp_path: Path) -> None:
    written = [str(tmp_path / name) for name in ("page.md", "game.yaml")]
    assert main(["--check", *written]) == 1
    assert main(written) == 0
    assert main(["--check"]) == 0, "run scripts/robot_reference"


def test_reference_has_every_node_and_meaning(nodes: dict[str, Described]) -> None:
    assert nodes.keys() == MODULES.keys()
    assert all(parameter.meaning for node in nodes.values() for parameter in node.parameters)
    text = page(nodes)
    for name in nodes:
        assert f"\n## {name}\n" in text


def test_parameter_file_loads_as_defaults(nodes: dict[str, Described]) -> None:
    assert describe_all("--params-file", str(PARAMETERS)) == nodes
