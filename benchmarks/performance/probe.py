"""A run in a process of its own, watched from its parent: how long until the first step, how much memory at the peak.

`python -m benchmarks.performance.probe` reads {"scenario", "recorder", "recording", "first_step_only"} as JSON from
standard input and writes a line `step` after the first step and a JSON object at the end. `recorder` names a function
as `module:function`; nothing of what it belongs to is known here.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simcore.rollout.records import Scene, StepRecord
    from simcore.rollout.result import Rollout

FIRST = "step"


class ProbeError(RuntimeError):
    """The process under observation failed."""


@dataclass(frozen=True)
class ProbeResult:
    """first_step_s: from just before the process was made to its first finished step. peak_mb: 10^6 bytes, or None."""

    first_step_s: float
    peak_mb: float | None
    status: str


def probe(
    scenario: dict[str, Any],
    *,
    recorder: str,
    recording: Path,
    first_step_only: bool = False,
    environment: dict[str, str] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> ProbeResult:
    """Run a scenario (JSON data) with a recorder in a new process. Raises ProbeFailed."""
    request = {
        "scenario": scenario,
        "recorder": recorder,
        "recording": str(recording),
        "first_step_only": first_step_only,
    }
    started = clock()
    child = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.performance.probe"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **(environment or {})},
    )
    assert child.stdin is not None
    assert child.stdout is not None
    with child, child.stdin, child.stdout:
        child.stdin.write(json.dumps(request))
        child.stdin.close()
        line = child.stdout.readline().strip()
        first_step_s = clock() - started
        rest = child.stdout.read()
    if line != FIRST or child.returncode != 0:
        raise ProbeError(f"the process ended with exit code {child.returncode}, its output begins with {line!r}")
    return ProbeResult(first_step_s, **json.loads(rest))


class _FirstStep:
    """Observer that reports to the parent when the first step is done, before anything else sees that step."""

    def __init__(self, inner: Any, first_step_only: bool) -> None:
        self.inner, self.first_step_only = inner, first_step_only

    def begin(self, scene: Scene, first: StepRecord) -> None:
        self.inner.begin(scene, first)

    def step(self, record: StepRecord) -> None:
        if record.step == 1:
            sys.stdout.write(f"{FIRST}\n")
            sys.stdout.flush()
            if self.first_step_only:
                raise _StopRunError
        self.inner.step(record)

    def end(self, rollout: Rollout) -> None:
        self.inner.end(rollout)


class _StopRunError(Exception):
    """Ends the run after its first step."""


def main() -> None:
    """The process under observation."""
    request = json.loads(sys.stdin.read())
    from simcore.rollout.rollout import run
    from simcore.scenario.scenario import Scenario

    module, _, name = request["recorder"].partition(":")
    recorder = getattr(importlib.import_module(module), name)
    scenario = Scenario.load(request["scenario"])
    status = "first step"
    try:
        with recorder(Path(request["recording"])) as observer:
            status = str(run(scenario, _FirstStep(observer, request["first_step_only"])).status)
    except _StopRunError:
        pass
    json.dump({"peak_mb": peak_mb(), "status": status}, sys.stdout)


def peak_mb() -> float | None:
    """The most memory that this process held, 10^6 bytes; None where it is not counted.

    On Linux from /proc: `ru_maxrss` also counts what the parent held at the moment of the fork.
    """
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    except OSError:
        pass
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


if __name__ == "__main__":
    main()
