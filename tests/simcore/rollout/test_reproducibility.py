"""The same bits whatever the way: every kind of run, the command line, processes side by side.

`test_rollout.py` has the rest for one I-FEM run: recording, clock, observer, seed, cold cache, any small scenario.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.errors import Status
from simcore.rollout.digest import digest
from simcore.rollout.result import FRAMES, TIMES, Rollout
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario
from tests.verification import verify

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[3]
SOURCE = "definition: one scenario, one result"
SMALL: dict[str, Any] = {
    "name": "small",
    "seed": 7,
    "dt_s": 0.05,
    "noise_mm": 0.1,
    "tissue": {"size_mm": [24, 40, 40], "element_size_mm": 10},
    "needle": {"length_mm": 80, "elements": 8},
    "interaction": {"spacing_mm": 10},
    "trajectory": {"kind": "sine", "entry_mm": [12, 20, 0], "target_mm": [12, 22, 30], "amplitude_mm": 1.0},
}
DYNAMIC = {**SMALL["tissue"], "density_kg_m3": 1000, "rayleigh_mass_per_s": 5, "rayleigh_stiffness_s": 0.01}
BACK_AND_FORTH = [[12.0, 20.0, -80.0 + z, 1.0, 0.0, 0.0, 0.0] for z in [*range(1, 20), *range(18, -3, -2), *range(15)]]
KINDS: dict[str, dict[str, Any]] = {
    "quasi-static": SMALL,
    "dynamic": {**SMALL, "tissue": DYNAMIC},
    "tissue frame": {**SMALL, "trajectory": {**SMALL["trajectory"], "frame": "tissue"}},
    "open loop": {**SMALL, "controller": {"kind": "open_loop"}},
    "push, pull, push": {**SMALL, "controller": {"kind": "replay", "poses": BACK_AND_FORTH}},
    "failing": {**SMALL, "solver": {"max_iterations": 3}},
}


@pytest.fixture(scope="module")
def first() -> dict[str, Rollout]:
    """Every kind once, one after the other."""
    return {name: run(Scenario.load(data)) for name, data in KINDS.items()}


@pytest.mark.slow
def test_every_kind_again_in_reverse_order(first: dict[str, Rollout]) -> None:
    """Nothing is kept from run to run: neither factors nor columns of another problem of the same size."""
    assert [found.status is Status.COMPLETED for found in first.values()] == [True] * 5 + [False]
    again = {name: run(Scenario.load(KINDS[name])) for name in reversed(KINDS)}
    different = [name for name in KINDS if again[name].digest != first[name].digest]
    text = f"runs whose digest differs the second time, other runs between: {', '.join(KINDS)}"
    verify("reproducibility", text, expected=0, measured=len(different), tolerance=0, source=SOURCE)


@pytest.mark.slow
def test_all_kinds_are_different(first: dict[str, Rollout]) -> None:
    """Non-vacuity: a digest tells runs apart."""
    assert len({found.digest for found in first.values()}) == len(KINDS)


def without_timing(result: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in result.items() if name != "timing"}


@pytest.mark.slow
@pytest.mark.parametrize("changes", [(), ("recording.enabled=false",), ("recording.every_steps=1",)])
def test_the_command_line_gives_what_a_call_gives(
    first: dict[str, Rollout], tmp_path: Path, changes: tuple[str, ...]
) -> None:
    """`needlebench run` in a process of its own, with and without a recording: digest, every array, every number."""
    here = first["dynamic"]
    words = [sys.executable, "-m", "service.cli", "run", "-", "--out", str(tmp_path / "out")]
    words += [word for change in changes for word in ("--set", change)]
    done = subprocess.run(words, input=json.dumps(KINDS["dynamic"]), cwd=ROOT, capture_output=True, text=True)
    assert done.returncode in (0, 3), done.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    with np.load(tmp_path / "out" / "series.npz", allow_pickle=False) as file:
        series = dict(file)
    different = [name for name, array in series.items() if not _same(name, array, here)]
    different += ["digest"] * (result["digest"] != digest(series)) + ["result"] * (result["digest"] != here.digest)
    text = f"arrays and digests of the command line that differ from a call's, {' '.join(changes) or 'as it is'}"
    verify("reproducibility", text, expected=0, measured=len(different), tolerance=0, source=SOURCE)
    expected = without_timing(json.loads(json.dumps(here.result())))
    assert {**without_timing(result), "provenance": None} == {**expected, "provenance": None}


def _same(name: str, array: np.ndarray, here: Rollout) -> bool:
    return name in (*TIMES, *FRAMES) or np.array_equal(array, here.series[name], equal_nan=array.dtype.kind == "f")


PROGRAM = """
import json, sys
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario
print(json.dumps([run(Scenario.load(data)).digest for data in json.load(sys.stdin)]))
"""


ARC = {"kind": "arc", "entry_mm": [12, 20, 0], "target_mm": [12, 22, 20], "radius_mm": 300}
POINTS = {"kind": "waypoints", "entry_mm": [12, 20, 0], "points_mm": [[12, 20.4, 10], [12, 21, 20]]}
OTHERS: dict[str, dict[str, Any]] = {
    "exact Jacobian": {**SMALL, "controller": {"kind": "ifem", "derivative": "exact"}},
    "perturbation": {**SMALL, "controller": {"kind": "ifem", "jacobian": "perturbation"}, "trajectory": ARC},
    "axis": {**SMALL, "controller": {"kind": "ifem", "orientation": "axis"}, "trajectory": POINTS},
    "elm": {**SMALL, "controller": {"kind": "elm"}},
    "linearised": {**SMALL, "solver": {"mode": "linearised"}},
    "hard": {**SMALL, "interaction": {"spacing_mm": 10, "line_compliance": False, "tip": "held", "puncture_n": 0.05}},
    "breathing": {**SMALL, "tissue": DYNAMIC, "motion": {"kind": "breathing", "amplitude_mm": 0.5, "period_s": 2}},
}
FEATURES = import_module("numpy._core._multiarray_umath").__cpu_features__
WIDE = [name for name in ("X86_V3", "X86_V4", "AVX512_ICL", "AVX512_SPR") if FEATURES.get(name)]
PLAIN_C = ",".join(f"-{name}" for name in ("AVX2", "AVX2_Usable", "FMA", "FMA_Usable", "FMA4", "AVX512F", "AVX512VL"))
PROCESSORS = {  # OpenBLAS's kernels, those of Numba, NumPy's loops, the functions of the C library
    **{f"OpenBLAS for {core}": {"OPENBLAS_CORETYPE": core} for core in ("Prescott", "Haswell", "SkylakeX")},
    "NumPy and C library without AVX and FMA": {
        "NPY_DISABLE_CPU_FEATURES": " ".join(WIDE),
        "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={PLAIN_C}",
    },
    "kernels for any x86-64": {"NUMBA_CPU_NAME": "generic"},
}


@pytest.fixture(scope="module")
def here() -> list[str]:
    """Digests of all kinds in this process."""
    return [run(Scenario.load(data)).digest for data in (KINDS | OTHERS).values()]


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="about x86-64 processors")
@pytest.mark.parametrize("name", PROCESSORS)
def test_another_processor_gives_the_same_digests(here: list[str], name: str, tmp_path: Path) -> None:
    """The compliance that the mesh owes is computed there, too: nothing is kept but compiled kernels, and not even they
    where they are those of another processor."""
    cold = str(tmp_path / "kernels") if "NUMBA_CPU_NAME" in PROCESSORS[name] else os.environ["NUMBA_CACHE_DIR"]
    kernels = {"NUMBA_CACHE_DIR": cold, "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input=json.dumps(list((KINDS | OTHERS).values())),
        env={**os.environ, **kernels, **PROCESSORS[name]},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    different = [kind for kind, a, b in zip(KINDS | OTHERS, json.loads(done.stdout), here, strict=True) if a != b]
    text = f"digests that differ: {name}, of {len(here)} kinds of runs"
    verify("reproducibility", text, expected=0, measured=len(different), tolerance=0, source=SOURCE)


@pytest.mark.slow
def test_processes_side_by_side(first: dict[str, Rollout]) -> None:
    """Two processes at the same time, one in the other's order, against one alone."""
    processes = [_started(), _started()]
    orders = [list(KINDS), list(reversed(KINDS))]
    for process, names in zip(processes, orders, strict=True):
        assert process.stdin is not None
        process.stdin.write(json.dumps([KINDS[name] for name in names]))
        process.stdin.close()
    different = [
        name
        for process, names in zip(processes, orders, strict=True)
        for name, found in zip(names, _answer(process), strict=True)
        if found != first[name].digest
    ]
    text = "runs of two processes side by side whose digest differs from that of one"
    verify("reproducibility", text, expected=0, measured=len(different), tolerance=0, source=SOURCE)


def _started() -> subprocess.Popen[str]:
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    return subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def _answer(process: subprocess.Popen[str]) -> Iterator[str]:
    assert process.stdout is not None
    with process:
        found = json.loads(process.stdout.read())
    assert process.returncode == 0
    return iter(found)
