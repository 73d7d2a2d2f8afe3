"""The import order of the package: a folder uses only its own and lower layers (docs/architecture.md, "Layers")."""

from __future__ import annotations

import ast
import functools
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pacman_env"
FLOORS = (
    ("config", "engine", "command_line", "plugins", "rng", "files", "_version"),
    ("world", "game"),
    ("sim",),
    ("policies",),
    ("heuristics",),
    ("envs", "render", "episodes", "sb3"),
    ("cli", "web", "ros"),
    ("executors",),
    ("training", "evaluation"),
)
#: Folders beside the package; nothing in it imports them.
TOP = ("train", "eval", "benchmarks", "tools", "tests")
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
SAME_FLOOR_BUT_UNRELATED = {
    *(("world", "game"), ("game", "world"), ("training", "evaluation"), ("evaluation", "training")),
}
#: Packages of ROS beside rclpy.
MESSAGES = (
    *("action_msgs", "builtin_interfaces", "geometry_msgs", "irobot_create_msgs", "nav2_msgs", "nav_msgs"),
    *("rcl_interfaces", "rosgraph_msgs", "sensor_msgs", "std_msgs", "std_srvs", "tf2_msgs", "visualization_msgs"),
)
#: Outside package: the only rooms that may import it.
ONLY_IN = {
    "pymunk": {"world.navigation.physics"},
    "gymnasium": {"envs", "sb3", "render", "training", "evaluation.dataset"},
    "pettingzoo": {"envs"},
    **{package: {"ros"} for package in ("rclpy", *MESSAGES)},
    **{package: {"web"} for package in ("starlette", "uvicorn", "websockets", "segno")},
    "torch": {"training", "evaluation.rounds.scenarios"},
    "stable_baselines3": {"sb3", "training"},
    "sb3_contrib": {"training"},
    "minari": {"evaluation.dataset"},
    "h5py": {"evaluation.dataset"},
    "jax": {"evaluation.dataset"},
    "ray": {"executors.ray_cluster"},
    "onnxruntime": {"policies.learned"},
    "onnx": {"training"},
}
#: Public names for which neither Gymnasium nor PettingZoo is needed.
LIGHT = ("make_config", "load_map", "Situation", "make_policy")
MODULES = sorted(path for path in PACKAGE.rglob("*.py"))


def module_name(path: Path) -> str:
    """Below the package: ``world.grid`` for ``pacman_env/world/navigation/grid.py``."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def executed(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes except those that only a type checker runs."""
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        children = node.orelse
    else:
        yield node
        children = list(ast.iter_child_nodes(node))
    for child in children:
        yield from executed(child)


def imports(source: str, name: str, is_package: bool, top: str = "pacman_env") -> set[str]:
    """Absolute names that a module imports; ``from x import y`` counts as ``x.y``."""
    found = set()
    package = f"{top}.{name}".rstrip(".").split(".")
    package = package if is_package else package[:-1]
    for node in executed(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{module}.{alias.name}" for alias in node.names}
    return found


@functools.cache
def imports_of(path: Path) -> set[str]:
    return imports(path.read_text(), module_name(path), path.name == "__init__.py")


def room(name: str) -> str:
    return name.split(".")[0]


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_module_imports_only_same_or_lower_floors(path: Path) -> None:
    name = module_name(path)
    if not name:
        return  # the package's own __init__ is tested below
    here = room(name)
    for imported in imports_of(path):
        outside, _, inner = imported.partition(".")
        if outside in TOP:
            pytest.fail(f"{name} imports {imported}, which is not part of the package")
        if outside != "pacman_env" or not inner or inner.startswith("__"):
            continue
        there = room(inner)
        assert FLOOR[there] <= FLOOR[here], f"{name} imports {imported} from a higher floor"
        assert (here, there) not in SAME_FLOOR_BUT_UNRELATED, f"{name} imports {imported}"


@pytest.mark.parametrize("package", ONLY_IN)
def test_outside_package_is_imported_only_where_allowed(package: str) -> None:
    users = {module_name(path) for path in MODULES if any(room(i) == package for i in imports_of(path))}
    assert {u for u in users if u not in ONLY_IN[package] and room(u) not in ONLY_IN[package]} == set()


def test_package_imports_only_its_version_and_registration() -> None:
    assert {i for i in imports_of(PACKAGE / "__init__.py") if room(i) == "pacman_env"} == {
        "pacman_env._version.__version__",
        "pacman_env.envs.registration.register_envs",
        "pacman_env.envs.registration.register_when_imported",
    }


def test_modules_are_imported_by_name_only_where_listed() -> None:
    """What the tests above cannot see."""
    users = {module_name(path) for path in MODULES if "import_module(" in path.read_text()}
    assert users == {
        "",  # the modules of public names
        "cli.main",  # commands
        "evaluation.rounds.scenarios",  # a checkpoint of training
        "plugins",
        "ros.node",  # the nodes of the table of processes
        "ros.topics",  # message types
        "sim.maps.levels_ahead",  # filelock
    }


@pytest.mark.parametrize(
    ("code", "said", "unneeded"),
    [
        ("import pacman_env", "", "gymnasium torch numba cv2 pymunk onnxruntime rclpy matplotlib pygame"),
        ("import pacman_env, gymnasium; print('pacman_env/PacManBot-v1' in gymnasium.registry)", "True", "torch numba"),
        ("import pacman_env; print('ppo' in pacman_env.policy_names())", "True", "onnxruntime torch pymunk rclpy"),
        *((f"from pacman_env import {name}", "", "gymnasium pettingzoo torch") for name in LIGHT),
        (
            "import pacman_env; [getattr(pacman_env, name) for name in pacman_env.__all__]",
            *("", "torch stable_baselines3 matplotlib pygame rclpy starlette"),
        ),
        ("import pacman_env.ros.supervisor.warm_up", "", "rclpy torch"),  # for `warm-up --robot` without ROS
    ],
)
def test_import_loads_no_unneeded_library(code: str, said: str, unneeded: str) -> None:
    code = f"{code}\nimport sys; print(*{{*{unneeded.split()}}} & {{*sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == said.split()
