"""The golden numbers of the built-in scenarios: `python -m tests.simcore.rollout.golden` measures them again.

A change of them is a change of the results: it is explained in the change log, and the digests in the documents change
with it.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

from llvmlite.binding import get_host_cpu_name  # type: ignore[import-untyped]
from threadpoolctl import threadpool_info

from simcore.rollout.rollout import run
from simcore.scenario.presets import preset, preset_names

FILE = Path(__file__).with_name("golden.json")
MEASURES = ("rmse_mm", "max_insertion_force_n", "rcm_mean_mm", "rcm_max_mm")
DECIMALS = 9  # three more than what is compared


def measured(name: str) -> dict[str, float]:
    """The golden measures of a built-in scenario, as it runs here: mm and N."""
    metrics = run(preset(name)).metrics
    return {measure: round(float(metrics[measure]), DECIMALS) for measure in MEASURES}


def machine() -> str:
    """What rounding depends on: the processor that kernels are compiled for, the BLAS kernels, versions of libraries.

    Between two of these, libraries take other instructions, and sums are rounded otherwise.
    """
    blas = sorted({str(pool["architecture"]) for pool in threadpool_info() if "architecture" in pool})
    packages = [f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "llvmlite")]
    return ", ".join([get_host_cpu_name(), *blas, *packages])


def main() -> None:
    """Write the file."""
    found = {"machine": machine(), "scenarios": {name: measured(name) for name in preset_names()}}
    FILE.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
