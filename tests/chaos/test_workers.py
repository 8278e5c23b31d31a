"""kill -9 of a worker at random moments of real jobs: that job alone is run again."""

from __future__ import annotations

import os
import signal
import time
from typing import TYPE_CHECKING

from service.settings import RUNNER
from tests.acceptance.server import Server, children, running_server, until
from tests.chaos.jobs import check_digests, check_recordings, crashes, scenario, works_on

if TYPE_CHECKING:
    import random
    from pathlib import Path

_OPEN = 6  # jobs that have not ended, at each kill


def test_workers_are_killed(tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object]) -> None:
    with running_server(tmp_path, runner=RUNNER) as server:
        first = server.client.wait(server.client.submit(scenario(0)).id)
        pace_s = _duration_s(first.raw)
        ids = [first.id]
        killed: list[tuple[str, int]] = []
        idle = 0
        while len(killed) + idle < moments:
            for _ in range(_OPEN - _open(server)):  # however many ended before anybody was killed
                ids.append(server.client.submit(scenario(len(ids))).id)
            time.sleep(chance.uniform(0, pace_s))
            at_work = chance.random() < 0.8  # else also who starts, or waits
            if at_work:
                until(lambda: bool(_at_work(server)), patience_s=600, pause_s=0.01)
            busy = _at_work(server) if at_work else []
            victim = chance.choice(sorted(busy or children(server.process.pid)))
            job = works_on(victim)
            if job is not None and job[1] >= 3:  # a third death would be its last
                continue
            os.kill(victim, signal.SIGKILL)
            if job is None:
                idle += 1
            else:
                killed.append(job)
        done = [server.client.wait(job, timeout_s=600) for job in ids]
        assert {job.state for job in done} == {"finished"}, [job.error for job in done if job.error]
        died = {job.id: crashes(server.client, job) for job in done}
        unseen = sum(max(0, count - sum(job == one for job, _ in killed)) for one, count in died.items())
        assert unseen <= idle  # who had no log open may have been about to open it, or just have closed it
        seen = check_recordings(tmp_path, {(job.id, job.attempt) for job in done})
        assert seen["whole"] == len(done)
        check_digests(done)
    figures.update(kills=len(killed) + idle, of_idle_workers=idle, jobs=len(done), run_again=sum(died.values()))
    figures.update(lost=0, others_touched=0, recordings=dict(seen))


def _open(server: Server) -> int:
    """How many jobs have not ended."""
    return sum(len(list(server.client.jobs(state=state))) for state in ("queued", "running"))


def _at_work(server: Server) -> list[int]:
    return [pid for pid in children(server.process.pid) if works_on(pid) is not None]


def _duration_s(raw: object) -> float:
    from datetime import datetime

    assert isinstance(raw, dict)
    started, finished = (datetime.fromisoformat(raw[name]) for name in ("started_at", "finished_at"))
    return (finished - started).total_seconds()
