"""The notebooks run from top to bottom in fresh kernels, and what they show is what they compute."""

import os
import re
from pathlib import Path
from typing import Any

import pytest

from pacman_env.evaluation.compare.text_table import with_interval
from tools.figures import store

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
#: The rounds of `scripts/compare`, whose results are in docs/figures.json.
MEASURED = "preset robot, execution robust, seed 0\n\nhouse: 13 pellets, Clyde at 0.25 m/s, 200 episodes\n"
TIMES = re.compile(r" +\d+\.\d{3}\b|.* times as fast as real time")
#: Completed rounds of a rule, in tables of `compare` and `train`.
RULE = re.compile(r"^(?:\| )?(clyde_aware|lookahead|nearest)[ |]+(\d+\.\d%? \[[^]]*\])", re.MULTILINE)
NOISE = re.compile(r"Warning|%\|")  # warnings and progress bars
MOST_BYTES = 100_000  # of a cell's outputs
#: In a comparison's table, without the times of decisions: policy, completed rounds, difference.
ROW = re.compile(
    r"^(\w+) +(\d+\.\d \[\d+\.\d, \d+\.\d\]) .*?(-|[+-]\d+\.\d \[[+-]\d+\.\d, [+-]\d+\.\d\])$", re.MULTILINE
)


def read(name: str) -> Any:
    nbformat = pytest.importorskip("nbformat")
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def run(name: str, folder: Path) -> Any:
    """Return the notebook after all of its cells; an error in a cell is raised."""
    for module in ("ipykernel", "torch"):
        pytest.importorskip(module)
    nbclient, manager = pytest.importorskip("nbclient"), pytest.importorskip("jupyter_client.manager")
    notebook = read(name)
    # Frozen modules and the debugger do not go together, of which the kernel warns.
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = {**os.environ, "PYTHONPATH": path, "PYDEVD_DISABLE_FILE_VALIDATION": "1", "OMP_NUM_THREADS": "1"}
    environment["TQDM_DISABLE"] = "1"  # no progress bars
    kernel = manager.AsyncKernelManager(kernel_name="python3", transport="ipc", ip=f"{folder}/kernel")  # without ports
    client = nbclient.NotebookClient(notebook, km=kernel, timeout=3600, resources={"metadata": {"path": str(folder)}})
    client.execute(env=environment, cleanup_kc=True)
    return notebook


def output(cell: Any) -> str:
    """Return what a cell has printed and drawn."""
    outputs = cell.get("outputs", ())
    return "".join("".join(text) for one in outputs for text in (one.get("text", ""), *one.get("data", {}).values()))


def tables(notebook: Any) -> list[list[tuple[str, ...]]]:
    """Return the policy, completed rounds and difference of each row of every comparison."""
    return [rows for cell in notebook.cells if (rows := ROW.findall(output(cell)))]


def lower_limits(table: list[tuple[str, ...]]) -> dict[str, float]:
    """Return the lower limit of each policy's difference to the first, in %."""
    limits = {name: re.findall(r"[+-]\d+\.\d", difference) for name, _, difference in table}
    return {name: float(numbers[1]) for name, numbers in limits.items() if numbers}


def printed(notebook: Any) -> str:
    """Return what the cells have printed, without times, which differ between machines."""
    outputs = (one for cell in notebook.cells for one in cell.get("outputs", ()))
    return TIMES.sub("", "".join(one.text for one in outputs if one.get("name") == "stdout"))


@pytest.mark.parametrize("name", ["own_policy", "train"])
def test_notebook_shows_measured_completion_of_rules(name: str) -> None:
    measured = {row["policy"]: row for row in store.read()["compare"]["values"]}
    tables = [out.split(MEASURED)[1] for cell in read(name).cells if MEASURED in (out := output(cell))]
    shown = [row for table in tables for row in RULE.findall(table)]
    assert shown
    for rule, completed in shown:
        assert completed == with_interval(measured[rule]["completion_rate"], measured[rule]["completion_ci"]), rule


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_stores_small_outputs_and_names_extra(name: str) -> None:
    cells = read(name).cells
    code = [cell for cell in cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert max(len(output(cell).encode()) for cell in code) <= MOST_BYTES
    assert not NOISE.search("".join(map(output, code)))
    assert "`pip install -e '.[notebooks]' jupyterlab`" in cells[0].source


def test_own_policies_of_notebook_are_short_and_better() -> None:
    notebook = read("own_policy")
    first, second, *_ = tables(notebook)
    assert [row[0] for row in first] == ["nearest", "first"]
    assert lower_limits(first)["first"] > 0
    assert second[0][0] == "clyde_aware"
    assert lower_limits(second)["careful"] > 0
    policies = [cell.source for cell in notebook.cells if "(pacman_env.BasePolicy)" in cell.source]
    lines = [len([line for line in source.split("\n\n\n")[0].splitlines() if line.strip()]) for source in policies]
    assert lines[0] <= 10
    assert lines[1] <= 20


def test_trained_planner_of_notebook_improves_by_ppo() -> None:
    notebook = read("train")
    imitated, *_, improved = map(float, re.findall(r"([\d.]+)% of validation rounds", printed(notebook)))
    assert improved > imitated
    assert [lower_limits(table)["planner"] > 0 for table in tables(notebook)] == [True, True]


@pytest.mark.daily
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_prints_the_same_when_run_again(name: str, tmp_path: Path) -> None:
    notebook = run(name, tmp_path)
    assert not NOISE.search("".join(map(output, notebook.cells)))
    stored, again = printed(read(name)), printed(notebook)
    if name == "train":  # the trained planner may differ between machines
        stored, again = (str(RULE.findall(text)) for text in (stored, again))
    assert again == stored
