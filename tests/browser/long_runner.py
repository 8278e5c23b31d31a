"""A stand-in for a simulation that runs for a quarter of an hour and says twice a second how far it is."""

from __future__ import annotations

import json
import math
import time
from typing import TYPE_CHECKING, Any

from service.files.replace_text import replace_text
from tests.browser.runner import warm_up

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["run_job", "warm_up"]

STEPS, PAUSE_S = 1800, 0.5


def run_job(_spec: dict[str, Any], artefact_dir: Path) -> dict[str, Any]:
    """Pretend to push in."""
    for step in range(STEPS + 1):
        progress = {
            "fraction": step / STEPS,
            "step": step,
            "steps": STEPS,
            "depth_mm": 100.0 * step / STEPS,
            "tip_error_mm": 0.1 + 0.05 * math.sin(step / 9),
            "cross_track_mm": 0.05,
            "insertion_force_n": 0.5 + step / STEPS,
            "eta_s": (STEPS - step) * PAUSE_S,
        }
        replace_text(artefact_dir / "progress.json", json.dumps(progress))
        time.sleep(PAUSE_S)
    result: dict[str, Any] = {"status": "completed", "message": "", "metrics": {}, "digest": None, "warnings": []}
    (artefact_dir / "result.json").write_text(json.dumps(result))
    return result
