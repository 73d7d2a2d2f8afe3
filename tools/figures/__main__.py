"""Measure the figures of the documentation again and write them into the pages: ``scripts/figures [NAME ...]``.

Without names, only stale figures are measured: figures without a result, or whose inputs have changed. Each result is
stored at once, and rounds that were played are kept, so the command can be interrupted.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import Parser, run_command
from tools import ids
from tools.common import ROOT, add_check, add_names, update
from tools.figures import store
from tools.figures.inputs import hashes
from tools.figures.measurements import league_hash, measurements
from tools.figures.views import BLOCK, filled

_KEPT = ROOT / "results" / "figures"  # rounds that were played


def pages() -> list[Path]:
    files = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [file for file in files if BLOCK.search(file.read_text(encoding="utf-8"))]


def stale(records: Mapping[str, Any], now: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the name of each figure whose inputs have changed, with the reason."""
    for name, record in records.items():
        changed = [one for one, hashed in record["inputs"].items() if now.get(one) != hashed]
        if changed:
            yield name, f"{', '.join(changed)} changed since {record['version']}, {record['date']}"


def check(records: Mapping[str, Any], now: Mapping[str, str]) -> int:
    """Print every stale figure with its pages, and every page that differs from the results; return the status."""
    shown: dict[str, set[str]] = {}
    status = 0
    for page in pages():
        text, place = page.read_text(encoding="utf-8"), page.relative_to(ROOT).as_posix()
        for block in BLOCK.finditer(text):
            shown.setdefault(block[2], set()).add(place)
        if filled(text, records) != text:
            print(f"{place}: figures differ from docs/figures.json: run scripts/figures --write")
            status = 1
    if "leaderboard" in records and records["leaderboard"]["values"] != league_hash():
        print("docs/leaderboard.md: was changed by hand: run scripts/figures leaderboard")
        status = 1
    for name, reason in stale(records, now):
        where = shown.get(name) or shown.get(name.split("/")[0]) or {"docs/figures.json"}
        print(f"{name} ({', '.join(sorted(where))}): {reason}: run scripts/figures {name}")
        status = 1
    return status


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="scripts/figures", description=__doc__)
    add_names(parser, "figure", measurements())
    add_check(parser)
    parser.add_argument("--list", action="store_true", help="print the measurements with their commands, and stop")
    parser.add_argument("--write", action="store_true", help="measure nothing, write the stored figures into the pages")
    return run_command(parser, argv, _run)


def _run(arguments: argparse.Namespace) -> int:
    known, records = measurements(), store.read()
    now = hashes({one for record in records.values() for one in record["inputs"]})
    if arguments.check:
        return check(records, now)
    old = dict(stale(records, now))
    if arguments.list:
        for name, one in known.items():
            state = "stale" if name in old else "current" if name in records else "not measured"
            print(f"{name:24} {one.minutes:5.0f} min  {state:12}  {one.command}")
        return 0
    due = [] if arguments.write else arguments.names or [name for name in known if name in old or name not in records]
    for name in due:
        print(f"{name}: {known[name].command}, about {known[name].minutes:.0f} min on two cores", flush=True)
        values = known[name].measure(_KEPT / name)
        records = store.read() | {name: store.record(known[name].command, known[name].inputs, values)}
        store.write({one: records[one] for one in known if one in records})
    for page in pages():
        update(page, filled(page.read_text(encoding="utf-8"), records), check=False, complaint="")
    return ids.write_pages(check=False)


if __name__ == "__main__":
    sys.exit(main())
