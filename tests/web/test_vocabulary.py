"""Names and colours of the page have one home each, in Python."""

from __future__ import annotations

import re
from typing import get_args

from pacman_env.envs.outcome import OUTCOMES
from pacman_env.game.ghosts import GHOSTS
from pacman_env.game.round import State
from pacman_env.policies.base import KIND_NAMES
from pacman_env.web.control import ROLES
from pacman_env.web.routes import STATIC
from pacman_env.web.vocabulary import CANDIDATE_KINDS, RESULTS, STATES, vocabulary


def test_every_protocol_word_has_a_name() -> None:
    assert set(STATES) == set(get_args(State))
    assert set(RESULTS) == set(OUTCOMES) - {"running"}
    assert set(CANDIDATE_KINDS) == set(KIND_NAMES)
    assert set(vocabulary()["roles"]) == set(ROLES)


def test_scripts_contain_no_ghost_names_or_colours() -> None:
    for path in STATIC.glob("*.js"):
        text = path.read_text()
        for ghost in GHOSTS:
            assert not re.search(rf"\b{ghost.name}\b", text) or ghost.name == "clyde", path.name
            assert str(list(ghost.colour)) not in text, path.name
