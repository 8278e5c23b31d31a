"""kill -9 of a backup, and of the server under a backup: no half backup has a name, and the store stays sound."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

from service.store.backups import read_backup
from tests.acceptance.server import ROOT, Server, running_server, until
from tests.chaos.test_server import _check_database

if TYPE_CHECKING:
    import random
    from pathlib import Path

_LONGEST_S = 1.5  # from the start of the command to the kill; the start of Python alone takes a good part of it


def backup(data: Path, target: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "service.cli", "backup", str(target), "--data", str(data)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def test_backups_are_killed(tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object]) -> None:
    data = tmp_path / "data"
    acknowledged: list[str] = []
    whole = servers = 0
    for moment in range(moments):
        server = Server(data)
        try:
            acknowledged += [server.client.submit({"name": "quick"}).id for _ in range(5)]
            target = tmp_path / f"backup-{moment}"
            process = backup(data, target)
            time.sleep(chance.uniform(0, _LONGEST_S))
            if chance.random() < 0.3:
                servers += 1
                server.stop(signal.SIGKILL)
                assert process.wait(timeout=60) == 0
            else:
                process.kill()
                process.wait()
        finally:
            if server.process.poll() is None:
                server.stop(signal.SIGKILL)
        if target.exists():
            read_backup(target)
            whole += 1
        _check_database(data)
    with running_server(data) as server:
        ended = [server.client.wait(job, timeout_s=600) for job in acknowledged]
        assert all(job.result is not None for job in ended), [job.error for job in ended]
        last = backup(data, tmp_path / "last")
        assert last.wait(timeout=60) == 0
        until(lambda: any((data / "backups").glob("daily-*")))
    _restored_elsewhere(tmp_path, acknowledged)
    figures.update(kills=moments, of_the_server=servers, whole_backups=whole, half_ones=0, jobs=len(ended), lost=0)


def _restored_elsewhere(tmp_path: Path, acknowledged: list[str]) -> None:
    """The last backup, in a new folder, has every job with its result and its files."""
    command = [sys.executable, "-m", "service.cli", "restore", str(tmp_path / "last"), "--data", str(tmp_path / "new")]
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ}, stderr=subprocess.DEVNULL)
    with running_server(tmp_path / "new") as server:
        assert {job.id for job in server.client.jobs()} == set(acknowledged)
        assert all(server.client.job(job).result is not None for job in acknowledged)
        assert server.client.artefacts(acknowledged[0])
