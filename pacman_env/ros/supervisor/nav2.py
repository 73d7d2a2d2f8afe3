"""A real Nav2 for the simulated base: its start command, its parameters, and whether it is installed."""

import os
import shlex
import shutil
from pathlib import Path

import pacman_env
from pacman_env.ros.game_nodes import NAV2, NAV2_BRINGUP, NAV2_BY_HAND, GameSetup
from pacman_env.world.maps.occupancy import map_file

#: ``ros2 launch`` with Nav2's own launch file of localization and navigation.
BRINGUP = (
    "ros2 launch nav2_bringup bringup_launch.py namespace:={namespace} use_namespace:={in_namespace} map:={map} "
    "params_file:={params} use_sim_time:=True use_composition:=False"
)
FILES = ("nav2.yaml", "localization.yaml")  # in the checkout's folder ``config``; no key is in both files
PACKAGE = "nav2_bringup"
_APT = "sudo apt install ros-jazzy-navigation2 ros-jazzy-nav2-bringup ros-jazzy-ros2launch"
_INDEX = Path("share/ament_index/resource_index/packages")


def check(setup: GameSetup) -> None:
    """Raise a ValueError that lists the missing parts if Nav2 cannot be started here."""
    if not setup.nav2:
        return
    words = _words(setup, Path("params.yaml"))
    if setup.nav2 == NAV2_BRINGUP:
        is_installed = any((folder / _INDEX / PACKAGE).is_file() for folder in _prefixes())
        missing = [*(() if shutil.which(words[0]) else (words[0],)), *(() if is_installed else (PACKAGE,))]
        if missing:
            raise ValueError(
                f"--nav2: {' and '.join(missing)} not found: source /opt/ros/jazzy/setup.bash; where that does not "
                f"help, {_APT} (ROS 2 Jazzy); with a Nav2 of your own: --nav2 COMMAND, or --nav2 {NAV2_BY_HAND}"
            )
    if "{params}" in _template(setup):
        _files()
    if setup.starts_nav2 and shutil.which(words[0]) is None:
        raise ValueError(f"--nav2: the command {words[0]} is not found")


def command(setup: GameSetup, folder: Path) -> list[str]:
    """Return Nav2's start command as a module with arguments, and write its parameters into the folder."""
    params = folder / f"{NAV2}.yaml"
    if "{params}" in _template(setup):
        params.write_text("\n".join(path.read_text() for path in _files()))
    return ["pacman_env.ros.supervisor.foreign", *_words(setup, params.absolute())]


def _template(setup: GameSetup) -> str:
    return BRINGUP if setup.nav2 in (NAV2_BRINGUP, NAV2_BY_HAND) else setup.nav2


def _words(setup: GameSetup, params: Path) -> list[str]:
    namespace = setup.namespace.strip("/")
    parts = {"namespace": namespace, "in_namespace": str(bool(namespace)), "map": map_file(setup.map), "params": params}
    try:
        words = [word.format(**parts) for word in shlex.split(_template(setup))]
    except (ValueError, LookupError, AttributeError) as error:
        raise ValueError(
            f"--nav2 {setup.nav2!r}: no command ({error}); it may use {', '.join(parts)} in braces"
        ) from None
    if not words:
        raise ValueError("--nav2 '': no command")
    return words


def _prefixes() -> list[Path]:
    return [Path(path) for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]


def _files() -> list[Path]:
    """Return the parameter files of the checkout, or of the package installed by colcon."""
    shares = [Path(pacman_env.__file__).parents[1], *(path / "share" / "pacman_env" for path in _prefixes())]
    for share in shares:
        paths = [share / "config" / name for name in FILES]
        if all(path.is_file() for path in paths):
            return paths
    raise ValueError(f"--nav2: {' and '.join(FILES)} not found: install pacman_env from a checkout, pip install -e .")
