"""The notebooks of the documentation, run in fresh kernels: ``python -m tools.notebooks`` (extra ``notebooks``).

What their cells print and draw is kept in the files, as the site shows them without running anything.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any

from pacman_env.cli.command import Parser, run_command
from pacman_env.files import replaced
from tools.common import ROOT, add_names

FOLDER = ROOT / "docs" / "notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
MOST_BYTES = 100_000  # of a cell's outputs
_CELL_S = 900
_PARAMETERS = "parameters"  # tag of the cell that sets what a shorter run replaces


def run(name: str, parameters: Mapping[str, int] | None = None) -> Any:
    """A notebook after all of its cells, as nbformat has it; an error in a cell is raised.

    It runs in an empty folder. ``parameters`` replace values that the notebook sets in the cell with that tag; raises
    ValueError for one that it does not set.
    """
    import nbformat
    from jupyter_client.manager import AsyncKernelManager
    from nbclient import NotebookClient

    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    places = [k for k, cell in enumerate(notebook.cells) if _PARAMETERS in cell.metadata.get("tags", ())]
    for parameter, value in (parameters or {}).items():
        if not any(f"{parameter} = " in notebook.cells[k].source for k in places):
            raise ValueError(f"{name}.ipynb: no parameter {parameter!r}")
        notebook.cells[places[0]].source += f"\n{parameter} = {value!r}"
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    # Frozen modules and the debugger do not go together, of which the kernel warns.
    environment = {**os.environ, "PYTHONPATH": path, "PYDEVD_DISABLE_FILE_VALIDATION": "1"}
    with tempfile.TemporaryDirectory() as folder:
        # Sockets are files there: no port is opened.
        kernel = AsyncKernelManager(kernel_name="python3", transport="ipc", ip=f"{folder}/kernel")
        resources = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, km=kernel, timeout=_CELL_S, record_timing=False, resources=resources)
        client.execute(env=environment, cleanup_kc=True)
    return notebook


def output_bytes(cell: Any) -> int:
    """Of what a cell has printed and drawn."""
    texts = [
        text for output in cell.get("outputs", ()) for text in (output.get("text"), *output.get("data", {}).values())
    ]
    return sum(len("".join(text).encode()) for text in texts if text)


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.notebooks", description="Run the notebooks, keep what their cells show.")
    add_names(parser, "notebook", NAMES)
    return run_command(parser, argv, _write, "notebooks")


def _write(arguments: argparse.Namespace) -> None:
    import nbformat

    for name in arguments.names or NAMES:
        notebook = run(name)
        notebook.metadata = {"kernelspec": notebook.metadata.kernelspec, "language_info": {"name": "python"}}
        for number, cell in enumerate(notebook.cells):
            if cell.cell_type == "code":  # stderr has progress bars
                cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
            if (size := output_bytes(cell)) > MOST_BYTES:
                raise ValueError(f"{name}.ipynb: cell {number}: {size} bytes of output, at most {MOST_BYTES}")
        with replaced(FOLDER / f"{name}.ipynb") as temporary:
            temporary.write_text(nbformat.writes(notebook) + "\n", encoding="utf-8")
        print(f"written: {FOLDER / f'{name}.ipynb'}")


if __name__ == "__main__":
    sys.exit(main())
