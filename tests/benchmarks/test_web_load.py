"""The command that measures what the page costs, in a short run; how much it costs is not looked at."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import web_load
from benchmarks.web_load import main


def test_the_page_is_measured_beside_the_game(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(web_load, "WARM_S", 0.5)  # what is waited for makes figures better, none is needed
    out = tmp_path / "load.json"
    assert main(["--quick", "--json", str(out)]) == 0
    figures = json.loads(out.read_text())
    assert (figures["viewers"], figures["map"]) == (4, "house")
    assert figures["frames_per_s"] > 0.0  # those that were late come together: no bound from above in a short time
    assert figures["server_percent"] > 0.0
    assert 0.0 < figures["latency_ms"]["p50"] <= figures["latency_ms"]["p99"] <= figures["latency_ms"]["longest"]
    assert {*figures["tick_ms"], *figures["memory_mb"], *figures["game_percent"]} == {"with", "without"}
    assert "4 viewers, one of them reading nothing" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "words"), [(["--json", "."], "is a folder"), (["--map", "nowhere"], "nowhere")])
def test_what_cannot_be_measured_is_one_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--quick", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
