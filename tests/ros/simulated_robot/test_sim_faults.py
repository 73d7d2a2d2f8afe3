import pytest

from pacman_env.ros.simulated_robot.sim_faults import FAULTS, Faults


def test_faults_begin_and_end_by_name() -> None:
    faults = Faults()
    faults.apply("reject")
    faults.apply("  Abort 2.5 ")
    faults.apply("pose_jump 1 -2 0.5")
    assert faults.words() == ["abort 2.5", "pose_jump 1 -2 0.5", "reject"]
    assert faults.number("abort") == 2.5
    assert "reject" in faults
    faults.apply("end reject")
    assert "reject" not in faults
    faults.apply("end nav2_away")  # is not there
    faults.apply("abort 1")
    assert faults.now == {"abort": (1.0,), "pose_jump": (1.0, -2.0, 0.5)}
    faults.apply("end")
    assert faults.words() == []
    assert faults.number("abort") is None


@pytest.mark.parametrize("name", FAULTS)
def test_shown_fault_can_be_applied_again(name: str) -> None:
    faults, again = Faults(), Faults()
    faults.apply(" ".join([name, *("0.5" for _ in FAULTS[name])]))
    for text in faults.words():
        again.apply(text)
    assert again.now == faults.now != {}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "must be reject"),
        ("explode", "unknown"),
        ("end explode", "unknown"),
        ("end reject now", "end or end NAME"),
        ("abort", "SECONDS"),
        ("abort 1 2", "SECONDS"),
        ("abort soon", "is no number"),
        ("abort nan", "within"),
        ("abort -1", "negative"),
        ("reject 1", "no number"),
        ("pose_jump 1 2", "X Y HEADING"),
        ("pose_jump 1 2 7", "heading"),
        ("clock_jump inf", "within"),
        ("kidnap 1 2", "X Y HEADING"),
    ],
)
def test_invalid_fault_is_refused_and_changes_nothing(text: str, reason: str) -> None:
    faults = Faults()
    faults.apply("late_acceptance 3")
    with pytest.raises(ValueError, match=reason):
        faults.apply(text)
    assert faults.words() == ["late_acceptance 3"]
