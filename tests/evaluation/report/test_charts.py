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


def test_chart_places_rates_by_height_inside_their_bands() -> None:
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


def test_chart_names_are_escaped_and_do_not_overlap() -> None:
    names = [e for e in chart(LINES * 3) if "name" in e.get("class", "")]
    assert {e.text for e in names} == {"first", "<second> & more"}
    heights = sorted(float(e.get("y", "")) for e in names)
    assert all(below - above > 16 for above, below in itertools.pairwise(heights))
    assert heights[-1] < 400


def test_chart_draws_marks_only_within_axis() -> None:
    root = chart(LINES, marks=[(0.3, "inside"), (0.7, "outside")])
    assert [e.text for e in root if e.get("class") == "note"] == ["inside"]


def test_chart_with_one_speed_shows_one_dot() -> None:
    root = chart([Line("only", [(0.25, 1.0, 0.7, 1.0)])])
    assert [e.get("class") for e in root if e.tag == "circle"] == ["dot c0"]


@pytest.mark.parametrize(("value", "place"), [(0.0, 6), (0.5, 52), (1.0, 98)])
def test_interval_bar_places_dot_by_value(value: float, place: float) -> None:
    dot = re.search(r'cx="([\d.]+)"', interval_bar(value, (value, value), 8))
    assert dot is not None
    assert float(dot[1]) == place
    assert "zero" not in interval_bar(value, (0, 1), 0)
    assert "zero" in interval_bar(value, (0, 1), 0, -1, 1)
