"""Where a result comes from: arm, commit, versions, machine, threads."""

from __future__ import annotations

import ctypes
import os
import platform
import subprocess
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from simcore.arms import arm_of

_ROOT = Path(__file__).resolve().parent
_PACKAGES = ("needlebench", "numpy", "scipy", "numba", "llvmlite", "pydantic", "rerun-sdk")


@cache
def commit() -> str | None:
    """The git commit of this code: recorded in the wheel, else of the checkout (`-dirty` if it was changed), else the
    variable NEEDLEBENCH_COMMIT, else None."""
    recorded = _ROOT / "_commit.txt"
    if recorded.exists():
        return recorded.read_text().strip() or None
    if (_ROOT.parent / ".git").exists():
        try:
            return _described(_git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no"))
        except (OSError, subprocess.SubprocessError):
            pass
    return os.environ.get("NEEDLEBENCH_COMMIT") or None


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=_ROOT.parent, capture_output=True, text=True, check=True, timeout=10)
    return done.stdout.strip()


def _described(head: str, changes: str) -> str:
    return f"{head}-dirty" if changes else head


@cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


@cache
def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


@cache
def _compiled_for() -> dict[str, str]:
    """Processor and features that kernels are compiled for: they decide which instructions round."""
    from numba import config
    from numba.core import codegen

    features = getattr(config, "CPU_FEATURES", None) or codegen.get_host_cpu_features()  # type: ignore[no-untyped-call]
    enabled = sorted(name[1:] for name in features.split(",") if name.startswith("+"))
    return {
        "llvm_cpu": getattr(config, "CPU_NAME", None) or codegen.ll.get_host_cpu_name(),  # type: ignore[attr-defined]
        "llvm_features": " ".join(enabled),
    }


@cache
def _blas() -> dict[str, str | None]:
    """Kernels and version of the BLAS that SciPy brings, which chooses them by the processor; None where it is not
    OpenBLAS, or does not say."""
    import scipy

    folder = Path(scipy.__file__).resolve().parent
    places = (folder.parent / "scipy.libs", folder / ".dylibs")
    for path in sorted(one for place in places for one in place.glob("*openblas*")):
        with suppress(OSError, AttributeError):
            library = ctypes.CDLL(str(path))
            core, about = library.scipy_openblas_get_corename, library.scipy_openblas_get_config
            core.restype = about.restype = ctypes.c_char_p
            return {"blas_core": core().decode(), "blas_version": " ".join(about().decode().split()[:2])}
    return {"blas_core": None, "blas_version": None}


def provenance(scenario: dict[str, Any]) -> dict[str, Any]:
    """Everything that a reader needs to rerun a result: resolved scenario, seed, the arm that steered, commit,
    versions, machine, threads."""
    return {
        "scenario": scenario,
        "seed": scenario["seed"],
        "arm": arm_of(scenario).data(),
        **machine(),
    }


def machine() -> dict[str, Any]:
    """Commit, versions, processor and threads of this process, whatever it runs."""
    return {
        "commit": commit(),
        "versions": dict(_versions()),
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu": _processor(),
        "cpu_count": os.cpu_count(),
        **_compiled_for(),
        **_blas(),
        "threads": 1,
        "byte_order": sys.byteorder,
    }
