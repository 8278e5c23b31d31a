"""What a running server holds, as the process table tells it (Linux)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from service.memory import resident_mb
from tests.acceptance.server import children


@dataclass(frozen=True)
class Held:
    """processes: children; descriptors, threads and memory (MiB resident) of the server itself."""

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
