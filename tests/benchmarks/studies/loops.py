"""Made-up closed loops: an RMSE that is first order in the mesh and does not depend on anything else."""

from __future__ import annotations

from benchmarks.studies.closed_loop import CONTROLLERS, LoopPath, LoopRun
from benchmarks.studies.discretisation import FULL

AT_LIMIT = {"ifem": 0.02, "ifem-axis": 0.03, "elm": 0.1}  # mm


def made_path(name: str, suite: str, slope: float, *, extra: float = 0.0) -> LoopPath:
    """slope: mm of RMSE a mm of cell, the same for all controllers; extra: more of the ELM's alone."""
    runs = {}
    for controller in CONTROLLERS:
        mine = slope + (extra if controller == "elm" else 0.0)
        for series in FULL.loop_series():
            for size in series.sizes_mm:
                mesh = size if series.name == "mesh" else FULL.element_size_mm
                rmse = AT_LIMIT[controller] + mine * mesh
                runs[controller, series.name, size] = LoopRun("completed", rmse, 10.0 * rmse)
    return LoopPath(name, suite, FULL.loop_series(), runs)


def made_paths() -> list[LoopPath]:
    """Two of each suite."""
    return [
        made_path("lin-013", "LIN", 0.0),
        made_path("lin-073", "LIN", 0.001),
        made_path("cur-002-y", "CUR", 0.002, extra=0.001),
        made_path("cur-073+y", "CUR", 0.004),
    ]
