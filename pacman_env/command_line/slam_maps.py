"""Maps made by SLAM, which ``scripts/slam_maps`` fetches into a checkout and commands call ``slam:NAME``."""

import argparse
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pacman_env.plugins import suggest

_CHECKOUT = Path(__file__).resolve().parents[2]
FOLDER = _CHECKOUT / "results" / "slam_maps"  # NAME/map.yaml and its image


def listed_maps() -> dict[str, Any]:
    """Return the maps of ``eval/slam_maps.yaml`` by name, with the fields that the file describes."""
    from pacman_env.config.yaml_files import read_yaml  # only then: it loads numpy, and `--help` should be quick

    return dict(read_yaml(_CHECKOUT / "eval" / "slam_maps.yaml"))


def map_source(text: str) -> str:
    """Return the file of the map ``slam:NAME``, relative to the current folder, or any other text unchanged.

    Raises argparse.ArgumentTypeError if there is no such map, or if it has not been fetched.
    """
    kind, _, name = text.partition(":")
    if kind != "slam" or not name:
        return text
    file = FOLDER / name / "map.yaml"
    try:
        if name not in (maps := listed_maps()):
            raise ValueError(suggest(name, maps))
        if not file.is_file():
            raise ValueError(f"{file} does not exist: run scripts/slam_maps")
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text}: {error} (see docs/maps.md)") from None
    return os.path.relpath(file)


def map_sources(texts: Iterable[str]) -> list[str]:
    """Return the texts, with the files of the league's maps in place of ``slam``; ValueError if one is absent."""
    try:
        league = [f"slam:{name}" for name, one in listed_maps().items() if "league" in one] if "slam" in texts else []
        return [map_source(one) for text in texts for one in (league if text == "slam" else [text])]
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"--map {error}") from None
