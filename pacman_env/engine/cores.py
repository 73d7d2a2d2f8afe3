"""Count the cores that this process may use; imports no compiler."""

import contextlib
import math
import os
from pathlib import Path


def cores(system: Path = Path("/")) -> int:
    """Return the number of cores in this process's affinity, limited by the CPU quotas of its control groups.

    ``system`` is the folder that contains ``proc`` and ``sys``.
    """
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min([count, *_quotas(system)])))


def _quotas(system: Path) -> list[float]:
    """Return the limits of all control groups around this process, in cores.

    Version 1 of control groups has one hierarchy per controller, version 2 has one for all; a machine may mount both.
    """
    limits = []
    with contextlib.suppress(OSError, ValueError):  # another system, or undocumented files
        lines = (system / "proc/self/cgroup").read_text().splitlines()
        groups = {name: path for _, names, path in (line.split(":", 2) for line in lines) for name in names.split(",")}
        for line in (system / "proc/self/mountinfo").read_text().splitlines():
            place, _, kind = line.partition(" - ")
            root, mounted = place.split()[3:5]
            version, *_, options = kind.split()
            name = {"cgroup": "cpu", "cgroup2": ""}.get(version)
            if name not in groups or (name and name not in options.split(",")):
                continue
            # A container may see its group as the root of the hierarchy, although its path is the one of the host.
            group = Path(groups[name])
            below = group.relative_to(root) if group.is_relative_to(root) else Path()
            top = system / mounted.lstrip("/")
            limits += [_quota(folder) for folder in (top / below, *(top / parent for parent in below.parents))]
    return limits


def _quota(group: Path) -> float:
    """Return the number of cores that a control group may use (Linux, cgroup-v2 and sched-bwc); no limit: infinity."""
    with contextlib.suppress(OSError, ValueError):
        if (file := group / "cpu.max").exists():
            quota, period = file.read_text().split()
        else:
            quota, period = ((group / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
        if float(quota) > 0 < float(period):  # -1 and "max" stand for no limit
            return float(quota) / float(period)
    return math.inf
