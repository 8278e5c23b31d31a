"""How much memory other processes of this machine hold now."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def resident_mb(pid: int) -> float | None:
    """Resident memory of a process, MB (10^6 bytes); None where the system does not say (not Linux) or it is gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def available_mb() -> float | None:
    """Memory of this machine that can still be taken, MB; None where the system does not say."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024 / 1e6
    except (OSError, ValueError, IndexError):
        pass
    return None


def group_mb(pid: int, others: Iterable[int]) -> float | None:
    """Memory of a process and of others that came from it, MB; what they share is counted once.

    None where the system does not say or the first is gone.
    """
    pids = list(others)
    held = resident_mb(pid)
    if not pids or held is None:
        return held
    shares = [_share_mb(one) for one in (pid, *pids)]
    return max(held, sum(share for share in shares if share is not None))


def _share_mb(pid: int) -> float | None:
    """Its own memory, and of what it shares with n - 1 others the n-th part."""
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * 1024 / 1e6
    except (OSError, ValueError, IndexError):
        pass
    return None
