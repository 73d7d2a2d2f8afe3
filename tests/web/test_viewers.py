"""What waits for a viewer stays small, and the newest is sent; how much a viewer may send."""

import asyncio
import json
import time
from typing import Any

from pacman_env.web.viewers import MESSAGES_PER_S, MOST_PICTURES, MOST_TEXTS, PATIENCE, Audience, Outbox, Viewer
from tests.web.scripted_game import ScriptedGame

NEWCOMER = ["hello", "scene", "people", "frame"]


def viewer(name: str = "ann") -> Viewer:
    return Viewer(name, "operator")


def taken(outbox: Outbox) -> list[Any]:
    """Return what waits, as objects."""

    async def take() -> list[str]:
        return await asyncio.wait_for(outbox.get(), 1.0)

    outbox.put_text('"end"')  # so that something waits
    return [thing for thing in map(json.loads, asyncio.run(take())) if thing != "end"]


def kinds(one: Viewer) -> list[str]:
    return [thing["kind"] for thing in taken(one.outbox)]


def audience(game: ScriptedGame, *here: Viewer) -> Audience:
    there = Audience(game, 100, lambda: {"viewers": len(there.viewers)})
    for one in here:
        there.add(one, is_new=True)
    return there


def tick(there: Audience) -> None:
    there.send(there.poll())


def test_outbox_keeps_the_newest_frame_and_all_texts() -> None:
    outbox = Outbox()
    for k in range(1000):
        outbox.put_frame(str(k))
        if k % 100 == 0:
            outbox.put_text(json.dumps({"kind": str(k)}))
    assert taken(outbox) == [*({"kind": str(k)} for k in range(0, 1000, 100)), 999]


def test_outbox_ends_with_bye_when_too_much_waits() -> None:
    for texts in (["{}"] * (MOST_TEXTS + 1), ["x" * (3 << 20)] * 2):
        outbox = Outbox()
        for text in texts:
            outbox.put_text(text)
        outbox.put_frame("{}")
        (bye,) = taken(outbox)
        assert bye["kind"] == "bye"
        assert "slow" in bye["words"]
        assert asyncio.run(outbox.get()) == []


def test_viewer_over_the_rate_is_warned_then_disconnected() -> None:
    one, allowed = viewer(), 0
    began = now = time.monotonic()
    while not one.outbox.why_ended and now < began + 60.0:
        now += 0.005  # 200 a second
        allowed += one.is_within_rate(now)
    assert allowed <= MESSAGES_PER_S * (now - began + 1.0) + 1
    assert now - began > PATIENCE / 200
    assert kinds(one) == ["bye"]


def test_viewer_rarely_over_rate_stays_connected() -> None:
    one, now = viewer(), time.monotonic()
    for second in range(0, 600, 3):
        for _ in range(60):
            one.is_within_rate(now + second)
        assert kinds(one) == ["refused"]


def test_unchanged_frame_is_sent_to_newcomers_only() -> None:
    first, second, other = viewer("ann"), viewer("bob"), viewer("cid")
    there = audience(ScriptedGame(moves=False), first, other)
    tick(there)
    shown = [asyncio.run(one.outbox.get()) for one in (first, other)]
    assert [json.loads(text)["kind"] for text in shown[0]] == NEWCOMER
    assert shown[0][-1] is shown[1][-1], "a frame is encoded once for all"
    tick(there)
    there.add(second, is_new=True)
    tick(there)
    assert kinds(second) == NEWCOMER
    assert kinds(first) == ["people"]


def test_new_scene_comes_before_its_frames() -> None:
    game, one = ScriptedGame(), viewer()
    there = audience(game, one)
    tick(there)
    taken(one.outbox)
    for revision in range(2, 10):
        game.revision = revision
        tick(there)
        scene, frame = taken(one.outbox)
        assert scene["revision"] == frame["revision"] == revision
        assert scene["map"]["url"] == f"map/{revision}.png"
    assert list(there.pictures) == list(range(10 - MOST_PICTURES, 10))


def test_news_are_sent_once_and_only_after_joining() -> None:
    game, one = ScriptedGame(), viewer()
    game.happens(event="before")
    there = audience(game, one)
    tick(there)
    assert "news" not in kinds(one)
    game.happens(event="start")
    game.happens(why={"rows": []})
    tick(there)
    (news,) = [thing for thing in taken(one.outbox) if thing["kind"] == "news"]
    assert [item["event"] for item in news["items"]] == ["start"]
    tick(there)
    assert "news" not in kinds(one)


def test_score_terms_are_sent_only_while_watched() -> None:
    game, ann, bob = ScriptedGame(), viewer("ann"), viewer("bob")
    there = audience(game, ann, bob)
    ann.why = True
    tick(there)
    game.happens(why={"rows": []})
    tick(there)
    assert "news" in kinds(ann)
    assert "news" not in kinds(bob)
    there.remove(ann)
    tick(there)
    assert [call for call in game.calls if call[0] == "watch"] == [("watch", True, False), ("watch", False, False)]
    there.remove(bob)
    number = game.number
    tick(there)
    assert game.number == number, "nobody is here: the game is left alone"
