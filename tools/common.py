"""Shared helpers of the tools: folders of the checkout, Markdown tables, pages to write or check, arguments."""

import argparse
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import Parser
from pacman_env.files import write_text
from pacman_env.render.palette import Theme

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
STATIC = ROOT / "pacman_env" / "web" / "static"
SUFFIXES: dict[Theme, str] = {"light": "", "dark": "-dark"}  # of pictures' names: the site shows both


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def number(value: Any) -> str:
    return f"{round(float(value), 3):,g}" if abs(value) < 1e6 else f"{value:.0e}"


def literal(value: Any) -> str:
    return repr(value).replace("'", '"')


def as_arguments(kwargs: dict[str, Any]) -> str:
    return ", ".join(f"{name}={literal(value)}" for name, value in kwargs.items())


def update(path: Path, text: str, check: bool, complaint: str) -> int:
    """Write a page if it changed, or complain if ``check``; return the exit status."""
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        return 0
    if check:
        print(f"{path} {complaint}")
        return 1
    write_text(path, text)
    return 0


def save_film(frames: Sequence[Any], path: Path, frame_ms: int, last_ms: int) -> None:
    """Write RGB frames as an animated WebP without loss."""
    from PIL import Image

    first, *others = [Image.fromarray(frame) for frame in frames]
    small = {"lossless": True, "quality": 60, "method": 2, "kmin": 0, "kmax": 0}  # no key frames
    times_ms = [frame_ms] * len(others) + [last_ms]
    first.save(path, "WEBP", save_all=True, append_images=others, duration=times_ms, **small)


def add_names(parser: Parser, what: str, known: Collection[str]) -> None:
    """Add the positional argument ``names``: some of ``known``, or all if none is given."""

    def name(given: str) -> str:
        if given not in known:
            raise argparse.ArgumentTypeError(f"no {what} {given!r}: choose from {', '.join(known)}")
        return given

    parser.add_argument("names", nargs="*", type=name, metavar="NAME", help=f"which: {', '.join(known)} (all)")


def add_check(parser: Parser) -> None:
    parser.add_argument("--check", action="store_true", help="write nothing, compare with the files")


def add_images(parser: Parser, names: Collection[str]) -> None:
    """Add the names of pictures, and the option for their folder."""
    add_names(parser, "picture", names)
    parser.add_argument("--out", type=Path, default=IMAGES, metavar="FOLDER", help="where to (docs/images)")
