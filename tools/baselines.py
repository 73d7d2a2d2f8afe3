"""Read the baselines, which are trainings of stock learners, and write the tables and the picture of their results."""

import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import matplotlib
import msgspec
import numpy as np
from matplotlib.figure import Figure

from pacman_env.config import located
from pacman_env.config.validation import convert
from pacman_env.config.yaml_files import read_yaml
from pacman_env.episodes.statistics import wilson
from pacman_env.files import prepare
from tools.common import ROOT, as_arguments, table

FILE = ROOT / "train" / "hyperparameters" / "baselines.yaml"
RESULTS = ROOT / "docs" / "benchmark"
LINES = {  # colour and style of each reference policy
    "random": ("#57606a", ":"), "nearest": ("#57606a", "--"), "clyde_aware": ("#57606a", "-."),
    "lookahead": ("#2f8f4e", "--"), "ppo": ("#b38600", "-"),
}  # fmt: skip
_STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "baselines", "font.size": 9, "axes.titlesize": 9,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.titlecolor", "xtick.color", "ytick.color"), "#1b1f24"),
    **dict.fromkeys(("axes.edgecolor", "legend.edgecolor"), "#d0d7de"),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor", "legend.facecolor"), "#ffffff"),
}  # fmt: skip


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of a training with a stock learner, and of its tests."""

    id: str  # after "pacman_env/"
    arguments: dict[str, Any] = {}  # of the id
    tests: tuple[str, ...] = ("generated:test",)  # maps of the test rounds; the curve shows the first
    learner: Literal["MaskablePPO", "PPO", "QRDQN", "RecurrentPPO", "SAC"]
    policy: str = "MlpPolicy"
    games: int = 16  # games in parallel
    decisions: int = 300_000
    seeds: int = 0  # number of seeds in the benchmark
    normalize: bool = False  # normalize observations and rewards by running mean and deviation
    hyperparameters: dict[str, Any] = {}  # of the learner; learning_rate: at the start and at the end
    points: int = 10  # of the curve, after the one of the untrained model
    rounds: int = 200  # for each point
    last_rounds: int = 400  # after the training, on each map

    def test(self, map_name: str) -> dict[str, Any]:
        """Return the arguments of the id for test rounds."""
        return {**self.arguments, "map": map_name}

    def test_name(self, map_name: str) -> str:
        return f"{self.id}, {as_arguments(self.test(map_name))}"


def read() -> dict[str, Baseline]:
    """Return the baselines by name, in the order of their training; raises ValueError for an invalid file."""
    with located(FILE, ValueError):
        return {name: convert(values, Baseline, name) for name, values in read_yaml(FILE).items()}


def hash_of(*configuration: object) -> str:
    return hashlib.sha256(msgspec.json.encode(configuration, order="deterministic")).hexdigest()[:16]


def stored(folder: Path, name: str, *configuration: object) -> tuple[Path, dict[str, Any] | None]:
    """Return the file of a result, and its record if it is of this configuration."""
    file = folder / f"{re.sub(r'[^A-Za-z0-9_]+', '-', name).strip('-')}.json"
    record = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return file, record if record.get("hash") == hash_of(*configuration) else None


def _made() -> Iterator[tuple[str, Baseline, list[dict[str, Any]]]]:
    """Yield the name, the baseline and the records of the trained seeds, for each baseline of the benchmark."""
    for name, one in read().items():
        found = (stored(RESULTS, f"{name}-{seed}", one)[1] for seed in range(one.seeds))
        if one.seeds:
            yield name, one, [record for record in found if record]


def _references() -> dict[str, dict[str, Any]]:
    """Return the records of the reference policies by the name of the test rounds."""
    wanted = ((one.test_name(each), one.last_rounds) for _, one, _ in _made() for each in one.tests)
    found = {name: stored(RESULTS, name, name, rounds)[1] for name, rounds in wanted}
    return {name: record for name, record in found.items() if record}


def trained() -> str:
    """Return the table of the trained baselines, and which of their runs are missing."""
    rows, missing, machines = list[list[str]](), list[str](), set[str]()
    for name, one, made in _made():
        missing += [f"{one.seeds - len(made)} of `{name}`"] if len(made) < one.seeds else []
        machines |= {record["machine"] for record in made}
        stamps = {f"{record['version']} at {record['commit'][:8]}, {record['date']}" for record in made}
        for each in one.tests if made else ():
            ends = [record["tests"][each] for record in made]
            won = _spread([100 * end["won"].count("1") / len(end["won"]) for end in ends])
            speed = f"{np.mean([one.decisions / record['training_s'] for record in made]):,.0f}"
            counts = [f"`{each}`", f"{one.decisions:,}", f"{len(made)} of {one.seeds}"]
            rows.append(
                [f"`{name}`", *counts, won, _spread([end["return"] for end in ends]), speed, "; ".join(sorted(stamps))]
            )
    heads = ("Baseline", "Tested on", "Decisions", "Seeds", "Completed, %", "Return", "Decisions/s", "Version")
    words = [f"Not made yet: {', '.join(missing)}."] if missing else []
    return f"{table(heads, rows)}\n{' '.join([*words, 'Machines: ' + '; '.join(sorted(machines)) + '.'])}\n"


def _spread(values: list[float]) -> str:
    return f"{np.mean(values):.1f}" + (f" [{min(values):.1f}, {max(values):.1f}]" if len(values) > 1 else "")


def references() -> str:
    """Return the table of the reference policies in the test rounds."""
    rows = []
    for name, record in _references().items():
        for policy, played in record["policies"].items():
            count, rounds = played["won"].count("1"), len(played["won"])
            low, high = wilson(count, rounds)
            won = f"{100 * count / rounds:.1f} [{100 * low:.1f}, {100 * high:.1f}]"
            stamp = f"{record['version']} at {record['commit'][:8]}, {record['date']}"
            rows.append([f"`{name}`", f"`{policy}`", won, f"{played['return']:.1f}", stamp])
    return table(("Test rounds", "Policy", "Completed, %", "Return", "Version"), rows)


def draw(path: Path) -> None:
    """Draw a diagram for each baseline: a thin curve for each seed, their mean, and lines for reference policies."""
    made, lines = [*_made()], _references()
    rows = -(-len(made) // 3)
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(8.6, 2.3 * rows + 0.7), layout="constrained")
        for place, (name, one, records) in enumerate(made, 1):
            axes = figure.add_subplot(rows, 3, place)
            for policy, played in lines.get(one.test_name(one.tests[0]), {"policies": {}})["policies"].items():
                colour, style = LINES[policy]
                share = 100 * played["won"].count("1") / len(played["won"])
                axes.axhline(share, color=colour, linestyle=style, linewidth=1, label=policy)
            curves = np.array([record["points"] for record in records])  # (seeds, points, 3)
            for curve in curves:
                axes.plot(curve[:, 0] / 1000, 100 * curve[:, 1], color="#2f6fd0", linewidth=0.6, label="a seed")
            if len(curves):
                mean = curves.mean(axis=0)
                axes.plot(mean[:, 0] / 1000, 100 * mean[:, 1], color="#2f6fd0", linewidth=2, label="mean of seeds")
            axes.set(title=f"{name} ({len(curves)} of {one.seeds})", xlim=(0, one.decisions / 1000), ylim=(0, 100))
            axes.spines[["top", "right"]].set_visible(False)
        handles = {
            label: handle
            for axes in figure.axes
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=7, fontsize=8)
        figure.supylabel("completed test rounds, %", fontsize=9)
        figure.supxlabel("decisions, thousands", fontsize=9)
        figure.savefig(prepare(path), format="svg", metadata={"Date": None})
