"""How many processor cores this process may really use."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ["available_cores"]

_CPU_MAX = ("cpu.max",)
_CPU_CFS = ("cpu.cfs_quota_us", "cpu.cfs_period_us")


def available_cores(
    groups: Path = Path("/proc/self/cgroup"), mounts: Path = Path("/sys/fs/cgroup")
) -> int:
    """Return the cores that the affinity and the quotas of containers leave, at least 1.

    A container with a share of a large machine still sees all of its cores, and with a thread for
    each of them it is throttled: neither `os.cpu_count` nor onnxruntime looks at the quota.

    Args:
        groups: File that names the control groups of this process.
        mounts: Folder that they are mounted at.
    """
    # Only Linux tells the affinity.
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    return max(1, min([cores, *map(math.ceil, _quotas(groups, mounts))]))


def _quotas(groups: Path, mounts: Path) -> Iterator[float]:
    """Yield the quotas, in cores, of the control groups of this process and of those above."""
    for line in _read(groups).splitlines():
        # `0::/path` for version 2, `4:cpu,cpuacct:/path` for version 1
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        root = mounts / controllers
        group = root / path.lstrip("/")
        # Inside a container its group may be mounted as the root, whatever the path says.
        for folder in {root, group, *group.parents} - {*root.parents}:
            files = _CPU_CFS if controllers else _CPU_MAX
            yield from _quota(" ".join(_read(folder / name) for name in files))


def _quota(text: str) -> Iterator[float]:
    """Yield quota over period; nothing where there is none: `max 100000`, `-1 100000`, no file."""
    words = text.split()
    if len(words) == 2 and all(word.isdigit() and int(word) for word in words):
        yield int(words[0]) / int(words[1])


def _read(file: Path) -> str:
    try:
        return file.read_text()
    except OSError:
        return ""
