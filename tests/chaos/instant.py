"""A runner whose jobs end at once, with small files in place of a simulation's; or after some CPU time, if asked."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from service.worker import attempt as worker
from tests.acceptance import fakes

SPIN = "spin "  # name of a scenario that asks for CPU time: "spin 50" for 50 ms


def run_job(spec: dict[str, Any], artefact_dir: Path) -> dict[str, Any]:
    """Whatever the scenario says; a name `spin MS` works that long, and leaves no files."""
    name = spec["scenario"]["name"]
    if not name.startswith(SPIN):
        return fakes.run_job({**spec, "scenario": {**spec["scenario"], "name": "quick"}}, artefact_dir)
    end = time.process_time() + float(name.removeprefix(SPIN).split()[0]) * 1e-3
    while time.process_time() < end:
        pass
    return {"status": "completed", "metrics": {"success": True}, "seed": spec["scenario"]["seed"]}


def only_the_job(runner: str, spec: dict[str, Any], folder: str) -> Any:
    """In a worker: what `runner` does, and nothing around it."""
    target = Path(folder)
    target.mkdir(parents=True)
    return worker.resolve(runner)(spec, target)


def warm_up() -> None:
    """Nothing to compile."""
