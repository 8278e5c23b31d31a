"""What `checkouts` executes in a process of its own: insertions with whatever code PYTHONPATH leads to.

It reads scenarios by name as JSON from standard input, writes a line `step` after the very first step and a JSON object
at the end. It must run with any layout of the modules, so it knows the package `needlebench` alone, and is run as a
file: to import it from a package would fix which checkout the package comes from.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from typing import Any

FIRST_STEP = "step"


class StepClock:
    """Observer: seconds between the ends of steps; tells the parent when the first one of the process is done."""

    announced = False

    def __init__(self) -> None:
        self.step_s: list[float] = []
        self._left = 0.0

    def begin(self, _scene: Any, _first: Any) -> None:
        """Start the clock."""
        self._left = time.perf_counter()

    def step(self, _record: Any) -> None:
        """Read the clock."""
        self.step_s.append(time.perf_counter() - self._left)
        if not StepClock.announced:
            StepClock.announced = True
            sys.stdout.write(f"{FIRST_STEP}\n")
            sys.stdout.flush()
        self._left = time.perf_counter()

    def end(self, _rollout: Any) -> None:
        """Nothing is left to do."""


def main() -> None:
    """Run every scenario and write medians in ms, digests, and whose code it was."""
    scenarios: dict[str, dict[str, Any]] = json.load(sys.stdin)
    import needlebench

    report: dict[str, Any] = {"package": needlebench.__file__, "commit": None, "figures": {}, "digests": {}}
    for name, data in scenarios.items():
        clock = StepClock()
        rollout = needlebench.run(needlebench.Scenario.load(data), clock)
        result = rollout.result()
        if result["status"] != "completed":
            sys.exit(f"{name} ended as {result['status']}: {result['message']}")
        report["commit"] = result["provenance"]["commit"]
        report["digests"][name] = result["digest"]
        report["figures"][f"{name}.plant_ms"] = 1e3 * statistics.median(map(float, rollout.series["plant_s"][1:]))
        report["figures"][f"{name}.step_ms"] = 1e3 * statistics.median(clock.step_s)
    json.dump(report, sys.stdout)


if __name__ == "__main__":
    main()
