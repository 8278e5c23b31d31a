"""A whole run that takes 41 steps of a millisecond."""

from __future__ import annotations

from typing import Any

from simcore.scenario.scenario import Scenario

STEPS = 41

SHORT: dict[str, Any] = {
    "name": "short",
    "seed": 11,
    "dt_s": 0.1,
    "noise_mm": 0.25,
    "tissue": {"size_mm": [24, 40, 40], "element_size_mm": 10},
    "needle": {"length_mm": 80, "elements": 8},
    "interaction": {"spacing_mm": 10},
    "trajectory": {"kind": "sine", "entry_mm": [12, 20, 0], "target_mm": [12, 22, 40], "amplitude_mm": 1.0},
    "recording": {"every_steps": 10},
}


LINE = {"kind": "line", "entry_mm": [12, 20, 0], "target_mm": [12, 20, 40]}


def short(**blocks: Any) -> Scenario:
    """A millisecond a step: 3 x 5 x 5 nodes; keywords update blocks, one with a kind replaces its block."""
    data = {**SHORT}
    for name, values in blocks.items():
        updates = isinstance(values, dict) and "kind" not in values
        data[name] = {**data.get(name, {}), **values} if updates else values
    return Scenario.load(data)


def replay(poses: list[list[float]]) -> dict[str, Any]:
    """A controller that prescribes these base poses."""
    return {"kind": "replay", "poses": poses}
