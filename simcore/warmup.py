"""Compiles every kernel once, so that the first real step of a process is like all others."""

from __future__ import annotations

from simcore.rollout import run
from simcore.scenario import Scenario

_SMALL = {
    "name": "warm-up",
    "tissue": {
        "size_mm": [24, 24, 30],
        "element_size_mm": 10,
        "rayleigh_stiffness_s": 0.001,
        "density_kg_m3": 1000,
    },
    "needle": {"length_mm": 60, "elements": 3},
    "trajectory": {"kind": "line", "entry_mm": [12, 12, 0], "target_mm": [12, 12, 4], "speed_mm_s": 50},
}


def warm() -> None:
    """Run eight steps of a tiny insertion: contact, puncture, cutting, steering."""
    run(Scenario.load(_SMALL))
