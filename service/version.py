"""The version of the installed distribution, and what it was locked to."""

from __future__ import annotations

import hashlib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def installed_version() -> str:
    """Version of the installed wheel; `0+source` when run from a source tree that is not installed."""
    try:
        return version("needlebench")
    except PackageNotFoundError:
        return "0+source"


def lock_sha256() -> str | None:
    """SHA-256 of the locked requirements of this checkout; None of an installed package."""
    lock = Path(__file__).parents[1] / "requirements.lock"
    return hashlib.sha256(lock.read_bytes()).hexdigest() if lock.is_file() else None
