import base64
import re
from pathlib import Path

import pytest

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.replay import SPEED_UP, Change, RecordedGame, main
from pacman_env.evaluation.templates import render
from tests.evaluation.helpers import CONFIG, played, played_on_levels
from tests.evaluation.replay.test_video import film

SEED = str(episode_seeds(5, 1)[0])
SAME_AS_CONFIG = ["--execution", "as_built", "--spacing", "3", "--time-limit", "120"]


def test_replay_repeats_round_of_comparison(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "round.mp4"
    assert main([SEED, *SAME_AS_CONFIG, "--policies", "nearest", "clyde_aware", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert f"Round {SEED} on house, Clyde at 0.25 m/s" in text
    for policy in ("nearest", "clyde_aware"):
        record = played(policy)[0][0]
        words = f"after {record['time_s']:.1f} s, {record['collected']} of {record['spawned']} pellets"
        assert re.search(rf"^{policy}: \w+ {re.escape(words)}", text, re.M)
    longest = max(played(policy)[0]["time_s"][0] for policy in ("nearest", "clyde_aware"))
    assert len(film(out)) == 1 + round(longest / CONFIG.execution.tick_s) + 12
    assert list(out.parent.iterdir()) == [out]


def test_replay_names_level_of_round(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = played_on_levels("nearest")[0]
    options = ["--map", "generated:test", "--num-levels", "2", "--time-limit", "40", "--policies", "nearest"]
    assert main([str(record["seed"]), *options, "--out", str(tmp_path / "r.gif")]) == 0
    text = capsys.readouterr().out
    assert f"on generated:test, level {record['level']}," in text
    assert f"after {record['time_s']:.1f} s, {record['collected']} of {record['spawned']} pellets" in text


def test_replay_page_contains_film_and_loads_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["3", "--policies", "nearest", "--time-limit", "5", "--out", "page.html", "--theme", "dark"]) == 0
    text = (tmp_path / "page.html").read_text()
    (data,) = re.findall(r'src="data:video/mp4;base64,([^"]+)"', text)
    (tmp_path / "film.mp4").write_bytes(base64.b64decode(data))
    assert len(film(tmp_path / "film.mp4")) == 1 + 10 + 12
    assert not re.findall(r"https?://|<script src|<link", text)
    for line in re.findall(r"^  +(\S.*)$", capsys.readouterr().out, re.M):
        when, _, rest = line.partition("  ")
        goal, _, why = rest.partition(": ")
        (film_s,) = re.findall(rf'data-s="([\d.]+)">{when}</button><td>{re.escape(goal)}<td>{re.escape(why)}', text)
        assert float(film_s) == pytest.approx(float(when.removesuffix(" s")) / SPEED_UP, abs=0.01)


def test_film_is_written_to_results_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["12345678901234567890", "--policies", "nearest", "--time-limit", "2"]) == 0
    assert [p.name for p in (tmp_path / "results").iterdir()] == ["replay-12345678901234567890.mp4"]


def test_replay_page_escapes_texts_of_policy(tmp_path: Path) -> None:
    from pacman_env.evaluation.rounds.scenarios import open_scenario

    game = RecordedGame(open_scenario("house", CONFIG), CONFIG, "nearest", episode_seeds(5, 1)[0], "<b>policy</b>")
    game.changes.append(Change("1.0 s", "pellet & more", "<script>x"))
    text = render("replay.html.j2", title="a < b", video="", poster="", games=[game])
    for escaped in ("&lt;b&gt;policy", "pellet &amp; more", "&lt;script&gt;x", "<h1>a &lt; b</h1>"):
        assert escaped in text
    assert "<script>x" not in text
