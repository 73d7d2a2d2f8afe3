"""Write the folder of the page that plays without a server: its modules, its first messages, and the game."""

import gzip
import json
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pacman_env import __version__
from pacman_env.sim.ghost_state import BEHAVIOUR_NAMES
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.recordings import encoded
from pacman_env.web.rules import PLAY, Choices, Rules
from pacman_env.web.simulated_view import scene_of
from pacman_env.web.vocabulary import vocabulary
from tools.common import ROOT, STATIC

_SEED = 22  # of the first round: the robot catches a ghost, and collects all pellets
_ABOUT = (
    "Play Pac-Man with a robot in a house, or watch how a trained planner plays it: in your browser, without a server."
)
#: As strict as the policy of the server (pacman_env/web/access.py); a page cannot forbid by itself to be framed.
_POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'"
)


def write(folder: Path, places: Sequence[str]) -> None:
    """Write everything but the game itself; ``places`` are the names of its maps."""
    shutil.copytree(STATIC, folder / "static", ignore=shutil.ignore_patterns("index.html"), dirs_exist_ok=True)
    shutil.copytree(Path(__file__).parent / "page", folder / "game", dirs_exist_ok=True)
    shutil.copy(ROOT / "docs" / "images" / "web-1440.png", folder / "preview.png")
    (folder / "index.html").write_text(_index(), encoding="utf-8")
    (folder / "game" / "hello.json").write_text(json.dumps(_hello(places)), encoding="utf-8")
    first = json.dumps(_first(), separators=(",", ":")).encode()
    (folder / "game" / "first.json.gz").write_bytes(gzip.compress(first, 9, mtime=0))


def _index() -> str:
    """Return the page of the server with what differs: its description and policy, and the script of the game."""
    address = os.environ.get("READTHEDOCS_CANONICAL_URL", "")  # as in docs/conf.py
    picture = f"{address.rstrip('/')}/play/preview.png" if address else "preview.png"
    head = f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
    head += f'<meta property="og:image" content="{picture}">\n'
    modules = [path.name for path in sorted(STATIC.glob("*.js")) if path.name != "support.js"]
    head += "".join(f'<link rel="modulepreload" href="static/{name}">\n' for name in modules)
    text = (STATIC / "index.html").read_text(encoding="utf-8")
    text = re.sub(r'(name="|og:)description" content="[^"]*', rf'\1description" content="{_ABOUT}', text)
    return text.replace("<html ", '<html data-game="game/worker.js" ', 1).replace("<title>", f"{head}<title>", 1)


def _hello(places: Sequence[str]) -> dict[str, Any]:
    choices = {
        "maps": [*dict.fromkeys(place.partition("-")[0] for place in places)],
        "levels": sum("-" in place for place in places),
        "policies": ["ppo"],
        "behaviours": BEHAVIOUR_NAMES,
        "presets": {},
        "settings": [],
        "speeds": [1, 3, 6],
        "play": Choices().facts()["play"],
    }
    facts = {"version": __version__, "source": "browser", "access": "operator", "you": "you", "choices": choices}
    return {"kind": "hello", **vocabulary(), **facts}


def _first() -> dict[str, Any]:
    """Return the round that is prepared first, as ``ppo`` plays it: its setup, its scene and its frames."""
    rules = Rules(preset=PLAY["preset"], ghosts=PLAY["ghosts"], settings=PLAY["settings"])
    played = PlayedRound(*Choices().prepare(rules, PLAY["clyde_mps"]), (rules.policy,), _SEED)
    played.finish()
    scene = scene_of(played, rules, 1).facts | {"kind": "scene", "revision": 1, "second": None}
    scene["map"] |= {"url": f"game/maps/{rules.map}.png"}
    setup = {"map": rules.map, "seed": _SEED, **{name: PLAY[name] for name in ("ghosts", "clyde_mps", "settings")}}
    frames = json.loads(encoded(played, 1, 1), parse_float=lambda text: round(float(text), 3))
    return {"setup": setup, "scene": scene, "frames": frames}
