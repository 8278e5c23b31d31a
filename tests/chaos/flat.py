"""What a running server holds, as the process table tells it (Linux)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from service.worker.memory import resident_mb
from tests.acceptance.server import children


@dataclass(frozen=True)
class Held:
    """processes: children; descriptors, threads and memory (MB resident) of the server itself."""

    processes: int
    descriptors: int
    threads: int
    memory_mb: float

    @classmethod
    def by(cls, pid: int) -> Held:
        process = Path(f"/proc/{pid}")
        memory_mb = resident_mb(pid)
        assert memory_mb is not None
        descriptors, threads = (len(list((process / name).iterdir())) for name in ("fd", "task"))
        return cls(len(children(pid)), descriptors, threads, round(memory_mb, 1))


def cpu_s(pid: int) -> float:
    """CPU time that the process has used, its children's apart."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
