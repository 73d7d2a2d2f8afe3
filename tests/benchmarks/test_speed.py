"""The speed of every row is measured, with the ids that the measured version has; no test asserts a time."""

import pytest

from benchmarks import speed
from benchmarks.speed import BARE, ROWS, measured, name_of, registered


def test_every_row_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "HOUSES", 2)
    figures = measured("", "loop", 0.01)
    assert list(figures) == [BARE, *map(name_of, ROWS)]
    for name, row in figures.items():
        lasts_s = row["simulated_s_per_s"] / row["decisions_per_s"]
        assert 0.4 <= lasts_s <= 4.5 if "Flat" in name else lasts_s == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("env", "expected"),
    [("PacManBot-v2", "pacman_env/PacManBot-v2"), ("PacManBotFlat-v2", "pacman_env/PacManBotFlat-v20")],
)
def test_id_gets_the_number_of_the_version(env: str, expected: str) -> None:
    names = (
        "PacManBot-v0",
        "PacManBot-v2",
        "PacManBot-v2",
        "PacManBotFlat-v0",
        "PacManBotFlat-v9",
        "PacManBotFlat-v20",
    )
    ids = [*(f"pacman_env/{name}" for name in names), "CartPole-v1"]
    assert registered(env, ids) == expected
    with pytest.raises(ValueError, match="PacManBotMaze-v2"):
        registered("PacManBotMaze-v2", ids)
