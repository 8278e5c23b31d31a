"""Which code and which versions a process runs: workers of another identity than the campaign's are refused."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from service.version import lock_sha256
from simcore.provenance import machine

if TYPE_CHECKING:
    from collections.abc import Mapping

Identity = dict[str, str | None]
_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("simcore", "benchmarks", "service", "needlebench")


@cache
def _identity() -> Identity:
    about = machine()
    try:
        engine = version("distributed")
    except PackageNotFoundError:
        engine = "not installed"
    return {
        "commit": about["commit"],
        "code": _code_sha256(),
        "lock": lock_sha256(),
        **about["versions"],
        "distributed": engine,
    }


def identity() -> Identity:
    """Of this process: commit, SHA-256 of all of its code, of its lock, and the version of each package that decides a
    result; what is not known is None."""
    return dict(_identity())


def difference(worker: Mapping[str, str | None], campaign: Mapping[str, str | None]) -> str | None:
    """The first thing in which a worker differs from the campaign, in words; None for one that may take part."""
    for name, wanted in campaign.items():
        found = worker.get(name)
        if found != wanted:
            return f"{name} is {_short(found)} there and {_short(wanted)} for the campaign"
    return None


def _short(value: str | None) -> str:
    """Digests by their beginning."""
    if value is None:
        return "unknown"
    return value if len(value) < 40 else value[:12] + ("-dirty" if value.endswith("-dirty") else "")


def _code_sha256() -> str:
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for source in sorted((_ROOT / package).rglob("*.py")):
            digest.update(source.relative_to(_ROOT).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()
