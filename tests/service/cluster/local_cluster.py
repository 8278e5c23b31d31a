"""A scheduler and workers on this machine, as real processes that can be killed."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from typing import TYPE_CHECKING, Self

from service.cluster.address import ClusterAddress
from tests.acceptance.server import ROOT, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

WORKER = ("-m", "tests.service.cluster.worker_main")


class LocalCluster:
    """Scheduler and workers in a folder. worker: the arguments of Python that start one, before the address."""

    def __init__(self, folder: Path, *, worker: tuple[str, ...] = WORKER) -> None:
        self.folder, self._worker = folder, worker
        self.file = folder / "scheduler.json"
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []
        folder.mkdir(parents=True, exist_ok=True)

    @property
    def address(self) -> ClusterAddress:
        return ClusterAddress(f"file:{self.file}")

    def start_scheduler(self) -> Self:
        self.file.unlink(missing_ok=True)
        self.scheduler = self._start(
            "scheduler", "-m", "service.cli", "cluster", "scheduler", "--out", str(self.folder)
        )
        until(self.file.exists)
        return self

    def start_worker(self, *more: str) -> subprocess.Popen[bytes]:
        process = self._start(f"worker{len(self.workers)}", *self._worker, *more, f"file:{self.file}")
        self.workers.append(process)
        return process

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def endpoint(self) -> str:
        return str(json.loads(self.file.read_bytes())["address"])

    def end(self) -> None:
        for process in [*self.workers, *([self.scheduler] if self.scheduler else [])]:
            process.kill()
            process.wait()

    def _start(self, name: str, *arguments: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen([sys.executable, *arguments], cwd=ROOT, stdout=log, stderr=log)


@contextlib.contextmanager
def local_cluster(folder: Path, workers: int, *, worker: tuple[str, ...] = WORKER) -> Iterator[LocalCluster]:
    cluster = LocalCluster(folder, worker=worker)
    try:
        cluster.start_scheduler()
        for _ in range(workers):
            cluster.start_worker()
        yield cluster
    finally:
        cluster.end()
