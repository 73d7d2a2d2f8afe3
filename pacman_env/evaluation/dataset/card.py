"""Card of a data set: ``README.md`` in its folder, for readers without this project."""

from pathlib import Path
from typing import Any

from pacman_env.files import write_text

_CARD = """\
---
license: mit
tags:
- reinforcement-learning
- imitation-learning
- gymnasium
- minari
pretty_name: {name}
---

# {name}

{rounds} rounds of PacManBot, a robot that plays Pac-Man in a house, {player} in
`{id}`; {decisions} decisions.

| | |
|---|---|
| map | `{map}`, hash `{map_hash}` |
| rounds completed | {completed:.1f} % |
| caught | {caught:.1f} % |
| mean return | {mean_return:.3f} |
| decisions without a listed action, played as *hold* | {unlisted} |
| observation space | `{observation_space}` |
| action space | `{action_space}` |
| version | pacman_env {version}, sources {sources}, commit {commit} |

## Command

```bash
{command}
```

{origin}

## Files

| File | Bytes | |
|---|---|---|
{files}

`python -c "import json; print(json.load(open('facts.json'))['settings'])"` prints the configuration.
{reading}
## Licence

MIT, as pacman_env.
"""
_MEANING = {
    "data/main_data.hdf5": "rounds, as Minari stores them",
    "data/metadata.json": "Minari's metadata: spaces, the environment's spec, the facts",
    "decisions.parquet": "a row for each decision: observation, mask, action, reward, end, seconds",
    "rounds.parquet": "a row for each round: seed, level, outcome, return, last observation",
    "facts.json": "all facts on this page, and all settings",
}
_SIMULATED = """\
The rounds depend on these arguments and on the version alone, not on the number of workers. Their seeds are drawn
from seed {seed}; rounds of one generated level are adjacent."""
_OF_A_ROBOT = """\
The rounds were recorded by `pacman-env ros record` in the bags {bags}. Observations contain what the robot knew at
each decision, and rewards follow from the reports of the game. Rounds of a robot have no seed (0 in the files) and
cannot be replayed. A round that a person ended is truncated, with the outcome *running*."""
_MINARI = """
```python
import minari

dataset = minari.load_dataset("{name}")  # below MINARI_DATASETS_PATH
episode = dataset[0]
```

Masks are `infos["action_mask"]`, or in the observation.
"""
_AGAIN = """
To replay a round, call `reset(options={"round_seed": seed})` in `dataset.recover_environment()`. The seed is
`options/round_seed` in the metadata of the episode.
"""
_TABLES = """
```python
import pandas

decisions = pandas.read_parquet("decisions.parquet")
rounds = pandas.read_parquet("rounds.parquet")
```
"""


def write_card(folder: Path, facts: dict[str, Any]) -> None:
    """Write README.md of a data set: its rounds, files and licence, for the files that are in the folder."""
    sizes = {name: (folder / name).stat().st_size for name in _MEANING if (folder / name).is_file()}
    files = "\n".join(f"| `{name}` | {size:,} | {_MEANING[name]} |" for name, size in sizes.items())
    reading = _MINARI.format(**facts) if "data/metadata.json" in sizes else ""
    reading += _AGAIN if reading and not facts["bags"] else ""
    reading += _TABLES if "decisions.parquet" in sizes else ""
    player, origin = f"played by the policy `{facts['policy']}`", _SIMULATED.format(**facts)
    if facts["bags"]:
        player, origin = "played by a robot and written as if played", _OF_A_ROBOT.format(**facts)
    text = _CARD.format(**facts, files=files, reading=reading, player=player, origin=origin)
    write_text(folder / "README.md", text)
