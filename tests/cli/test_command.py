"""The frame of every command: Ctrl-C while a parser is made."""

from __future__ import annotations

import argparse
import os
import signal
import threading
from typing import Any

import pytest

from pacman_env.cli.command import Parser
from pacman_env.cli.main import main


def test_ctrl_c_while_a_parser_is_made_follows_once_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Argparse imports modules meanwhile, and Python drops what is raised in some parts of an import."""
    finished = False
    add_argument = argparse.ArgumentParser.add_argument

    def interrupted(self: Parser, *names: str, **options: Any) -> argparse.Action:
        nonlocal finished
        os.kill(os.getpid(), signal.SIGINT)
        action = add_argument(self, *names, **options)
        finished = True
        return action

    monkeypatch.setattr(argparse.ArgumentParser, "add_argument", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Parser(prog="command")
    assert finished


def test_a_command_can_be_called_in_another_thread() -> None:
    statuses: list[int] = []
    thread = threading.Thread(target=lambda: statuses.append(main(["map", "list"])))
    thread.start()
    thread.join()
    assert statuses == [0]
