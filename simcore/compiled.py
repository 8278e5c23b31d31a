"""Numba, set up once: a cache that can never be stale, no fast-math, plain Python types for the type checker.

Numba keys a cached kernel by its own file and not by the files of the kernels that it calls, so the cache folder
carries a hash of every source file of this package and of the versions that matter.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import platformdirs

Function = TypeVar("Function", bound=Callable[..., object])


def fingerprint() -> str:
    """Of the sources of this package and of the versions that its kernels depend on."""
    from importlib.metadata import version

    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    for package in ("numba", "llvmlite", "numpy"):
        digest.update(version(package).encode())
    return digest.hexdigest()[:16]


def user_cache() -> Path:
    """The user's cache folder of this program; it need not exist."""
    return Path(platformdirs.user_cache_dir("needlebench"))


def _cache_folder() -> str:
    """A writable folder for this very source: the user's cache, else a temporary one (compiled anew each time)."""
    wanted = user_cache() / f"kernels-{fingerprint()}"
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=wanted):
            return str(wanted)
    except OSError:
        return tempfile.mkdtemp(prefix="needlebench-kernels-")


if "NUMBA_CACHE_DIR" not in os.environ:
    os.environ["NUMBA_CACHE_DIR"] = _cache_folder()

import numba  # noqa: E402  (the cache folder must be known first)
import numba.extending  # noqa: E402

from simcore.machine_code import Kernel  # noqa: E402


def kernel(function: Function) -> Function:
    """Compile on first call, cache on disk, divide like numpy. No fast-math: sums keep their order."""
    return cast("Function", Kernel(function))


def resolved_by_type(stub: Callable[..., object]) -> Callable[[Function], Function]:
    """Decorates the chooser of `stub`'s implementation inside kernels: called at compile time with the types."""
    return cast("Callable[[Function], Function]", numba.extending.overload(stub))


def inlined(function: Function) -> Function:
    """A kernel that melts into its callers, where a call would stop the vectoriser."""
    return cast("Function", numba.njit(cache=True, error_model="numpy", inline="always")(function))


def written_in_llvm(make: Callable[..., object]) -> Callable[..., Any]:
    """A function for kernels alone, for what Python has no words for. make: called at compile time with the context and
    the types, it returns a signature and what writes the code, or None for types that it does not take."""
    return cast("Callable[..., Any]", numba.extending.intrinsic(make))
