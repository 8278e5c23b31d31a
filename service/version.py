"""The version of the installed distribution."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """Version of the installed wheel; `0+source` when run from a source tree that is not installed."""
    try:
        return version("needlebench")
    except PackageNotFoundError:
        return "0+source"
