"""One round as a film, every policy side by side. Frames are drawn by ``pacman_env.envs.rendering``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray

from eval.episodes import allowed
from eval.files import replaced
from pacman_env.config import Config
from pacman_env.envs.rendering import render_frame
from pacman_env.policies.registry import make_policy
from pacman_env.sim.assets import MapAssets
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.records import RUNNING

SPEED_UP = 4.0
_LAST_FRAME_S = 1.5  # of film, so that the end can be seen

Frame = NDArray[np.uint8]


def round_frames(
    assets: MapAssets, config: Config, specs: Sequence[str], seed: np.uint64, *, height: int
) -> Iterator[Frame]:
    """Frames (H, W, 3), RGB, one per decision, until the last policy's round has ended."""
    batches = [GameBatch(assets, config, 1) for _ in specs]
    policies = [make_policy(spec) for spec in specs]
    for batch, policy in zip(batches, policies, strict=True):
        batch.reset(np.zeros(1, dtype=np.int64), np.array([seed], dtype=np.uint64))
        policy.reset(np.ones(1, dtype=np.bool_))
    panels = [render_frame(b, 0, height=height, title=s) for b, s in zip(batches, specs, strict=True)]
    yield np.hstack(panels)
    while any(batch.games["end"][0] == RUNNING for batch in batches):
        for k, (batch, policy) in enumerate(zip(batches, policies, strict=True)):
            if batch.games["end"][0] != RUNNING:
                continue
            situation = batch.situation()
            batch.step(allowed(situation, policy.select(situation), batch.hold))
            panels[k] = render_frame(batch, 0, height=height, title=specs[k])
        yield np.hstack(panels)


def save_video(frames: Iterator[Frame], path: Path, tick_s: float) -> None:
    """Write frames, ``tick_s`` apart and of even sides, as .mp4 or .gif, ``SPEED_UP`` times as fast."""
    fps = SPEED_UP / tick_s
    with replaced(path) as temporary:
        if path.suffix == ".gif":
            writer = imageio.get_writer(temporary, mode="I", duration=1000 / fps, loop=0)
        else:
            writer = imageio.get_writer(temporary, fps=fps, codec="libx264", macro_block_size=2)
        with writer:
            for frame in frames:
                writer.append_data(frame)
            for _ in range(round(_LAST_FRAME_S * fps)):
                writer.append_data(frame)
