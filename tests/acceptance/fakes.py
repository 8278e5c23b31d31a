"""Stand-ins for the simulation, to test the service around it: quick, and able to misbehave on demand."""

from __future__ import annotations

import json
import os
import signal
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from service.files.replace_text import replace_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class UnprintableError(Exception):
    """Its message cannot be had."""

    def __str__(self) -> str:
        raise RuntimeError("no message")


def endless() -> list[Any]:
    """A list that holds itself."""
    loop: list[Any] = []
    loop.append(loop)
    return loop


FAULTS: dict[str, Callable[[], BaseException]] = {
    "raises": lambda: ValueError("asked to"),
    "exits": lambda: SystemExit(3),
    "interrupts": KeyboardInterrupt,
    "closes": GeneratorExit,
    "raises a base": lambda: BaseException("asked to"),
    "raises a surrogate": lambda: ValueError("\ud800 asked to"),
    "raises a nan": lambda: ValueError(float("nan")),
    "raises 50 MB": lambda: ValueError("asked to" * 6_250_000),
    "raises the unprintable": UnprintableError,
}
STEPS = {"some seconds": 100, "long": 1200, "deaf": 1200}  # of a twentieth of a second; any other name is quick
UNFIT_RESULTS: dict[str, Callable[[], Any]] = {
    "returns an object": lambda: object(),
    "returns a function": lambda: lambda: None,
    "returns a loop": endless,
    "returns 70 MB": lambda: "x" * 70_000_000,
}


def fell(name: str) -> None:
    """End the process of the worker, or of the server."""
    if name in ("dies late", "fells the server"):
        time.sleep(0.5)
    if name == "fells the server":
        os.kill(os.getppid(), signal.SIGKILL)
    if name in ("dies", "dies late"):
        os._exit(9)


def run_job(spec: dict[str, Any], artefact_dir: Path) -> dict[str, Any]:
    """Behaves as the name of the scenario says, all the time or in its first attempt only (`... once`)."""
    name = spec["scenario"]["name"]
    if name.endswith(" once") and artefact_dir.name != "1":
        name = "quick"
    name = name.removesuffix(" once")
    if name == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    print(f"this is {name}")
    (artefact_dir / "pid").write_text(str(os.getpid()))
    if name in FAULTS:
        raise FAULTS[name]()
    if name in UNFIT_RESULTS:
        return {"status": "completed", "metrics": {"success": True}, "extra": UNFIT_RESULTS[name]()}
    fell(name)
    if name == "bad progress":
        (artefact_dir / "progress.json").write_text('{"fraction": NaN, "step": 1, "steps": 2}')
        return {"status": "completed", "metrics": {"success": True}}
    hoard: list[bytearray] = []
    while name == "greedy":
        hoard.append(bytearray(os.urandom(1 << 20) * 10))
        time.sleep(0.01)
    with (artefact_dir / "recording.rrd").open("wb") as recording:
        for step in range(1, STEPS.get(name, 2)):
            recording.write(b"step %d\n" % step)
            recording.flush()
            progress = {"fraction": 0.5, "step": step, "steps": 1200, "depth_mm": 0.1 * step}
            replace_text(artefact_dir / "progress.json", json.dumps(progress))
            time.sleep(0.05)
    tip = np.arange(6.0).reshape(2, 3)
    np.savez(artefact_dir / "series.npz", t_s=np.array([0.0, np.nan]), tip_m=tip, tissue_rest_m=np.zeros((5, 3)))
    success = name in ("quick", "some seconds")
    result = {"status": "completed", "metrics": {"success": success, "rmse_commanded_mm": 0.5, "bad": float("nan")}}
    (artefact_dir / "result.json").write_text(json.dumps({"status": "completed"}))
    return result


def warm_up() -> None:
    """Nothing to compile."""
