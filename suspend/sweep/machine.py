"""What this machine has for a sweep: cores, and memory as far as a container or a job may use it."""

from __future__ import annotations

import os
from pathlib import Path

SHARE = 0.9  # of the memory that is free when a sweep begins
_GROUPS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def free_memory() -> float:
    """Bytes that runs may take; infinite where the system does not say."""
    limits = [_meminfo(), *(_limit(Path(path)) for path in _GROUPS)]
    return SHARE * min(limits)


def _meminfo() -> float:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError, StopIteration):
        return float("inf")


def _limit(path: Path) -> float:
    try:
        return float(path.read_text(encoding="ascii"))
    except (OSError, ValueError):  # absent, or "max"
        return float("inf")
