import pytest

from pacman_env.ros.simulated_robot.sim_faults import FAULTS, fault_of, fault_words


def test_faults_begin_and_end_by_name() -> None:
    assert fault_of("reject") == ("reject", ())
    assert fault_of("  Abort 2.5 ") == ("abort", (2.5,))
    assert fault_of("end nav2_away") == ("nav2_away", None)
    assert fault_of("end") == ("", None)


@pytest.mark.parametrize("name", FAULTS)
def test_shown_fault_can_be_applied_again(name: str) -> None:
    fault, numbers = fault_of(" ".join([name, *("0.5" for _ in FAULTS[name])]))
    (words,) = fault_words({fault: numbers or ()})
    assert fault_of(words) == (fault, numbers)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "must be reject"),
        ("explode", "unknown"),
        ("end explode", "unknown"),
        ("end reject now", "end or end NAME"),
        ("abort", "SECONDS"),
        ("abort 1 2", "SECONDS"),
        ("abort soon", "number"),
        ("abort nan", "within"),
        ("abort -1", "within 0"),
        ("reject 1", "no number"),
        ("pose_jump 1 2", "X Y HEADING"),
        ("pose_jump 1 2 7", "heading"),
        ("clock_jump inf", "within"),
    ],
)
def test_invalid_fault_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        fault_of(text)
