"""The reference of the robot's side is what the nodes declare."""

from pathlib import Path

from pacman_env.ros.game_nodes import NODES
from tools.robot_reference import main


def test_robot_reference_is_what_nodes_declare(domain: int, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    assert main(["--check", str(page)]) == 1
    assert main([str(page)]) == 0
    assert main(["--check"]) == 0, "run scripts/robot_reference"
    text = page.read_text()
    for node in NODES:
        assert f"\n## {node}\n" in text
    for line in text.splitlines():
        assert not (line.startswith("| `") and line.count("|") == 6 and line.endswith("|  |")), line
