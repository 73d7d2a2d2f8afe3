"""When a process counts as frozen or dead; real processes are in ``supervisor/``."""

import os
import socket
import struct
from contextlib import closing
from threading import Thread
from types import SimpleNamespace

import pytest

from pacman_env.ros import heartbeat
from pacman_env.ros.heartbeat import LIMIT_S, LONG_S, Heart, Listener

#: A heart, and a listener that is refused, keep their sockets as long as their process.
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


@pytest.mark.parametrize(
    ("state", "busy_share", "looks_s", "limit_s", "late"),
    [
        ("S", 0.0, [0.1] * 25, LIMIT_S, True),
        ("T", 0.0, [0.1] * 25, LIMIT_S, True),
        ("S", 0.0, [0.1] * 9, LIMIT_S, False),
        ("R", 0.0, [0.1] * 900, LIMIT_S, False),  # it waits for a processor
        ("R", 0.5, [0.1] * 45, LIMIT_S, True),  # it computes
        ("S", 0.0, [60.0] * 2, LIMIT_S, False),  # the observer did not run
        ("S", 0.0, [0.1] * 900, LONG_S, False),
        ("S", 0.0, [0.1] * 900, 0, False),  # it has said farewell, or is starting
    ],
)
def test_silence_counts_while_process_could_run(
    monkeypatch: pytest.MonkeyPatch, state: str, busy_share: float, looks_s: list[float], limit_s: int, late: bool
) -> None:
    now_s, address = 0.0, f"pacman_env-test-{os.getpid()}"
    monkeypatch.setattr(heartbeat, "time", SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(heartbeat, "signal", SimpleNamespace(alarm=lambda seconds: None))
    monkeypatch.setattr(heartbeat, "main_thread", lambda pid: (state, busy_share * now_s))
    heart = Heart()
    heart.send_to(address)
    with closing(Listener(address)) as listener:
        heart.beat(LIMIT_S)
        heart.beat(limit_s)
        lost = listener.lost()
        for look_s in looks_s:
            now_s += look_s
            lost |= listener.lost()
        assert list(lost) == [os.getpid()] * late
        assert all(silent_s > limit_s for silent_s in lost.values())
        heart.beat(LIMIT_S)
        state = "Z"
        assert listener.lost() == {os.getpid(): 0.0}
        assert listener.lost() == {}


def test_address_has_one_listener() -> None:
    address = f"pacman_env-test-{os.getpid()}"
    with closing(Listener(address)), pytest.raises(OSError, match="in use"):
        Listener(address)


def test_new_promise_waits_for_room_in_the_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, address = 0.0, f"pacman_env-test-{os.getpid()}"
    monkeypatch.setattr(heartbeat, "time", SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(heartbeat, "signal", SimpleNamespace(alarm=lambda seconds: None))
    monkeypatch.setattr(heartbeat, "LONGEST_SEND", struct.pack("ll", 300, 0))
    heart = Heart()
    heart.send_to(address)
    with closing(Listener(address)) as listener:
        for _ in range(100):  # more repetitions than any queue keeps
            now_s += LIMIT_S
            heart.beat(LIMIT_S)
        promise = Thread(target=heart.beat, args=[LONG_S])
        promise.start()
        promise.join(0.1)  # without a wait it would be over, and lost
        while promise.is_alive():
            listener.lost()
        monkeypatch.setattr(heartbeat, "main_thread", lambda pid: ("S", 0.0))
        for _ in range(10):
            now_s += LIMIT_S
            assert listener.lost() == {}


@pytest.mark.parametrize("message", [b"", b"\0" * 100])
def test_listener_survives_any_message(message: bytes) -> None:
    address = f"pacman_env-test-{os.getpid()}"
    with closing(Listener(address)) as listener, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.sendto(message, f"\0{address}")
        assert listener.lost() == {}


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_beats_of_other_users_do_not_count() -> None:
    address = f"pacman_env-test-{os.getpid()}"
    with closing(Listener(address)) as listener, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        for user, lost in ((os.getuid(), 1), (65534, 0)):
            pid = os.fork()
            if not pid:
                os.setuid(user)
                other.sendto(bytes([LIMIT_S]), f"\0{address}")
                os._exit(0)
            assert os.waitpid(pid, 0)[1] == 0
            assert list(listener.lost()) == [pid] * lost
