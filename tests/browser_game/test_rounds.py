"""Rounds of the browser's game are those of Python, to the bit, in Node and in two browsers."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.browser_game.conftest import ROUNDS
from tests.browser_game.firefox import Firefox
from tests.browser_game.proof import in_node, in_python
from tools.browser_game.image import _stored

#: Plays the rounds of the list that follows; returns their hashes.
_PLAY = """import("./rounds.mjs").then(async ({ play }) => {
  const load = async (name) => new Uint8Array(await (await fetch(name)).arrayBuffer());
  return (await play(load, ROUNDS)).map((one) => one.sha256);
})"""
#: Restores a stored array per line: its address, size, width, lag, apart and bytes.
_RESTORE = """
import { createInterface } from "readline";
import { restored } from "ENGINE";
for await (const line of createInterface({ input: process.stdin })) {
  const [, , width, lag, apart, bytes] = JSON.parse(line);
  console.log(JSON.stringify([...restored(new Uint8Array(bytes), width, lag, apart)]));
}"""


@pytest.fixture(scope="module")
def node(browser_game: Path) -> list[dict[str, Any]]:
    return in_node(ROUNDS, browser_game)


@pytest.fixture(scope="module")
def hashes(node: list[dict[str, Any]]) -> list[str]:
    return [one["sha256"] for one in node]


def test_node_plays_as_python_does(browser_game: Path, node: list[dict[str, Any]]) -> None:
    for one, mine in zip(node, in_python(ROUNDS, browser_game / "libm.so"), strict=True):
        assert (one["outcome"], one["choices"]) == (mine["outcome"], mine["choices"])
        np.testing.assert_array_equal(one["numbers"], mine["numbers"])
        assert one["sha256"] == mine["sha256"]
    assert {"complete", "caught"} == {one["outcome"] for one in node}


def test_chromium_plays_as_node_does(hashes: list[str], game_url: str, chromium: Any) -> None:
    page = chromium.new_page()
    page.goto(f"{game_url}game/")
    assert page.evaluate(_PLAY.replace("ROUNDS", json.dumps(ROUNDS))) == hashes
    page.close()


def test_firefox_plays_as_node_does(hashes: list[str], game_url: str, firefox: Firefox) -> None:
    firefox.open(f"{game_url}game/")
    assert firefox.value(_PLAY.replace("ROUNDS", json.dumps(ROUNDS))) == hashes


@pytest.fixture(scope="module")
def restoring(browser_game: Path) -> Iterator[subprocess.Popen[str]]:
    code = _RESTORE.replace("ENGINE", str(browser_game / "game" / "engine.js"))
    command = "node", "--input-type=module", "--eval", code
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process


@settings(max_examples=20)
@given(
    dtype=st.sampled_from(["bool", "int8", "uint16", "int32", "uint64", "float32"]),
    columns=st.integers(1, 7),
    steps=st.lists(st.integers(0, 300), min_size=1, max_size=9),
)
def test_stored_array_is_restored(restoring: subprocess.Popen[str], dtype: str, columns: int, steps: list[int]) -> None:
    array = np.resize(steps, (5000, columns)).cumsum(axis=0).astype(dtype)
    entry, stored = _stored(0, array, array.tobytes())
    assert restoring.stdin
    assert restoring.stdout
    print(json.dumps([*entry, [*stored]]), file=restoring.stdin, flush=True)
    assert bytes(json.loads(restoring.stdout.readline())) == array.tobytes()
