"""What waits for a viewer stays small, and the newest is sent; how much a viewer may send."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from pacman_env.web.viewers import MOST_PICTURES, MOST_TEXTS, PATIENCE, Audience, Outbox, RateLimit, Viewer
from tests.web.frames import decode
from tests.web.scripted_game import ScriptedGame


def viewer(name: str = "ann", rate: float = 50.0) -> Viewer:
    return Viewer(name, "operator", RateLimit(rate, 0.0))


def taken(one: Viewer | Outbox) -> list[Any]:
    """What waits, as objects."""
    outbox = one.outbox if isinstance(one, Viewer) else one

    async def take() -> list[str]:
        return await asyncio.wait_for(outbox.get(), 1.0)

    try:
        things = asyncio.run(take())
    except TimeoutError:
        return []
    return [json.loads(thing) for thing in things]


def kinds(things: list[Any]) -> list[str]:
    return [thing["kind"] for thing in things]


def audience(game: ScriptedGame, *here: Viewer, most: int = 100) -> Audience:
    there = Audience(game, most, lambda: {"viewers": len(there.viewers)})
    for one in here:
        there.viewers.append(one)
    return there


def tick(there: Audience) -> None:
    there.send(there.poll())


def test_of_frames_the_newest_alone_waits_and_texts_keep_their_order() -> None:
    outbox = Outbox()
    for k in range(1000):
        outbox.put_frame(str(k))
        if k % 100 == 0:
            outbox.put_text(json.dumps({"kind": str(k)}))
    assert taken(outbox) == [*({"kind": str(k)} for k in range(0, 1000, 100)), 999]


def test_a_viewer_that_receives_nothing_gets_good_bye_and_nothing_else() -> None:
    for texts in (["{}"] * (MOST_TEXTS + 1), ["x" * (3 << 20)] * 2):
        outbox = Outbox()
        for text in texts:
            outbox.put_text(text)
        outbox.put_frame("{}")
        assert outbox.ended.is_set()
        things = taken(outbox)
        assert kinds(things) == ["bye"]
        assert "slow" in things[0]["words"]
        assert taken(outbox) == []


def test_one_waits_for_what_is_not_there_yet() -> None:
    async def run() -> list[str]:
        outbox = Outbox()
        taking = asyncio.ensure_future(outbox.get())
        await asyncio.sleep(0)
        assert not taking.done()
        outbox.put_frame("now")
        return await taking

    assert asyncio.run(run()) == ["now"]


@given(st.lists(st.floats(0, 2), max_size=300), st.sampled_from([1.0, 5.0, 50.0]))
def test_within_any_time_no_more_passes_than_the_rate(steps: list[float], rate: float) -> None:
    limit, now, passed = RateLimit(rate, 0.0), 0.0, 0
    for step in steps:
        now += step
        passed += limit.allows(now)
        assert passed <= rate * (now + 1.0) + 1e-6


def test_a_viewer_over_the_rate_is_warned_once_a_second_and_then_disconnected() -> None:
    one, allowed, now, words = viewer(), 0, 0.0, []
    while not one.outbox.ended.is_set() and now < 60.0:
        now += 0.005  # 200 a second
        allowed += one.is_within_rate(now)
        if one.outbox._texts:
            words += kinds(taken(one))
    assert one.over == PATIENCE
    assert allowed <= 50 * (now + 1)
    assert words[-1] == "bye"
    assert 1 <= words.count("refused") == len(words) - 1 <= now + 1


def test_a_viewer_seldom_over_the_rate_stays() -> None:
    one = viewer()
    for second in range(0, 600, 3):
        for _ in range(60):
            one.is_within_rate(float(second))
        one.outbox._texts.clear()
    assert not one.outbox.ended.is_set()


def test_all_are_shown_the_same_bytes_and_the_frame_is_made_once() -> None:
    people = [viewer(str(k)) for k in range(50)]
    game = ScriptedGame()
    there = audience(game, *people)
    tick(there)
    shown = [asyncio.run(one.outbox.get()) for one in people]
    assert all(kinds(list(map(json.loads, texts))) == ["scene", "people", "frame"] for texts in shown)
    assert len({id(texts[-1]) for texts in shown}) == 1
    assert decode(shown[0][-1]).number == game.number


def test_a_game_that_stands_still_is_not_shown_again_but_to_newcomers() -> None:
    first, second = viewer("ann"), viewer("bob")
    there = audience(ScriptedGame(moves=False), first)
    tick(there)
    assert kinds(taken(first)) == ["scene", "people", "frame"]
    tick(there)
    there.viewers.append(second)
    tick(there)
    assert kinds(taken(second)) == ["scene", "people", "frame"]
    assert kinds(taken(first)) == ["people"]


def test_a_new_scene_comes_before_its_frames_and_the_last_pictures_are_kept() -> None:
    game, one = ScriptedGame(), viewer()
    there = audience(game, one)
    for revision in range(1, 10):
        game.revision = revision
        tick(there)
        things = taken(one)
        assert things[0]["revision"] == things[-1]["revision"] == revision
        assert things[0]["map"]["url"] == f"map/{revision}.png"
    assert list(there.pictures) == list(range(10 - MOST_PICTURES, 10))


def test_news_are_sent_once_and_only_those_since_the_viewer_came() -> None:
    game, one = ScriptedGame(), viewer()
    game.happens(event="before")
    there = audience(game, one)
    tick(there)
    assert "news" not in kinds(taken(one))
    game.happens(event="start")
    game.happens(why={"rows": []})
    tick(there)
    (news,) = [thing for thing in taken(one) if kinds([thing]) == ["news"]]
    assert [item["event"] for item in news["items"]] == ["start"]
    tick(there)
    assert "news" not in kinds(taken(one))


def test_the_terms_are_requested_and_sent_only_while_they_are_watched() -> None:
    game, ann, bob = ScriptedGame(), viewer("ann"), viewer("bob")
    there = audience(game, ann, bob)
    ann.why = True
    tick(there)
    game.happens(why={"rows": []})
    tick(there)
    assert "news" in kinds(taken(ann))
    assert "news" not in kinds(taken(bob))
    there.remove(ann)
    tick(there)
    assert [call for call in game.calls if call[0] == "watch"] == [
        ("watch", True, False),
        ("watch", False, False),
    ]
    there.remove(bob)
    number = game.number
    tick(there)
    assert game.number == number  # nobody is here: it is left alone


def test_a_crowd_does_not_keep_an_operator_out() -> None:
    there = audience(ScriptedGame(), *(viewer(str(k)) for k in range(3)), most=3)
    assert not there.has_room("viewer")
    assert there.has_room("operator")
