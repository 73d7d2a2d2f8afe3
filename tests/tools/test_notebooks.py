"""The notebooks run from top to bottom in fresh kernels, and what they show is what they compute."""

from __future__ import annotations

import importlib.util
import re
from typing import Any

import pytest

from tests.web.browser import missing
from tools import notebooks

#: What makes a notebook take seconds.
SHORT = {
    "game": {},
    "own_policy": {"ROUNDS": 20},
    "train": {"IMITATION": 8192, "DECISIONS": 8192, "HOUSES": 8, "ROUNDS": 10},
}
#: In a comparison's table, without the times of decisions: policy, completed rounds, difference.
ROW = re.compile(
    r"^(\w+) +(\d+\.\d \[\d+\.\d, \d+\.\d\]) .*?(-|[+-]\d+\.\d \[[+-]\d+\.\d, [+-]\d+\.\d\])$", re.MULTILINE
)


@pytest.fixture(autouse=True)
def kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("ipykernel", "nbclient", "torch"):
        if importlib.util.find_spec(module) is None:
            missing(f"{module} (pip install -e '.[notebooks]')")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


def kept(name: str) -> Any:
    import nbformat

    return nbformat.read(notebooks.FOLDER / f"{name}.ipynb", as_version=4)


def tables(notebook: Any) -> list[list[tuple[str, ...]]]:
    """Of every comparison: policy, completed rounds and difference of each row."""
    texts = ["".join(out.get("text", "") for out in cell.get("outputs", ())) for cell in notebook.cells]
    return [rows for text in texts if (rows := ROW.findall(text))]


def differences(table: list[tuple[str, ...]]) -> dict[str, float]:
    """The lower limit of each policy's difference to the first, in %."""
    limits = {name: re.findall(r"[+-]\d+\.\d", difference) for name, _, difference in table}
    return {name: float(numbers[1]) for name, numbers in limits.items() if numbers}


def test_every_notebook_is_run() -> None:
    assert set(SHORT) == set(notebooks.NAMES)


@pytest.mark.daily
@pytest.mark.parametrize("name", SHORT)
def test_a_notebook_runs_from_top_to_bottom_in_a_fresh_kernel(name: str) -> None:
    notebooks.run(name, SHORT[name])


@pytest.mark.parametrize("name", SHORT)
def test_outputs_are_kept_and_none_is_large(name: str) -> None:
    cells = [cell for cell in kept(name).cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert all(notebooks.output_bytes(cell) <= notebooks.MOST_BYTES for cell in cells)
    assert sum(map(notebooks.output_bytes, cells)) > 1000
    assert {out.get("name", "stdout") for cell in cells for out in cell.outputs} <= {"stdout"}


@pytest.mark.parametrize("name", SHORT)
def test_the_first_cell_says_what_is_needed_and_how_to_open_it(name: str) -> None:
    first = kept(name).cells[0].source
    assert "`pip install -e '.[notebooks]' jupyterlab`" in first
    assert "`jupyter lab docs/notebooks`" in first


def test_a_parameter_that_a_notebook_does_not_set_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"own_policy\.ipynb: no parameter 'GAMES'"):
        notebooks.run("own_policy", {"GAMES": 3})


def test_ten_lines_beat_nearest_and_twenty_the_scorer() -> None:
    first, second, *_ = tables(kept("own_policy"))
    assert [row[0] for row in first] == ["nearest", "first"]
    assert differences(first)["first"] > 0
    assert second[0][0] == "clyde_aware"
    assert differences(second)["careful"] > 0
    policies = [cell.source for cell in kept("own_policy").cells if "(pacman_env.BasePolicy)" in cell.source]
    lines = [len([line for line in source.split("\n\n\n")[0].splitlines() if line.strip()]) for source in policies]
    assert lines[0] <= 10
    assert lines[1] <= 20


@pytest.mark.daily
def test_the_tables_of_the_policies_are_those_that_are_played_now() -> None:
    assert tables(notebooks.run("own_policy")) == tables(kept("own_policy"))
