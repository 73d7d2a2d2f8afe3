"""What a ROS workspace finds in this checkout: package.xml, setup.py and RViz's configuration."""

from __future__ import annotations

import ast
import runpy
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env import __version__
from pacman_env.ros.supervisor.game_nodes import NODES, STOP_ORDER, module_of

ROOT = Path(__file__).resolve().parents[2]


def test_package_xml_is_of_this_version_and_names_every_ros_package_that_is_imported() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert (package.tag, package.get("format")) == ("package", "3")
    assert package.findtext("name") == "pacman_env"
    assert package.findtext("version") == __version__
    assert package.findtext("export/build_type") == "ament_python"
    assert (ROOT / "resource" / "pacman_env").is_file()
    named = {element.text for element in package.iter("exec_depend")}
    imported = set()
    for path in (ROOT / "pacman_env" / "ros").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.partition(".")[0])
    assert {name for name in imported if name == "rclpy" or name.endswith("_msgs")} <= named


def test_every_node_is_a_command_of_the_ros_package_and_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr("setuptools.setup", lambda **arguments: given.update(arguments))
    monkeypatch.setattr(sys, "argv", ["setup.py", "install"])
    monkeypatch.chdir(ROOT)
    runpy.run_path("setup.py")
    command, *nodes = given["entry_points"]["console_scripts"]
    assert command == "pacman-env = pacman_env.cli.main:main"
    assert nodes == [f"{name} = {module_of(name)}:main" for name in NODES]
    for name in NODES:
        assert "def main(" in (ROOT / f"{module_of(name).replace('.', '/')}.py").read_text(), name
    assert set(STOP_ORDER) <= set(NODES)


def test_the_view_shows_topics_of_the_game() -> None:
    from pacman_env.ros import topics

    view = yaml.safe_load((ROOT / "config" / "game.rviz").read_text())
    known = {value.name for value in vars(topics).values() if isinstance(value, topics.Topic)}
    shown = {display["Topic"]["Value"] for display in view["Visualization Manager"]["Displays"] if "Topic" in display}
    nav2s_own = {"global_costmap/costmap", "local_costmap/costmap", "particle_cloud"}
    assert {topics.MAP.name, topics.PELLET_MARKERS.name, topics.CLYDE_MARKER.name, topics.PLAN.name} <= shown
    assert shown <= known | nav2s_own
    assert view["Visualization Manager"]["Global Options"]["Fixed Frame"] == "map"
