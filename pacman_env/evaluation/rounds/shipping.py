"""Send matchups to other machines: maps as pixels, policy files as bytes that are never unpickled."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from pacman_env.engine.cache_folder import cache_dir
from pacman_env.evaluation.rounds.play import Matchup, Played, play_matchup
from pacman_env.files import replaced
from pacman_env.world.maps.occupancy import load_map, shipped_maps

_METADATA = {".onnx": ".json", ".zip": ".facts.json"}  # suffix of a policy file: suffix of its metadata file


@dataclass(frozen=True)
class PackedMatchup:
    """A matchup with the pixels of its map and the content of its policy files, by path and file name."""

    matchup: Matchup
    files: dict[str, dict[str, bytes]]


def pack(matchup: Matchup) -> PackedMatchup:
    """Read the files of a matchup; other names stay unchanged, the worker resolves them."""
    scenario = matchup.scenario
    if isinstance(scenario, str) and scenario not in shipped_maps():
        scenario = load_map(scenario)
    return PackedMatchup(replace(matchup, scenario=scenario), contents([matchup.policy, *matchup.config.clyde.ghosts]))


def play_packed(task: PackedMatchup) -> Played:
    """Play a matchup on the worker, from copies of its files named by their content."""
    matchup, places = task.matchup, {spec: write_cached(content, spec) for spec, content in task.files.items()}
    ghosts = tuple(places.get(name, name) for name in matchup.config.clyde.ghosts)
    config = matchup.config.with_fields(**{"clyde.ghosts": ghosts})
    return play_matchup(replace(matchup, config=config, policy=places.get(matchup.policy, matchup.policy)))


def hash_of_files(path: Path) -> str:
    """Return the hash of a policy file and its metadata file."""
    return _hash((Path(name).suffix, data) for name, data in _content(path).items())


def contents(specs: Iterable[str]) -> dict[str, dict[str, bytes]]:
    """Return the content of policy files and their metadata files, by spec and file name."""
    return {spec: _content(Path(spec)) for spec in specs if Path(spec).suffix.lower() in _METADATA}


def _content(path: Path) -> dict[str, bytes]:
    metadata = path.with_suffix(_METADATA[path.suffix.lower()])
    return {one.name: one.read_bytes() for one in (path, metadata) if one is path or one.is_file()}


def write_cached(content: dict[str, bytes], spec: str) -> str:
    """Write the policy files of :func:`contents` to the cache and return the path of the policy."""
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
