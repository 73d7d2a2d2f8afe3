"""What both environments do with their arguments: configuration, map assets, a batch of games."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..config import Config, ConfigError, make_config
from ..sim.assets import MapSource, map_assets
from ..sim.batch import GameBatch

RENDER_FPS = 2  # one frame per decision, in real time


def make_batch(
    n: int,
    map_source: MapSource,
    preset: str,
    execution: str,
    settings: Mapping[str, Any] | None,
    config: Config | None,
    home: tuple[float, float, float] | None,
) -> GameBatch:
    """A batch of ``n`` games from an environment's arguments.

    Raises:
        ConfigError: ``config`` together with what it replaces, an unknown name, or a value out of range.
        MapError: the map cannot be read or played on.
    """
    if config is None:
        config = make_config(preset, execution, **(settings or {}))
    elif settings or (preset, execution) != ("robot", "robust"):
        raise ConfigError("give either config or preset, execution and settings, not both")
    return GameBatch(map_assets(map_source, config, home), config, n)


def check_render_mode(render_mode: str | None, known: list[str]) -> None:
    """Raise ValueError for a render mode that the environment does not have."""
    if render_mode is not None and render_mode not in known:
        raise ValueError(f"render_mode = {render_mode!r}: choose one of {known} or None")
