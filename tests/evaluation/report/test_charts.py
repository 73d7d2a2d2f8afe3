from __future__ import annotations

import itertools
import re
import xml.etree.ElementTree as ET

import pytest

from pacman_env.evaluation.report.page import Line, curve_chart, interval_bar

LINES = [
    Line("first", [(0.2, 0.9, 0.8, 1.0), (0.4, 0.5, 0.4, 0.6)]),
    Line("<second> & more", [(0.2, 0.1, 0.0, 0.2), (0.4, 0.5, 0.3, 0.7)]),
]


def chart(lines: list[Line], **arguments: object) -> ET.Element:
    return ET.fromstring(curve_chart(lines, x_title="x", y_title="y", **arguments))  # type: ignore[arg-type]


def test_higher_rates_are_higher_and_bands_hold_their_lines() -> None:
    root = chart(LINES)
    points = [[tuple(map(float, p.split(","))) for p in e.get("points", "").split()] for e in root if e.get("points")]
    bands, lines = points[:2], points[2:]
    (x0, y0), (x1, y1) = lines[0]
    assert x0 < x1
    assert y0 < y1
    for band, line in zip(bands, lines, strict=True):
        upper, lower = band[: len(line)], band[len(line) :][::-1]
        for (_, high), (_, rate), (_, low) in zip(upper, line, lower, strict=True):
            assert high < rate < low


def test_names_are_escaped_and_do_not_cover_one_another() -> None:
    names = [e for e in chart(LINES * 3) if "name" in e.get("class", "")]
    assert {e.text for e in names} == {"first", "<second> & more"}
    heights = sorted(float(e.get("y", "")) for e in names)
    assert all(below - above > 16 for above, below in itertools.pairwise(heights))
    assert heights[-1] < 400


def test_marks_are_drawn_within_the_axis_only() -> None:
    root = chart(LINES, marks=[(0.3, "inside"), (0.7, "outside")])
    assert [e.text for e in root if e.get("class") == "note"] == ["inside"]


def test_one_speed_makes_a_chart_too() -> None:
    root = chart([Line("only", [(0.25, 1.0, 0.7, 1.0)])])
    assert [e.get("class") for e in root if e.tag == "circle"] == ["dot c0"]


@pytest.mark.parametrize(("value", "place"), [(0.0, 6), (0.5, 52), (1.0, 98)])
def test_a_bar_has_its_dot_in_its_place(value: float, place: float) -> None:
    dot = re.search(r'cx="([\d.]+)"', interval_bar(value, (value, value), 8))
    assert dot is not None
    assert float(dot[1]) == place
    assert "zero" not in interval_bar(value, (0, 1), 0)
    assert "zero" in interval_bar(value, (0, 1), 0, -1, 1)
