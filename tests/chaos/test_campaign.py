"""A campaign of many short jobs: none lost, none done twice, and how near to the bare engine it comes."""

from __future__ import annotations

import threading
import time
from collections import Counter
from concurrent.futures import wait
from datetime import datetime
from typing import TYPE_CHECKING, Any

import pytest

from service.settings import RUNNER
from service.worker.process import WorkerProcess, answer
from service.worker.specs import InsertionSpec
from tests.acceptance.server import running_server, until
from tests.chaos.flat import Held, cpu_s
from tests.chaos.instant import SPIN, only_the_job

if TYPE_CHECKING:
    from pathlib import Path

    from needlebench import Client

_WORKERS = 2
_INSTANT = "tests.chaos.instant:run_job"
_TINY: dict[str, Any] = {  # as short as an insertion can well be
    "name": "tiny",
    "tissue": {"element_size_mm": 20},
    "trajectory": {"kind": "line", "target_mm": [18, 31, 5]},
    "noise_mm": 0.01,  # seeds that change nothing are refused
    "recording": {"enabled": False},
}
_SHORT: dict[str, Any] = {  # what a laboratory would call so: the default mesh and step, 12 mm deep, 0.3 s of CPU
    "name": "short",
    "trajectory": {"kind": "line", "target_mm": [18, 31, 12]},
    "noise_mm": 0.01,
    "recording": {"enabled": False},
}
_PAGE = 1000  # events in an answer
_HALF_MB = 5.0  # [ours] by the second half of the jobs; 6 kB each of 800 would be as much


@pytest.mark.parametrize(
    ("kind", "runner", "scenario"),
    [
        ("short insertion", RUNNER, _SHORT),
        ("tiny insertion", RUNNER, _TINY),
        ("50 ms of CPU", _INSTANT, {"name": f"{SPIN}50", "noise_mm": 0.25}),
    ],
    ids=["short", "tiny", "50ms"],
)
def test_a_campaign_of_short_jobs(
    tmp_path: Path, campaign_jobs: int, figures: dict[str, object], kind: str, runner: str, scenario: dict[str, Any]
) -> None:
    half = [{**scenario, "seed": seed} for seed in range(campaign_jobs // 2)]
    before = _bare(tmp_path / "before", runner, half)
    with running_server(tmp_path / "data", runner=runner, workers=_WORKERS) as server:
        until(lambda: server.client.ready()["workers_ready"] == _WORKERS, patience_s=600)
        grid = {"seed": list(range(campaign_jobs)), "name": [scenario["name"]]}  # an axis of names keeps them
        used_s, asked = cpu_s(server.process.pid), time.monotonic()
        campaign = server.client.start_campaign({"scenario": scenario, "grid": grid})
        answered_s = time.monotonic() - asked
        samples: list[tuple[int, float]] = []  # jobs that have finished, MB
        pid = server.process.pid
        done = server.client.wait_campaign(
            campaign.id, progress=lambda now: samples.append((now.jobs.get("finished", 0), Held.by(pid).memory_mb))
        )
        used_s = cpu_s(server.process.pid) - used_s
        assert done.jobs["finished"] == sum(done.jobs.values()) == campaign_jobs
        _each_once(server.client, campaign_jobs)
        through = _pace(list(server.client.jobs()))
    after = _bare(tmp_path / "after", runner, half)
    bare = 2 / (1 / before + 1 / after)
    figures.update(kind=kind, jobs=campaign_jobs, lost=0, done_twice=0, through_the_service=f"{through:.2f}/s")
    figures.update(bare_engine=f"{bare:.2f}/s (before {before:.2f}, after {after:.2f})")
    figures.update(ratio=f"{through / bare:.3f}", server_ms_per_job=round(1e3 * used_s / campaign_jobs, 2))
    held = [next(mb for ended, mb in samples if ended >= share * campaign_jobs) for share in (0.1, 0.5, 0.9, 1.0)]
    figures.update(accepted_after_s=round(answered_s, 2), memory_mb=held)
    assert held[2] <= held[1] + _HALF_MB  # at the very end all results are read at once, for the trend


def _each_once(client: Client, jobs: int) -> None:
    """By the log of events: each was queued, started and ended one time."""
    seen: Counter[tuple[str, str]] = Counter()
    after = 0
    while found := client._json("GET", "/api/v1/events", params={"after": after})["items"]:
        seen.update((event["job"], event["kind"]) for event in found)
        after = found[-1]["id"]
        if len(found) < _PAGE:
            break
    assert set(seen.values()) == {1}
    assert Counter(kind for _, kind in seen) == {"queued": jobs, "started": jobs, "finished": jobs}


def _pace(jobs: list[Any]) -> float:
    """Jobs a second, from the first start to the last end."""
    times = [[datetime.fromisoformat(job.raw[name]) for job in jobs] for name in ("started_at", "finished_at")]
    return len(jobs) / (max(times[1]) - min(times[0])).total_seconds()


def _bare(folder: Path, runner: str, scenarios: list[dict[str, Any]]) -> float:
    """Jobs a second by the same workers, with no service around them: as soon as one is done, the next."""
    from simcore.scenario.scenario import Scenario

    specs = [
        InsertionSpec(job_id="bare", scenario=Scenario.load(scenario).resolved(), files=folder).to_json()
        for scenario in scenarios
    ]
    work, taking = iter(enumerate(specs)), threading.Lock()
    workers = [WorkerProcess(runner, folder / "lock") for _ in range(_WORKERS)]

    def finished(worker: WorkerProcess, function: Any, *args: Any) -> None:
        future = worker.call(function, *args)
        wait([future])
        answer(future)

    def run_all(worker: WorkerProcess) -> None:
        while True:
            with taking:
                number, spec = next(work, (0, None))
            if spec is None:
                return
            finished(worker, only_the_job, runner, spec, str(folder / str(number)))

    folder.mkdir(parents=True)
    try:
        for number, worker in enumerate(workers):
            worker.start()
            while not worker.ready(1.0):
                pass
            finished(worker, only_the_job, runner, specs[0], str(folder / f"first {number}"))
        started = time.monotonic()
        threads = [threading.Thread(target=run_all, args=(worker,)) for worker in workers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return len(scenarios) / (time.monotonic() - started)
    finally:
        for worker in workers:
            worker.kill()
