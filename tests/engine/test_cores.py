"""How many cores a process may use, by its affinity and by made-up control groups."""

import os
from pathlib import Path

import pytest

from pacman_env.engine.cores import cores

V2 = "30 23 0:26 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n"
V1 = "33 30 0:30 / /sys/fs/cgroup/cpu,cpuacct rw - cgroup cgroup rw,cpu,cpuacct\n"
CPU = "sys/fs/cgroup/cpu,cpuacct"
V1_MEMORY = "34 30 0:31 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n"
GROUPS_V1 = "5:memory:/docker/a\n4:cpu,cpuacct:/docker/a\n0::/\n"


@pytest.mark.parametrize(
    ("groups", "mounts", "files", "expected"),
    [
        ("0::/\n", V2, {"sys/fs/cgroup/cpu.max": "150000 100000\n"}, 2),
        ("0::/\n", V2, {"sys/fs/cgroup/cpu.max": "10000 100000\n"}, 1),
        ("0::/\n", V2, {"sys/fs/cgroup/cpu.max": "max 100000\n"}, 8),
        ("0::/\n", V2, {}, 8),
        (
            *("0::/user.slice/job\n", V2),  # the outer group has the limit
            {"sys/fs/cgroup/user.slice/cpu.max": "3 1\n", "sys/fs/cgroup/user.slice/job/cpu.max": "max 1\n"},
            3,
        ),
        (
            *(GROUPS_V1, V2.replace("/sys/fs/cgroup ", "/sys/fs/cgroup/unified ") + V1_MEMORY + V1),
            {
                f"{CPU}/docker/a/cpu.cfs_quota_us": "250000\n",
                f"{CPU}/docker/a/cpu.cfs_period_us": "100000\n",
                f"{CPU}/cpu.cfs_quota_us": "-1\n",
                f"{CPU}/cpu.cfs_period_us": "100000\n",
            },
            3,
        ),
        ("no control groups\n", V2, {"sys/fs/cgroup/cpu.max": "200000 100000\n"}, 8),
    ],
)
def test_cores_are_those_of_affinity_and_quota(
    groups: str, mounts: str, files: dict[str, str], expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)), raising=False)
    for name, content in {"proc/self/cgroup": groups, "proc/self/mountinfo": mounts, **files}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    assert cores(tmp_path) == expected
    assert cores(tmp_path / "absent") == 8
