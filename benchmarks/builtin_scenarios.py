"""The scenarios that are measured: the built-in ones, shortened for a quick look, with changes."""

from __future__ import annotations

from typing import Any

import numpy as np

from simcore.errors import ScenarioError
from simcore.scenario.presets import start, with_changes
from simcore.scenario.scenario import Scenario

QUICK_SHARE = 0.1  # of the path
QUICK_EDGE_MM = 10.0


def benchmark_scenario(name: str, *, quick: bool, changes: tuple[str, ...] = ()) -> Scenario:
    """A built-in scenario with `PATH=VALUE` changes; `quick`: the first tenth of its path, in a coarse mesh."""
    data = start(name)
    if quick:
        data["tissue"]["element_size_mm"] = QUICK_EDGE_MM
        path = data["trajectory"]
        entry, target = np.array(path["entry_mm"]), np.array(path["target_mm"])
        path["target_mm"] = (entry + QUICK_SHARE * (target - entry)).tolist()
        if "amplitude_mm" in path:
            path["amplitude_mm"] *= QUICK_SHARE
    return Scenario.load(with_changes(data, list(changes)))


def with_blocks(scenario: Scenario, **blocks: Any) -> Scenario:
    """A copy with other fields: `with_blocks(s, tissue={"element_size_mm": 4.0}, dt_s=0.005)`.

    The spacing of the constraint points is derived again where the mesh changes, unless it is among the changes.
    """
    data = scenario.resolved()
    if "tissue" in blocks:
        data["interaction"]["spacing_mm"] = None
    for name, value in blocks.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) and "kind" not in value else value
    return Scenario.load(data)


def is_supported(*changes: str) -> bool:
    """Whether the scenario format knows these fields and values: some controllers are built with less."""
    try:
        Scenario.load(with_changes({}, list(changes)))
    except ScenarioError:
        return False
    return True
