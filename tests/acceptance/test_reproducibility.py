"""One scenario, one result: the command line, one worker and two workers side by side give the same bits."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from service.settings import RUNNER
from tests.acceptance.server import ROOT, running_server, until
from tests.verification import verify

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

BASE: dict[str, Any] = {
    "noise_mm": 0.1,
    "tissue": {"element_size_mm": 10},
    "trajectory": {"kind": "sine", "target_mm": [20, 33, 20], "amplitude_mm": 0.5},
}
SCENARIOS: dict[str, dict[str, Any]] = {
    "first": {**BASE, "name": "first", "seed": 1, "dt_s": 0.01},
    "second": {**BASE, "name": "second", "seed": 2, "dt_s": 0.005},
}
LONG = {**BASE, "name": "long", "seed": 3, "dt_s": 0.0002}


@pytest.fixture(scope="module")
def digests(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Name -> digest from `needlebench run`, each in a process of its own."""
    found = {}
    for name, scenario in SCENARIOS.items():
        folder = tmp_path_factory.mktemp(name)
        words = [sys.executable, "-m", "service.cli", "run", "-", "--out", str(folder / "out")]
        done = subprocess.run(words, input=json.dumps(scenario), cwd=ROOT, capture_output=True, text=True)
        assert done.returncode in (0, 3), done.stderr
        found[name] = json.loads((folder / "out" / "result.json").read_text())["digest"]
    assert len(set(found.values())) == len(SCENARIOS)
    return found


@pytest.mark.parametrize("workers", [1, 2])
def test_jobs_have_the_digests_of_the_command_line(digests: dict[str, str], tmp_path: Path, workers: int) -> None:
    """Both scenarios submitted at once over HTTP; then the first again, to a worker that has run before, and where
    there are two while the other one simulates."""
    with running_server(tmp_path, runner=RUNNER, workers=workers) as server:
        client = server.client
        sent = [client.submit(scenario).id for scenario in SCENARIOS.values()]
        done = [client.wait(job) for job in sent]
        others = [client.submit(LONG).id for _ in range(workers - 1)]
        until(lambda: all(client.job(job).progress.step > 0 for job in others))
        done.append(client.wait(client.submit(SCENARIOS["first"]).id))
        assert [client.job(job).state for job in others] == ["running"] * (workers - 1)
        for job in others:
            client.cancel(job)
    assert [job.state for job in done] == ["finished"] * 3, [job.error for job in done]
    different = sum(job.result is None or job.result["digest"] != digests[job.name] for job in done)
    text = f"digests over HTTP that differ from the command line's, {workers} worker{'s' * (workers > 1)}, three jobs"
    source = "definition: one scenario, one result"
    verify("reproducibility", text, expected=0, measured=different, tolerance=0, source=source)
