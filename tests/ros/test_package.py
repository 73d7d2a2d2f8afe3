"""What a ROS workspace makes of this checkout: package.xml, setup.py, RViz's configuration, and colcon's build."""

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, MODULES

ROOT = Path(__file__).resolve().parents[2]
VIEW = ROOT / "config" / "game.rviz"


@pytest.fixture(scope="module")
def named() -> set[str | None]:
    """The packages that package.xml asks for."""
    return {element.text for element in ElementTree.parse(ROOT / "package.xml").getroot().iter("exec_depend")}


def test_package_xml_is_for_ament_python() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert (package.tag, package.get("format")) == ("package", "3")
    assert package.findtext("name") == "pacman_env"
    assert package.findtext("export/build_type") == "ament_python"
    assert (ROOT / "resource" / "pacman_env").is_file()


def imported(paths: list[Path]) -> set[str]:
    """The first part of every module that files import by its full name, or as a type such as ``std_msgs/String``."""
    found = set()
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Constant) and re.fullmatch(r"[a-z]\w*_(msgs|srvs)/[A-Z]\w*", str(node.value)):
                found.add(str(node.value).partition("/")[0])
    return found


def test_package_xml_names_imported_ros_packages(named: set[str | None]) -> None:
    files = [*(ROOT / "pacman_env" / "ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    modules = imported(files) - set(sys.stdlib_module_names) - {"pacman_env", "__future__"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *(one for extra in project["optional-dependencies"].values() for one in extra)]
    of_pip = {re.split(r"[^\w.-]", one)[0].lower() for one in asked if not one.startswith("ros-")}
    homes = packages_distributions()  # of a ROS package: a wheel that is called ros-..., the system's, or none
    ros = {module for module in modules if not of_pip & {name.lower() for name in homes.get(module, ())}}
    assert {"rclpy", "builtin_interfaces", "launch", "launch_ros", "nav2_msgs"} <= ros
    assert ros <= named, f"neither in package.xml nor in pyproject.toml: {sorted(ros - named)}"


def test_package_xml_names_plugins_of_view(named: set[str | None]) -> None:
    def classes(part: Any) -> Iterator[str]:
        if isinstance(part, dict):
            if isinstance(part.get("Class"), str):
                yield part["Class"]
            part = list(part.values())
        for inner in part if isinstance(part, list) else ():
            yield from classes(inner)

    packages = {name.partition("/")[0] for name in classes(yaml.safe_load(VIEW.read_text())) if name}
    assert packages >= {"rviz_common", "rviz_default_plugins", "nav2_rviz_plugins"}
    assert packages | {"rviz2"} <= named


def test_view_shows_topics_of_game() -> None:
    view = yaml.safe_load(VIEW.read_text())
    known = {value.name for value in vars(topics).values() if isinstance(value, topics.Topic)} | {topics.SCORES.name}
    shown = {display["Topic"]["Value"] for display in view["Visualization Manager"]["Displays"] if "Topic" in display}
    nav2s_own = {"global_costmap/costmap", "local_costmap/costmap", "particle_cloud"}
    wanted = (topics.MAP, topics.PELLET_MARKERS, topics.CLYDE_MARKER, topics.PLAN, topics.SCORES)
    assert {topic.name for topic in wanted} <= shown
    assert shown <= known | nav2s_own
    assert view["Visualization Manager"]["Global Options"]["Fixed Frame"] == "map"


def test_every_node_is_a_console_script(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr("setuptools.setup", lambda **arguments: given.update(arguments))
    monkeypatch.setattr(sys, "argv", ["setup.py", "install"])
    monkeypatch.chdir(ROOT)
    runpy.run_path("setup.py")
    command, *nodes = given["entry_points"]["console_scripts"]
    assert command == "pacman-env = pacman_env.cli.main:main"
    assert nodes == [f"{name} = {module}:main" for name, module in MODULES.items()]
    for module in MODULES.values():
        assert re.search(r"^(def main\(|main = )", (ROOT / f"{module.replace('.', '/')}.py").read_text(), re.M), module


# colcon, the real one, with the setuptools of Ubuntu 24.04

COLCON = [
    *("colcon-core", "colcon-ros", "colcon-python-setup-py", "colcon-package-selection", "colcon-recursive-crawl"),
    *("colcon-library-path", "colcon-pkg-config", "colcon-cmake", "colcon-test-result", "catkin-pkg", "distlib"),
    *("empy<5", "pyparsing", "python-dateutil", "six", "docutils", "setuptools==68.1.2"),
]
SOURCES = ["pacman_env", "eval", "train", "maps", "launch", "config", "resource", "package.xml", "pyproject.toml"]
SOURCES += ["setup.py", "setup.cfg", "README.md", "LICENSE"]


@pytest.fixture(scope="module")
def colcon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with colcon in it."""
    folder = tmp_path_factory.mktemp("colcon")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "--no-input", "install"]
    pip += ["--no-deps", "--no-compile", "--retries", "1", "--target", str(folder), *COLCON]
    done = subprocess.run(pip, capture_output=True, text=True)
    if done.returncode and not os.environ.get("CI"):
        pytest.skip(f"colcon cannot be installed: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return folder


class Workspace:
    """A workspace with a copy of this checkout."""

    def __init__(self, folder: Path, colcon: Path, *options: str) -> None:
        self.folder, self.options = folder, options
        self.sources = folder / "src" / "pacman_env"
        self.sources.mkdir(parents=True)
        self.environment = {**os.environ, "PYTHONPATH": str(colcon), "COLCON_HOME": str(folder / "home")}
        self.environment.pop("PYTHONDONTWRITEBYTECODE", None)  # a build starts Python a dozen times
        self.environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        for name in SOURCES:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, self.sources / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(ROOT / name, self.sources / name)

    def build(self) -> subprocess.Popen[str]:
        words = [sys.executable, "-m", "colcon", "build", "--packages-select", "pacman_env", *self.options]
        pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        return subprocess.Popen(words, cwd=self.folder, env=self.environment, text=True, **pipes)

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """A command after ``source install/local_setup.sh``."""
        script = '. install/local_setup.sh && exec "$@"'
        environment = {name: value for name, value in self.environment.items() if name != "PYTHONPATH"}
        command = ["sh", "-c", script, "sh", *words]
        return subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True)


@pytest.fixture(scope="module")
def workspaces(colcon: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Workspace]:
    """A plain one and one of symbolic links, both built."""
    options = {"plain": (), "links": ("--symlink-install",)}
    made = {name: Workspace(tmp_path_factory.mktemp(name), colcon, *given) for name, given in options.items()}
    builds = {name: workspace.build() for name, workspace in made.items()}
    for name, build in builds.items():
        said, _ = build.communicate()
        assert build.returncode == 0, f"{name}: {said}"
    return made


@pytest.mark.daily
@pytest.mark.parametrize("kind", ["plain", "links"])
def test_colcon_builds_package_for_ros2_run(workspaces: dict[str, Workspace], kind: str) -> None:
    workspace = workspaces[kind]
    installed = workspace.folder / "install" / "pacman_env"
    commands = {path.name for path in (installed / "lib" / "pacman_env").iterdir() if os.access(path, os.X_OK)}
    assert commands == {"pacman-env", *MODULES}
    first = {(installed / "lib" / "pacman_env" / name).read_text().splitlines()[0] for name in commands}
    assert first == {"#!/usr/bin/env python3"}, "the interpreter of the environment that a node is started in"
    share = installed / "share" / "pacman_env"
    for path in ("package.xml", "launch/game.launch.py", "config/nav2.yaml", "config/game.yaml", "maps/house.yaml"):
        assert (share / path).read_text() == (ROOT / path).read_text(), path
        assert (share / path).is_symlink() == (kind == "links")
    assert (installed / "share" / "ament_index" / "resource_index" / "packages" / "pacman_env").is_file()
    wanted = "import pacman_env.evaluation, pacman_env.training, pacman_env.ros as r; print(r.__file__)"
    done = workspace.run(sys.executable, "-c", wanted)
    assert done.returncode == 0, done.stderr
    imported = Path(done.stdout.strip())
    assert imported.is_relative_to(workspace.folder)
    assert imported.resolve().is_relative_to(workspace.sources) == (kind == "links")


@pytest.mark.daily
@pytest.mark.parametrize("kind", ["plain", "links"])
def test_installed_node_refuses_bad_map(workspaces: dict[str, Workspace], kind: str) -> None:
    workspace = workspaces[kind]
    node = str(workspace.folder / "install" / "pacman_env" / "lib" / "pacman_env" / GAME)
    done = workspace.run(node, "--ros-args", "-p", "map_yaml:=nowhere.yaml")
    assert done.returncode == 2, done.stderr
    assert "nowhere.yaml" in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.mark.daily
def test_linked_workspace_can_be_built_again(workspaces: dict[str, Workspace]) -> None:
    build = workspaces["links"].build()
    said, _ = build.communicate()
    assert build.returncode == 0, said
    assert (workspaces["links"].folder / "build" / "pacman_env" / "train").is_symlink()
