"""Write the scripts of the page docs/replay.md: one round of two policies, and the web page that shows it.

``python -m tools.site`` calls it. Nothing that it writes is committed, and the site needs no server.
"""

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Any

import msgspec

from pacman_env.web.played_round import PlayedRound
from pacman_env.web.recordings import Recordings
from pacman_env.web.rules import Choices, Rules
from pacman_env.web.simulated_view import scene_of
from pacman_env.web.vocabulary import vocabulary
from tools.bundle import bundle
from tools.common import ROOT, STATIC

SEED = 7  # clyde_aware is caught on its way to the last pellet, ppo collects all
POLICIES = ("clyde_aware", "ppo")


def record(policy: str, second: str, seed: int = SEED) -> dict[str, Any]:
    """Play a round and return what the server sends about it (docs/dev/web_protocol.md), with the map in the scene.

    The result contains ``entry`` (as in ``stories``), ``scene``, ``frames`` and ``whys``: the terms by tick, wherever
    the goal changes or the second policy would choose another goal.
    """
    rules, recordings = Rules(policy=policy, second=second), Recordings()
    played = PlayedRound(*Choices().prepare(rules, None), (policy, second), seed)
    played.finish()
    scene = scene_of(played, rules, 1)
    recordings.keep(played, map=rules.map, round=1, revision=scene.revision, link=scene.facts["link"])
    entry = recordings.summaries()[0]
    url = f"data:image/png;base64,{base64.b64encode(scene.picture).decode()}"
    return {
        "entry": entry,
        "scene": {**scene.facts, "map": {**scene.facts["map"], "url": url}},
        "frames": msgspec.Raw(recordings.frames(1) or b""),
        "whys": {tick: played.why(tick) for tick in sorted({*entry["decisions"], *entry["parts"]})},
    }


def write(folder: Path) -> None:
    """Write ``replay_page.js`` and ``replay_rounds.js`` into a folder."""
    rounds = [record(policy, second) for policy, second in (POLICIES, POLICIES[::-1])]
    packed = gzip.compress(msgspec.json.encode({"hello": vocabulary(), "rounds": rounds}), mtime=0)
    markup = (STATIC / "index.html").read_text(encoding="utf-8")
    sheets = re.findall(r'rel="stylesheet" href="static/([^"]+)"', markup)
    sources = [*(STATIC / sheet for sheet in sheets), ROOT / "docs" / "_static" / "replay.css"]
    style = "".join(path.read_text(encoding="utf-8") for path in sources)
    style = re.sub(r":root(\[[^]]*\])", r":host(\1)", style).replace(":root", ":host")  # of a shadow root
    texts = f"style: {json.dumps(style)},\nmarkup: {json.dumps(markup)}"
    modules = bundle("map", "why", "player", "state", "dom")
    page = f"{{ {texts},\nmodules: {modules} }}"
    for name, value in {"page": page, "rounds": f'"{base64.b64encode(packed).decode()}"'}.items():
        (folder / f"replay_{name}.js").write_text(f"window.replay_{name} = {value};\n", encoding="utf-8")
