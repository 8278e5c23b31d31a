"""Many clients at once while insertions run in both workers: how long they wait, and what it costs the insertions."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

from needlebench import Client
from service.client.client import POLL_S
from service.settings import RUNNER
from tests.acceptance.server import ROOT, Server, running_server
from tests.chaos.flat import cpu_s
from tests.chaos.jobs import scenario

if TYPE_CHECKING:
    from pathlib import Path

_AHEAD = 4  # insertions submitted and not yet ended: two run, the next two wait
_LONG: dict[str, Any] = {"name": "measured", "recording": {"enabled": False}}
_FIRST = 100  # priority: before all jobs of the clients


@dataclass(frozen=True)
class Run:
    """An insertion: when it ran, UTC seconds since 1970; its wall time a step and the median of its plant, ms."""

    started: float
    finished: float
    step_ms: float
    plant_ms: float

    def within(self, phase: tuple[float, float]) -> bool:
        return phase[0] <= self.started and self.finished <= phase[1]


class Insertions(threading.Thread):
    """Keeps both workers at work on the same scenario, one run after the other."""

    def __init__(self, server: Server) -> None:
        super().__init__(daemon=True)
        self._client = Client(server.url)
        self._ending = threading.Event()
        self.runs: list[Run] = []
        self.problems: list[str] = []

    def run(self) -> None:
        waiting: deque[str] = deque()
        while waiting or not self._ending.is_set():
            while len(waiting) < _AHEAD and not self._ending.is_set():
                waiting.append(self._client.submit(_LONG, priority=_FIRST).id)
            job = self._client.wait(waiting.popleft())
            if job.state != "finished" or job.result is None:
                self.problems.append(f"{job.id} is {job.state}: {job.error}")
                continue
            started, finished = (datetime.fromisoformat(job.raw[n]).timestamp() for n in ("started_at", "finished_at"))
            plant_ms = float(job.result["timing"]["plant"]["median_ms"])
            self.runs.append(Run(started, finished, 1e3 * (finished - started) / job.progress.steps, plant_ms))
        self._client.close()

    def end(self) -> None:
        """Submit nothing more, and wait for what was."""
        self._ending.set()
        self.join()


def test_many_clients(tmp_path: Path, clients: int, seconds: float, figures: dict[str, object]) -> None:
    with running_server(tmp_path, runner=RUNNER) as server:
        server.client.wait(server.client.submit(_LONG).id)  # all is compiled
        insertions = Insertions(server)
        insertions.start()
        phases, used = [], []
        for asking in (False, True, False):
            began, before = time.time(), cpu_s(server.process.pid)
            if asking:
                measured = _asked(server, clients, seconds)
            else:
                time.sleep(seconds / 2)
            phases.append((began, time.time()))
            used.append((cpu_s(server.process.pid) - before) / (phases[-1][1] - began))
        insertions.end()
        states = [server.client.wait(job, timeout_s=600).state for job in measured["jobs"]]
    assert not measured["errors"], measured["errors"][:10]
    assert not insertions.problems
    assert len(set(measured["jobs"])) == clients
    assert set(states) == {"finished"}
    span_s = phases[1][1] - phases[1][0]
    asked = len(measured["submit_ms"]) + len(measured["read_ms"]) + measured["polls"]
    extra_s = (used[1] - (used[0] + used[2]) / 2) * span_s
    figures.update(clients=clients, requests_per_s=round(asked / span_s, 1), errors=0, lost=0)
    figures.update(submit_ms=_spread(measured["submit_ms"]), read_ms=_spread(measured["read_ms"]))
    figures.update(slower=_slower(insertions.runs, phases))
    figures.update(server_ms_per_request=round(1e3 * extra_s / asked, 2), server_cpu=_share(used[1] * span_s, span_s))
    figures.update(server_cpu_without=_share(used[0] + used[2], 2.0), clients_cpu=_share(measured["cpu_s"], span_s))


def _asked(server: Server, clients: int, seconds: float) -> dict[str, Any]:
    """What the clients measured, in a process of their own."""
    command = [sys.executable, "-m", "tests.chaos.clients", server.url, str(seconds), str(POLL_S)]
    theirs = json.dumps([scenario(number) for number in range(clients)])
    done = subprocess.run(command, cwd=ROOT, check=True, input=theirs, stdout=subprocess.PIPE, text=True)
    measured: dict[str, Any] = json.loads(done.stdout)
    return measured


def _spread(values_ms: list[float]) -> str:
    ordered = sorted(values_ms)
    marks = {"median": 0.5, "p95": 0.95, "p99": 0.99, "max": 1.0}
    shown = (f"{name} {ordered[min(int(len(ordered) * q), len(ordered) - 1)]:.1f}" for name, q in marks.items())
    return f"({', '.join(shown)}; n {len(ordered)})"


def _slower(runs: list[Run], phases: list[tuple[float, float]]) -> str:
    """How much longer a step took while the clients asked than before and after, by wall time and by the plant's."""
    loaded = [run for run in runs if run.within(phases[1])]
    alone = [run for run in runs if run.within(phases[0]) or run.within(phases[2])]
    if not loaded or not alone:
        return "(no whole run in a phase: more seconds)"
    pairs = {name: [[getattr(r, name) for r in part] for part in (loaded, alone)] for name in ("step_ms", "plant_ms")}
    shares = (f"{name} {_percent(*pair)}" for name, pair in pairs.items())
    return f"({', '.join(shares)}; {len(loaded)} runs with, {len(alone)} without)"


def _percent(loaded: list[float], alone: list[float]) -> str:
    return f"{100 * (statistics.median(loaded) / statistics.median(alone) - 1):+.1f} %"


def _share(used_s: float, span_s: float) -> str:
    """Of one core."""
    return f"{100 * used_s / span_s:.1f} %"
