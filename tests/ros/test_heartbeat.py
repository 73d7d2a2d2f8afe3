"""When a process counts as frozen; real processes are in ``supervisor/test_processes.py``."""

import os
from types import SimpleNamespace

import pytest

from pacman_env.ros import heartbeat
from pacman_env.ros.heartbeat import LIMIT_S, LONG_S, Listener


@pytest.mark.parametrize(
    ("state", "busy_share", "looks_s", "limit_s", "late"),
    [
        ("S", 0.0, [0.1] * 25, LIMIT_S, True),
        ("T", 0.0, [0.1] * 25, LIMIT_S, True),
        ("S", 0.0, [0.1] * 15, LIMIT_S, False),
        ("R", 0.0, [0.1] * 900, LIMIT_S, False),  # it waits for a processor
        ("R", 0.5, [0.1] * 45, LIMIT_S, True),  # it computes
        ("S", 0.0, [60.0] * 3, LIMIT_S, False),  # the observer did not run
        ("S", 0.0, [0.1] * 900, LONG_S, False),
        ("S", 0.0, [0.1] * 900, 0, False),  # it is starting
    ],
)
def test_silence_counts_while_process_could_run(
    monkeypatch: pytest.MonkeyPatch, state: str, busy_share: float, looks_s: list[float], limit_s: int, late: bool
) -> None:
    now_s = 0.0
    monkeypatch.setattr(heartbeat, "time", SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(heartbeat, "main_thread", lambda pid: (state, busy_share * now_s))
    listener = Listener()
    if limit_s:
        os.write(listener.pipe, bytes([limit_s]))
    assert not listener.is_late(1)
    for look_s in looks_s[:-1]:
        now_s += look_s
        listener.is_late(1)
    now_s += looks_s[-1]
    assert listener.is_late(1) == late
    os.write(listener.pipe, bytes([LIMIT_S]))
    assert not listener.is_late(1)
