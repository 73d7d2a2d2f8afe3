"""HTML page of a comparison, a view of its results: tables, plot or heat map, film, and rounds worth a look."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from pacman_env.evaluation.compare import league_table
from pacman_env.evaluation.compare.heat_map import draw
from pacman_env.evaluation.compare.results import replay_command
from pacman_env.evaluation.compare.text_table import TextTable, group_title, groups, meaning, table_of, verdict
from pacman_env.evaluation.rounds.summary import Row
from pacman_env.evaluation.templates import render
from pacman_env.game.ends import ENDS

_ROUNDS_SHOWN = 12  # rounds shown that only one of two policies completes
_END_NAMES = {end.letter: end.name for end in ENDS}


def render_page(content: dict[str, Any], plot: Path | None, film: Path | None, poster: bytes | None) -> str:
    """Return the HTML page of a comparison's results; all text in the page is escaped.

    The page contains the plot (PNG), the film and the film's poster (PNG). A suite has a heat map instead of a plot.
    """
    rows = content["rows"]
    if content["suite"]:
        sections = list(_league_sections(content))
        about = _plain(league_table.MEANING)
        title, lead = f"League table of the suite {content['suite']}", league_table.headline(rows)
    else:
        power = content["config"]["power"]["pellets"] > 0
        sections = [_section(group_title(g[0]), verdict(g), table_of(g, power=power)) for g in groups(rows)]
        about = meaning(rows, power=power)
        title, lead = "Policies in the same rounds", sections[0]["lead"] if len(sections) == 1 else ""
    return render(
        "compare.html.j2",
        {"plain": _plain, "interval": _interval},
        r=content,
        title=title,
        lead=lead,
        about=about.replace("\n- ", "\n\n").split("\n\n"),
        sections=sections,
        pair=None if content["suite"] or rows[0]["kind"] == "endless" else _pair(content),
        rounds_shown=_ROUNDS_SHOWN,
        heat_map=Markup(draw(rows)) if content["suite"] else "",
        plot="" if plot is None else _data("image/png", plot.read_bytes()),
        film="" if film is None else _data("image/gif" if _is_gif(film) else "video/mp4", film.read_bytes()),
        poster="" if poster is None else _data("image/png", poster),
        moving_picture=film is not None and _is_gif(film),
        config=json.dumps(content["config"], indent=2),
    )


def _section(title: str, lead: str, table: TextTable) -> dict[str, Any]:
    return {"title": title, "lead": lead, **table._asdict()}


def _league_sections(content: dict[str, Any]) -> Iterator[dict[str, Any]]:
    rows = content["rows"]
    yield _section("Summary", league_table.ABOUT_MEANS, league_table.means(rows))
    for name, cells in league_table.groups_of(rows).items():
        yield _section(name.capitalize(), league_table.about_group(content, cells[0]), league_table.cell_table(cells))


def _pair(content: dict[str, Any]) -> dict[str, Any] | None:
    """Return the rounds that only one of the first two policies completes, with the commands that replay them."""
    first, *others = (policy["name"] for policy in content["policies"])
    if not others:
        return None
    found: dict[str, list[dict[str, Any]]] = {first: [], others[0]: []}
    for ours, theirs, *_ in groups(content["rows"]):
        for number, ends in enumerate(zip(ours["outcomes"]["end"], theirs["outcomes"]["end"], strict=True)):
            if (ends[0] == "C") == (ends[1] == "C"):
                continue
            round_ = {
                "number": number,
                "map": ours["map"],
                "speed": f"{ours['clyde_speed']:g}",
                "ends": [_outcome(row, number) for row in (ours, theirs)],
                "command": replay_command(content, theirs, number),
            }
            found[first if ends[0] == "C" else others[0]].append(round_)
    for rounds in found.values():  # the first ones show every map and speed
        rounds.sort(key=lambda round_: round_["number"])
    return {"names": [first, others[0]], "rounds": found}


def _outcome(row: Row, number: int) -> dict[str, Any]:
    some = row["outcomes"]
    return {"end": _END_NAMES[some["end"][number]], "pellets": some["collected"][number], "s": some["time_s"][number]}


def _plain(text: str) -> str:
    """Return Markdown text without the Markdown marks."""
    return text.replace("`", "").replace("*", "")


def _interval(text: str) -> Markup:
    """Format ``VALUE [LOW, HIGH]`` with the interval in small letters below the value."""
    value, bracket, limits = _plain(text).partition(" [")
    return Markup(f"{escape(value)}<small>[{escape(limits)}</small>") if bracket else escape(value)


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _is_gif(film: Path) -> bool:
    return film.suffix.lower() == ".gif"
