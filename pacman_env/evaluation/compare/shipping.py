"""Blocks for other machines: the files that they name travel with them, by content, as bytes that nothing unpickles."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from pacman_env.engine.cache_folder import cache_dir
from pacman_env.evaluation.compare.workers import Block, Played, play_block
from pacman_env.files import replaced
from pacman_env.world.maps.occupancy import load_map, shipped_maps

_BESIDE = {".onnx": ".json", ".zip": ".facts.json"}  # a policy's file, and what lies beside it


@dataclass(frozen=True)
class Sent:
    """A block whose map is pixels, and the content of the policies' files that it names, by path and file name."""

    block: Block
    files: dict[str, dict[str, bytes]]


def sent(block: Block) -> Sent:
    """Raises what reading the files raises; a name that is no file stays one, for the worker to find."""
    scenario = block.scenario
    if isinstance(scenario, str) and scenario not in shipped_maps():
        scenario = load_map(scenario)
    return Sent(replace(block, scenario=scenario), contents([block.policy, *block.config.clyde.ghosts]))


def play_sent(task: Sent) -> Played:
    """On the worker, whose copies of the files are named by their content."""
    block, places = task.block, {spec: kept(content, spec) for spec, content in task.files.items()}
    ghosts = tuple(places.get(name, name) for name in block.config.clyde.ghosts)
    config = block.config.with_fields(**{"clyde.ghosts": ghosts})
    return play_block(replace(block, config=config, policy=places.get(block.policy, block.policy)))


def hash_of_files(path: Path) -> str:
    """Of the content of a policy's file and of what lies beside it."""
    return _hash((Path(name).suffix, data) for name, data in _content(path).items())


def contents(specs: Iterable[str]) -> dict[str, dict[str, bytes]]:
    """Of the policies that are files, by spec: the content of each file, and of what lies beside it, by its name."""
    return {spec: _content(Path(spec)) for spec in specs if Path(spec).suffix in _BESIDE}


def _content(path: Path) -> dict[str, bytes]:
    beside = path.with_suffix(_BESIDE[path.suffix])
    return {one.name: one.read_bytes() for one in (path, beside) if one is path or one.is_file()}


def kept(content: dict[str, bytes], spec: str) -> str:
    """Where the files of a policy are now, of :func:`contents`."""
    folder = cache_dir() / "sent" / _hash(content.items())
    try:
        _write(content, folder)
    except OSError as error:
        raise OSError(f"{folder}: cannot be written: {error.strerror}") from None
    return str(folder / Path(spec).name)


def _write(content: dict[str, bytes], folder: Path) -> None:
    for own, data in content.items():
        path = folder / own
        if not path.is_file() or path.read_bytes() != data:
            path.parent.mkdir(parents=True, exist_ok=True)
            with replaced(path) as temporary:
                temporary.write_bytes(data)


def _hash(content: Iterable[tuple[str, bytes]]) -> str:
    digest = hashlib.sha256()
    for name, data in sorted(content):
        digest.update(f"{name} {len(data)} ".encode() + data)
    return digest.hexdigest()[:24]
