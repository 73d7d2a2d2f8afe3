"""Nodes that only pass words on load no compiler, no image library and no simulator."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros.supervisor.game_nodes import WAIT, module_of

LIGHT_NODES = ("pellet_manager", "audio_node", "game_light_node", "game_event_mapper", "game_controller")
HEAVY = ("numba", "llvmlite", "cv2", "pymunk", "gymnasium", "onnxruntime", "scipy")


def test_light_nodes_import_nothing_heavy() -> None:
    modules = [module_of(name) for name in (*LIGHT_NODES, WAIT)]
    code = f"""
import importlib, json, sys
for module in {modules!r}:
    importlib.import_module(module)
import pacman_env.game.pellets, pacman_env.world.maps.occupancy
pellets = pacman_env.game.pellets.generate_pellets(
    pacman_env.world.maps.occupancy.load_map("house"), pacman_env.config.make_config().pellets
)
print(json.dumps([len(pellets), sorted(set({HEAVY!r}) & set(sys.modules))]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [13, []]
