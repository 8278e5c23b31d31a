"""kill -9 of the server at random moments, under submissions and running jobs: nothing acknowledged is lost."""

from __future__ import annotations

import itertools
import os
import secrets
import signal
import sqlite3
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

from service.client.client import ServiceError, UnreachableError
from service.settings import RUNNER
from tests.acceptance.server import Server, alive, children, running_server, until
from tests.chaos.jobs import check_digests, check_recordings, crashes, scenario, works_on

if TYPE_CHECKING:
    import random

    import pytest

    from needlebench import Client

_TOKEN = "NEEDLEBENCH_CHAOS_TOKEN"
_LONGEST_S = 3.0
_WAITING = 12  # jobs not yet ended at which the submitter pauses


class Submitter(threading.Thread):
    """Submits one job after the other, each with a key of its own; after a failure the same key again."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.acknowledged: dict[str, str] = {}  # key -> job
        self.again = 0
        self.problems: list[str] = []
        self._ending = threading.Event()
        self._client: Client | None = None

    def serve(self, client: Client | None) -> None:
        """Use this server from now on."""
        self._client = client

    def end(self) -> None:
        self._ending.set()
        self.join()

    def run(self) -> None:
        for number in itertools.count():
            self._submit(number, f"key-{number}")
            if self._ending.is_set():
                return

    def _submit(self, number: int, key: str) -> None:
        while True:
            client = self._client
            try:
                if client is not None and self._room(client):
                    job = client.submit(scenario(number), idempotency_key=key)
                    self.acknowledged[key] = job.id
                    return
            except UnreachableError:
                self.again += 1
            except (ServiceError, RuntimeError) as error:  # RuntimeError: the test closed this client
                if isinstance(error, ServiceError):
                    self.problems.append(str(error))
            if self._ending.is_set():
                return
            time.sleep(0.02)

    def _room(self, client: Client) -> bool:
        waiting = sum(1 for _ in client.jobs(state="queued"))
        return waiting < _WAITING


def test_the_server_is_killed(
    tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    token = secrets.token_hex(8)
    monkeypatch.setenv(_TOKEN, token)
    submitter = Submitter()
    submitter.start()
    slowest_s = 0.0
    for _ in range(moments):
        started = time.monotonic()
        server = Server(tmp_path, runner=RUNNER)
        slowest_s = max(slowest_s, time.monotonic() - started)
        submitter.serve(server.client)
        try:
            if chance.random() < 0.5:  # else also while its workers start
                until(lambda: _works(server), patience_s=600, pause_s=0.2)  # noqa: B023
            time.sleep(chance.uniform(0, _LONGEST_S))
        finally:
            submitter.serve(None)
            server.stop(signal.SIGKILL)
        until(lambda: not _family(token), pause_s=0.1)
        _check_database(tmp_path)
    with running_server(tmp_path, runner=RUNNER) as server:
        submitter.serve(server.client)
        submitter.end()
        ids = [job.id for job in server.client.jobs()]
        done = [server.client.wait(job, timeout_s=600) for job in ids]
        assert set(submitter.acknowledged.values()) <= set(ids)
        assert len(submitter.acknowledged) <= len(ids) <= len(submitter.acknowledged) + 1  # one key may hang in the air
        assert len(set(submitter.acknowledged.values())) == len(submitter.acknowledged)
        assert {job.state for job in done} == {"finished"}, [job.error for job in done if job.error]
        again = sum(crashes(server.client, job) for job in done)
        seen = check_recordings(tmp_path, {(job.id, job.attempt) for job in done})
        assert seen["whole"] == len(done)
        check_digests(done)
    assert not submitter.problems
    figures.update(kills=moments, acknowledged=len(submitter.acknowledged), jobs=len(done), run_again=again)
    figures.update(lost=0, finished_twice=0, orphans=0, slowest_start_s=round(slowest_s, 1), recordings=dict(seen))


def _works(server: Server) -> bool:
    """Whether a job is run in one of its workers."""
    return any(works_on(pid) is not None for pid in children(server.process.pid))


def _family(token: str) -> list[int]:
    """Living processes that some server of this test started, wherever they hang in the process tree (Linux)."""
    found = []
    for environ in Path("/proc").glob("[0-9]*/environ"):
        pid = int(environ.parent.name)
        try:
            if pid != os.getpid() and f"{_TOKEN}={token}".encode() in environ.read_bytes() and alive(pid):
                found.append(pid)
        except OSError:
            continue
    return found


def _check_database(data: Path) -> None:
    """What a killed server leaves is whole, before any other server mends it."""
    connection = sqlite3.connect(data / "needlebench.sqlite")
    try:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    finally:
        connection.close()
