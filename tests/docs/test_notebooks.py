"""The notebooks run from top to bottom in fresh kernels, and what they show is what they compute."""

import os
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "notebooks"
#: Values of the cell with the tag `parameters` that make a notebook take seconds.
SHORT = {
    "game": "",
    "own_policy": "ROUNDS = 20",
    "train": "IMITATION = DECISIONS = 8192; HOUSES = 8; ROUNDS = 10",
}
MOST_BYTES = 100_000  # of a cell's outputs
#: In a comparison's table, without the times of decisions: policy, completed rounds, difference.
ROW = re.compile(
    r"^(\w+) +(\d+\.\d \[\d+\.\d, \d+\.\d\]) .*?(-|[+-]\d+\.\d \[[+-]\d+\.\d, [+-]\d+\.\d\])$", re.MULTILINE
)


def read(name: str) -> Any:
    nbformat = pytest.importorskip("nbformat")
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def run(name: str, parameters: str, folder: Path) -> Any:
    """Return the notebook after all of its cells; an error in a cell is raised."""
    for module in ("ipykernel", "torch"):
        pytest.importorskip(module)
    nbclient, manager = pytest.importorskip("nbclient"), pytest.importorskip("jupyter_client.manager")
    notebook = read(name)
    for cell in notebook.cells:
        if "parameters" in cell.metadata.get("tags", ()):
            cell.source += f"\n{parameters}"
    # Frozen modules and the debugger do not go together, of which the kernel warns.
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = {**os.environ, "PYTHONPATH": path, "PYDEVD_DISABLE_FILE_VALIDATION": "1", "OMP_NUM_THREADS": "1"}
    kernel = manager.AsyncKernelManager(kernel_name="python3", transport="ipc", ip=f"{folder}/kernel")  # without ports
    client = nbclient.NotebookClient(notebook, km=kernel, timeout=900, resources={"metadata": {"path": str(folder)}})
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


@pytest.mark.daily
@pytest.mark.parametrize("name", SHORT)
def test_notebook_runs_from_top_to_bottom(name: str, tmp_path: Path) -> None:
    notebook = run(name, SHORT[name], tmp_path)
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_stores_small_outputs_and_names_extra(path: Path) -> None:
    cells = read(path.stem).cells
    code = [cell for cell in cells if cell.cell_type == "code"]
    assert path.stem in SHORT
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert max(len(output(cell).encode()) for cell in code) <= MOST_BYTES
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


@pytest.mark.daily
def test_notebook_tables_equal_tables_played_again(tmp_path: Path) -> None:
    assert tables(run("own_policy", "", tmp_path)) == tables(read("own_policy"))
