import gc

import pytest

from pacman_env.world.navigation.physics import Contacts
from tests.system.memory import PARTS, main, make_and_close, spaces_alive


@pytest.mark.daily
def test_short_run_reports_all_parts(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--short"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for part in PARTS:
        summary = [line for line in lines if line.startswith(part)]
        assert len(summary) >= 3
        assert "since the first tenth" in summary[-1]


def test_spaces_alive_counts_existing_physics_spaces() -> None:
    gc.collect()
    before = spaces_alive()
    contacts = [Contacts(radius_m=0.2, mass_kg=1.0, step_s=0.05) for _ in range(3)]
    assert spaces_alive() == before + 3
    del contacts
    assert spaces_alive() == before


def test_closed_environments_leave_no_spaces_or_threads() -> None:
    make_and_close(1)  # raises a Fault if they do
