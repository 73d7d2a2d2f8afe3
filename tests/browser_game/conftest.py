"""The files of the page that plays without a server, built once."""

import gzip
import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from pacman_env import __version__
from pacman_env.sim.ghost_state import BEHAVIOUR_NAMES
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.recordings import encoded
from pacman_env.web.rules import PLAY, Choices, Rules
from pacman_env.web.simulated_view import scene_of
from pacman_env.web.vocabulary import vocabulary


@pytest.fixture(scope="session")
def browser_game(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder ``game`` of a page with the map loop."""
    if find_spec("ziglang") is None or shutil.which("node") is None:
        pytest.skip("needs ziglang and node")
    from tools.browser_game import __main__ as command

    folder = tmp_path_factory.mktemp("page") / "game"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "HOUSES", 0)
        patch.setattr(command, "shipped_maps", lambda: ["loop"])
        command.build(folder, Path("build/browser_game"))
    rules = Rules("loop", ghosts=PLAY["ghosts"], settings=PLAY["settings"])
    played = PlayedRound(*Choices().prepare(rules, PLAY["clyde_mps"]), ("ppo",), 3)
    scene = {"kind": "scene", **scene_of(played, rules, 1).facts}
    played.finish()
    setup = {"map": "loop", "seed": 3, "ghosts": rules.ghosts, "clyde_mps": PLAY["clyde_mps"], "settings": rules.settings}
    text = f'{{"setup": {json.dumps(setup)}, "scene": {json.dumps(scene)}, "frames": {encoded(played, 1, 1).decode()}}}'
    (folder / "first.json.gz").write_bytes(gzip.compress(text.encode()))
    choices = {"maps": ["loop", "generated"], "levels": 20, "speeds": [1, 3, 6], "behaviours": BEHAVIOUR_NAMES}
    hello = {"kind": "hello", **vocabulary(), "version": __version__, "you": "you", "choices": choices}
    (folder / "hello.json").write_text(json.dumps(hello))
    return folder
