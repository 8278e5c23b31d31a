"""The golden numbers: what every built-in scenario gives, and the same path without feedback.

`python -m tests.benchmarks.golden` measures them and writes the file; commit it together with the reason.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from simcore.metrics import MEASURED
from simcore.provenance import provenance
from simcore.rollout.rollout import run
from simcore.scenario.presets import preset_names, start, with_changes
from simcore.scenario.scenario import Scenario

FILE = Path(__file__).parents[2] / "benchmarks" / "results" / "builtin_scenarios.json"
SCHEMA = "needlebench/golden/1"
KEPT = ("stable", "success", "steps_completed", "steps", *MEASURED)
OPEN_LOOP = "controller.kind=open_loop"


def changes_of_cases() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Name of a case -> built-in scenario and its changes."""
    cases: dict[str, tuple[str, tuple[str, ...]]] = {name: (name, ()) for name in preset_names()}
    steered = [name for name in cases if start(name)["controller"]["kind"] == "ifem"]
    return {**cases, **{f"{name}, open loop": (name, (OPEN_LOOP,)) for name in steered}}


def scenario_of(case: str) -> Scenario:
    """The scenario of a case, its recording off."""
    name, changes = changes_of_cases()[case]
    return Scenario.load(with_changes(start(name), ["recording.enabled=false", *changes]))


def measure(case: str) -> dict[str, Any]:
    """Run one case: its status and the numbers that are kept."""
    rollout = run(scenario_of(case))
    return {"status": str(rollout.status), "metrics": {name: rollout.metrics[name] for name in KEPT}}


def origin() -> dict[str, Any]:
    """Commit, versions and machine of what is measured here."""
    found = provenance(scenario_of("line").resolved())
    del found["scenario"]
    return found


def main() -> None:
    """Measure all cases and write the file."""
    content = {"schema": SCHEMA, "provenance": origin(), "cases": {case: measure(case) for case in changes_of_cases()}}
    FILE.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
