"""The import order of the package: a folder uses only its own and lower layers (docs/architecture.md, "Layers")."""

from __future__ import annotations

import ast
import functools
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pacman_env"
FLOORS = (
    ("config", "engine", "command_line", "plugins", "rng", "files", "_version"),
    ("world", "game"),
    ("levels",),
    ("sim",),
    ("observations",),
    ("policies",),
    ("heuristics",),
    ("envs", "render", "episodes", "sb3"),
    ("web", "ros"),
    ("executors",),
    ("training", "evaluation"),
    ("cli",),
)
#: Folders beside the package; nothing in it imports them.
TOP = ("train", "eval", "benchmarks", "tools", "tests")
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
SAME_FLOOR_BUT_UNRELATED = {
    *(("world", "game"), ("game", "world"), ("training", "evaluation"), ("evaluation", "training")),
}
#: Imports by name against the order: checkpoints as policies of a comparison.
KNOWN_ARROWS = {("evaluation.rounds.scenarios", "training.checkpoint")}
#: Programs that write the pages of the command.
USERS_OF_CLI = {"tools/commands.py", "tools/reference.py"}
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
    "torch": {"sb3", "training", "evaluation.rounds.scenarios"},
    "stable_baselines3": {"sb3", "training"},
    "sb3_contrib": {"training"},
    "minari": {"evaluation.dataset"},
    "h5py": {"evaluation.dataset"},
    "jax": {"evaluation.dataset"},
    "ray": {"executors.ray_cluster"},
    "onnxruntime": {"policies.learned"},
    "onnx": {"sb3", "training"},
}
#: Public names for which neither Gymnasium nor PettingZoo is needed.
LIGHT = ("make_config", "load_map", "Situation", "make_policy")
MODULES = sorted(path for path in PACKAGE.rglob("*.py"))


def module_name(path: Path) -> str:
    """Below the package: ``world.navigation.grid`` for ``pacman_env/world/navigation/grid.py``."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_name(path) for path in MODULES}


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


@functools.cache
def used_modules(path: Path) -> set[str]:
    """Modules of the package that a module imports, by a statement or by ``import_module``, below the package."""
    found = {name.removeprefix("pacman_env.") for name in imports_of(path) if name.startswith("pacman_env.")}
    if "import_module(" in path.read_text():
        texts = [node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)]
        found |= {text.removeprefix("pacman_env.") for text in texts if isinstance(text, str)} & NAMES
    return {resolved(name) for name in found} - {"", module_name(path)}


def resolved(name: str) -> str:
    """The module of an imported name, which may be a function of it."""
    while name and name not in NAMES:
        name = name.rpartition(".")[0]
    return name


def place(name: str) -> str:
    """The folder of the second level that contains a module, or the module if it lies directly in its room."""
    folder = ".".join(name.split(".")[:2])
    return folder if (PACKAGE / folder.replace(".", "/")).is_dir() else name


@functools.cache
def arrows() -> set[tuple[str, str]]:
    """Pairs of places of which the first imports the second."""
    found = {(module_name(path), used) for path in MODULES for used in used_modules(path) if module_name(path)}
    return {(place(one), place(other)) for one, other in found if place(one) != place(other)}


def room(name: str) -> str:
    return name.split(".")[0]


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_module_imports_only_same_or_lower_floors(path: Path) -> None:
    name = module_name(path)
    if not name:
        return  # the package's own __init__ is tested below
    here = room(name)
    assert {room(imported) for imported in imports_of(path)}.isdisjoint(TOP)
    for used in used_modules(path):
        there = room(used)
        assert FLOOR[there] <= FLOOR[here], f"{name} imports {used} from a higher floor"
        forbidden = (here, there) in SAME_FLOOR_BUT_UNRELATED
        assert forbidden == ((name, used) in KNOWN_ARROWS), f"{name} imports {used}"


def test_folders_inside_rooms_import_in_one_direction() -> None:
    assert {(module_name(path), used) for path in MODULES for used in used_modules(path)} >= KNOWN_ARROWS
    ordered = TopologicalSorter[str]()
    for one, other in arrows():
        ordered.add(one, other)
    ordered.prepare()  # raises CycleError, which names the circle


def test_only_cli_itself_imports_cli() -> None:
    assert {one for one, other in arrows() if room(other) == "cli"} <= {place(n) for n in NAMES if room(n) == "cli"}
    programs = [path for folder in (*TOP, "docs") if folder != "tests" for path in (ROOT / folder).rglob("*.py")]
    imported = {path.relative_to(ROOT).as_posix(): imports(path.read_text(), "", False) for path in programs}
    assert {
        path for path, names in imported.items() if any(n.startswith("pacman_env.cli") for n in names)
    } == USERS_OF_CLI


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
    """The tests above see constants of these modules, not names that others give."""
    users = {module_name(path) for path in MODULES if "import_module(" in path.read_text()}
    assert users == {
        "",  # the modules of public names
        "cli.main",  # commands
        "evaluation.rounds.scenarios",  # a checkpoint of training
        "plugins",
        "ros.topics",  # message types
        "levels.levels_ahead",  # filelock
    }


@pytest.mark.parametrize(
    ("code", "said", "unneeded"),
    [
        ("import pacman_env", "", "gymnasium torch numba cv2 pymunk onnxruntime rclpy matplotlib pygame"),
        ("import pacman_env, gymnasium; print('pacman_env/PacManBot-v2' in gymnasium.registry)", "True", "torch numba"),
        ("import pacman_env; print('ppo' in pacman_env.policy_names())", "True", "onnxruntime torch pymunk rclpy"),
        *((f"from pacman_env import {name}", "", "gymnasium pettingzoo torch") for name in LIGHT),
        (
            "import pacman_env; [getattr(pacman_env, name) for name in pacman_env.__all__]",
            *("", "torch stable_baselines3 matplotlib pygame rclpy starlette"),
        ),
        ("import pacman_env.ros.selector.policy_child", "", "rclpy torch"),  # for `warm-up --robot` without ROS
    ],
)
def test_import_loads_no_unneeded_library(code: str, said: str, unneeded: str) -> None:
    code = f"{code}\nimport sys; print(*{{*{unneeded.split()}}} & {{*sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == said.split()
