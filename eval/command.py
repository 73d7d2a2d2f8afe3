"""The frame of an evaluation command: its work, or one line that says why there is none."""

from __future__ import annotations

import sys
from collections.abc import Callable

from pacman_env.cli.main import ERROR_STATUS


def status_of(prog: str, work: Callable[[], object]) -> int:
    """Do the work; the exit status: 0, or 2 after one line on stderr."""
    try:
        work()
    except ModuleNotFoundError as error:
        print(f"{prog}: needs {error.name}: pip install 'pacman_env[eval]'", file=sys.stderr)
        return ERROR_STATUS
    except (ValueError, OSError) as error:  # MapError and ConfigError are ValueErrors
        print(f"{prog}: {error}", file=sys.stderr)
        return ERROR_STATUS
    return 0
