"""Build the page that plays without a server: ``python -m tools.browser_game FOLDER [MAP ...]``."""

import gzip
import sys
from collections.abc import Sequence
from pathlib import Path

from pacman_env.policies.learned import LearnedPlanner
from pacman_env.world.maps.occupancy import shipped_maps
from tools.browser_game import kernels, maps, module, page
from tools.browser_game.image import Image, flat, save
from tools.common import ROOT

PLACES = *shipped_maps(), *(f"generated-{level}" for level in range(20))


def build(folder: Path, work: Path, places: Sequence[str] = PLACES) -> None:
    """Write the files of the game into a folder; ``work`` keeps what a later build can use again."""
    (folder / "maps").mkdir(parents=True, exist_ok=True)
    work.mkdir(parents=True, exist_ok=True)
    called = kernels.called_functions()
    functions = {address: kernels.FIRST_FUNCTION + k for k, address in enumerate(called.values())}
    planner = LearnedPlanner()
    network = Image(module.BASE, functions)
    network.add(*flat(planner._session._network._asdict()).values())
    entries, stored = network.packed()
    header = {"entries": entries, "functions": [*called], "first": kernels.FIRST_FUNCTION}
    save(folder / "network.bin", header, stored)
    for place in places:
        name, _, level = place.partition("-")
        maps.write(name, int(level) if level else None, planner, network, folder / "maps" / f"{place}.bin")
    built = module.build(kernels.ENTRY_KERNELS | kernels.called_kernels(), [*called, "make_contacts", "malloc"], work)
    (folder / "game.wasm.bin").write_bytes(gzip.compress(built.read_bytes(), 9, mtime=0))


if __name__ == "__main__":
    folder, places = Path(sys.argv[1]), sys.argv[2:] or PLACES
    build(folder / "game", ROOT / "build" / "browser_game", places)
    page.write(folder, places)
