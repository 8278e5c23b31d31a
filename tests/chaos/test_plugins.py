"""Plug-ins that exit, fork, flood and hang: each job ends, nothing of it stays, and the jobs between do not notice."""

from __future__ import annotations

import os
import secrets
from typing import TYPE_CHECKING, Any

from service.logs import MAXIMUM_BYTES
from service.settings import RUNNER
from tests.acceptance.server import running_server, until
from tests.chaos import plugin_package
from tests.chaos.conftest import MOMENTS
from tests.chaos.flat import Held
from tests.chaos.test_server import _TOKEN, _family

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

_TINY: dict[str, Any] = {
    "tissue": {"element_size_mm": 20},
    "trajectory": {"kind": "line", "target_mm": [18, 31, 5]},
    "recording": {"enabled": False},
}
_TIMEOUT_S = 10.0  # of those that hang; the others take seconds on a busy machine
_SPARE_MB = 40.0  # [ours] that the server may hold in the end beyond what it held after the first job


def scenario(does: str | None) -> dict[str, Any]:
    """With the plug-in, or a sound one without it."""
    if does is None:
        return {**_TINY, "name": "sound", "seed": 1}
    return {**_TINY, "name": does, "controller": {"kind": "plugin", "name": "misbehaves", "settings": {"does": does}}}


def test_plug_ins_misbehave(tmp_path: Path, figures: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    token = secrets.token_hex(8)
    monkeypatch.setenv(_TOKEN, token)
    packages = plugin_package.install(tmp_path / "packages")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(packages), os.environ.get("PYTHONPATH")])))
    wanted = plugin_package.ALL if MOMENTS in os.environ else plugin_package.SHORT
    with running_server(tmp_path / "data", runner=RUNNER) as server:
        client, pid = server.client, server.process.pid
        sound = [client.wait(client.submit(scenario(None)).id, timeout_s=600)]
        before = Held.by(pid)
        bad = {}
        for does in wanted:
            limit = _TIMEOUT_S if does in plugin_package.HANGS else None
            bad[does] = client.submit(scenario(does), timeout_s=limit).id
            sound.append(client.submit(scenario(None)))
        ended = {does: client.wait(job, timeout_s=600) for does, job in bad.items()}
        good = [client.wait(job.id, timeout_s=600) for job in sound]
        for does, job in ended.items():
            failed = does in plugin_package.FAILS
            expected = "failed" if failed else "timed_out" if does in plugin_package.HANGS else None
            assert job.state == expected if expected else job.result is not None, (does, job.state, job.error)
        assert len({job.result["digest"] for job in good if job.result is not None}) == 1
        assert all(job.result is not None for job in good), [job.error for job in good]
        logs = [path.stat().st_size for path in (tmp_path / "data" / "jobs").glob("*/*/job.log")]
        assert max(logs) < 2 * MAXIMUM_BYTES + 10_000
        until(lambda: client.ready()["workers_ready"] == 2, patience_s=600, pause_s=0.2)
        until(lambda: len(_family(token)) == _family_size(pid), pause_s=0.2)
        after = Held.by(pid)
        assert (after.processes, after.threads) == (before.processes, before.threads)
        assert after.memory_mb < before.memory_mb + _SPARE_MB
    until(lambda: not _family(token), pause_s=0.2)
    figures.update(plug_ins=len(bad), sound_jobs=len(good), lost=0, stuck=0, left_behind=0)
    figures.update(largest_log_mb=round(max(logs) / 1e6, 1), descriptors=[before.descriptors, after.descriptors])
    figures.update(memory_mb=[before.memory_mb, after.memory_mb])


def _family_size(server: int) -> int:
    """The server and all that is below it."""
    from service.worker.processes import descendants

    return 1 + len(descendants(server))
