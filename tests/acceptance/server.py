"""A real service in a process of its own, for tests that kill it or its workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from needlebench import Client
from service.server.server import serve
from service.settings import RUNNER, Limits, Settings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from service.client.client import JobStatus

FAKE = "tests.acceptance.fakes:run_job"
ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 180.0  # of a machine that has much else to do


class Server:
    """The process; `client` talks to it. settings: fields of `Settings` that are not the defaults of tests.

    main: module whose `main` is run, another than this one where the server itself has to be another one.
    """

    def __init__(
        self, data: Path, *, runner: str = FAKE, workers: int = 2, main: str = __name__, **settings: Any
    ) -> None:
        self.data = data
        more = {"workers": workers, "port": 0, **settings}
        code = f"from {main} import main; main()"
        command = [sys.executable, "-c", code, str(data), runner, json.dumps(more)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().strip()
        assert self.url, "the service did not start"
        self.client = Client(self.url)

    def stop(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.ended()

    def ended(self) -> int:
        """Its exit code, once it has ended."""
        self.client.close()
        try:
            return self.process.wait(timeout=PATIENCE_S)
        finally:
            if self.process.poll() is None:  # the tests that follow are not to pay for it
                self.process.kill()
                self.process.wait()
            assert self.process.stdout is not None
            self.process.stdout.close()

    def running(self, name: str) -> JobStatus:
        """Submit a fake job by name and wait until its worker has shown progress."""
        job = self.client.submit({"name": name})
        until(lambda: self.client.job(job.id).progress.step > 0)
        return self.client.job(job.id)

    def worker_of(self, job: JobStatus) -> int:
        return int((self.data / "jobs" / job.id / str(job.attempt) / "pid").read_text())


@contextmanager
def running_server(data: Path, *, runner: str = FAKE, workers: int = 2, **settings: Any) -> Iterator[Server]:
    server = Server(data, runner=runner, workers=workers, **settings)
    try:
        yield server
    finally:
        if server.process.poll() is None:
            server.stop()


def until(condition: Callable[[], bool], *, patience_s: float = PATIENCE_S, pause_s: float = 0.02) -> None:
    """Wait for something that must come."""
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(pause_s)


def alive(pid: int) -> bool:
    """Whether a process runs; a zombie does not."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return sys.platform != "linux"
    except ProcessLookupError:
        return False


def children(pid: int) -> list[int]:
    """Process ids of the living children, from the process table (Linux)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def main() -> None:
    """What the process of `Server` runs."""
    data, runner, more = sys.argv[1:4]
    limits = Limits.from_environment()
    settings = Settings(data=Path(data), runner=runner or RUNNER, limits=limits, **json.loads(more))
    serve(settings, announce=lambda url: print(url, flush=True))
