"""What a newcomer sees: the command alone, and the examples in each command's help."""

import argparse
import re
import shlex
from collections.abc import Callable, Iterator
from importlib import import_module

import pytest

from pacman_env.cli.main import HELP, MODULES, REMOVED, main, make_parser
from pacman_env.command_line.examples import EXAMPLES, FIRST, PROG


def commands(parser: argparse.ArgumentParser) -> Iterator[str]:
    """All commands that do something, subcommands with their group."""
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for group in groups:
        for command in group.choices.values():
            yield from commands(command)
    if not groups:
        yield parser.prog.removeprefix(f"{PROG} ")


def need_extra(command: str) -> None:
    if command in MODULES:
        pytest.importorskip("psutil")
        if MODULES[command][0].startswith("training"):
            pytest.importorskip("torch")


def test_command_without_arguments_suggests_first_steps(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    shown = [line.strip() for line in out.splitlines() if line.startswith("  ")]
    assert 3 <= len(shown) <= 5
    for line, (words, purpose, extra) in zip(shown, FIRST, strict=True):
        assert line.startswith(f"{PROG} {words} ")
        assert line.endswith(f" {purpose} [{extra}]" if extra else f" {purpose}")


def test_every_command_has_examples() -> None:
    assert set(commands(make_parser())) == set(EXAMPLES)


def test_help_lists_every_command_in_one_group() -> None:
    listed = [name for names in HELP.values() for name in names]
    assert sorted(listed) == sorted({name.split()[0] for name in commands(make_parser())})
    shown = re.findall(r"^  ([a-z][\w-]*) ", make_parser().format_help(), re.MULTILINE)
    assert shown == listed


@pytest.mark.parametrize("command", REMOVED)
def test_removed_command_names_its_replacement(command: str, refused: Callable[..., None]) -> None:
    assert command not in {name.split()[0] for name in commands(make_parser())}
    refused(main, [command, "--out", "there"], REMOVED[command])


@pytest.mark.parametrize("command", EXAMPLES)
def test_help_ends_with_examples_of_command(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    need_extra(command)
    with pytest.raises(SystemExit, match="0"):
        main([*command.split(), "--help"])
    _, _, examples = capsys.readouterr().out.partition("\nexamples:\n")
    for words, purpose in EXAMPLES[command]:
        assert words.startswith(command)
        assert f"  {PROG} {words}" in examples
        assert purpose in examples


@pytest.mark.parametrize(("group", "last"), [("map", "generate"), ("ros", "replay")])
def test_group_help_has_example_of_each_subcommand(group: str, last: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([group, "--help"])
    examples = capsys.readouterr().out.partition("\nexamples:\n")[2].splitlines()
    assert sum(line.startswith(f"  {PROG} {group} ") for line in examples) == len(
        [command for command in EXAMPLES if command.startswith(f"{group} ")]
    )
    assert any(line.startswith(f"  {PROG} {group} {last} ") for line in examples)


@pytest.mark.parametrize(
    "words", [*(words for words, *_ in FIRST), *(words for examples in EXAMPLES.values() for words, _ in examples)]
)
def test_example_is_accepted_by_parser(words: str) -> None:
    need_extra(words.split()[0])
    command, *arguments = shlex.split(words)
    if command in MODULES:
        import_module(f"pacman_env.{MODULES[command][0]}").make_parser().parse_args(arguments)
    else:
        make_parser().parse_args([command, *arguments])
