"""Whether a recording has room to grow, looked at before each part: Rerun's own writer ends at a full disk, and what
then waits for it may wait for ever."""

from __future__ import annotations

import errno
import math
import shutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

ROOM_MB = 8.0  # [ours] a block of a fine mesh has less than one


def check_room(path: Path) -> None:
    """Raises OSError where less than ROOM_MB can be added to the file."""
    left_mb = 1e-6 * min(shutil.disk_usage(path.parent).free, _allowed_bytes(path))
    if left_mb < ROOM_MB:
        raise OSError(errno.ENOSPC, f"{max(0.0, left_mb):.1f} MB are left for it, and {ROOM_MB:g} must be free")


def _allowed_bytes(path: Path) -> float:
    """How much longer this process may make the file."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    if limit == resource.RLIM_INFINITY:
        return math.inf
    return limit - (path.stat().st_size if path.exists() else 0)
