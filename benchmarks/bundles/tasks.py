"""What an insertion asks of whatever steers it: its scenario without the controller. Arms of different bundles are
compared where their tasks are the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchmarks.bundles.canonical import digest_of
from simcore.arms import CONDITIONS
from simcore.scenario.sensing import without_idle_sensing

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_BESIDE = ("name", "recording")  # blocks that change nothing of what happens
_FILES = {"tissue": "mesh_file"}  # fields that name a file whose digest stands beside them


def task_of(scenario: Mapping[str, Any]) -> str:
    """SHA-256 of a resolved scenario without the controller, but with its delay, and without names of files."""
    known = {name: value for name, value in without_idle_sensing(dict(scenario)).items() if name not in _BESIDE}
    controller = known.pop("controller", {})
    known["conditions"] = {name: controller[name] for name in CONDITIONS if name in controller}
    for block, field in _FILES.items():
        if isinstance(known.get(block), dict):
            known[block] = {name: value for name, value in known[block].items() if name != field}
    return digest_of(known)


def tasks_sha256(scenarios: Iterable[Mapping[str, Any]]) -> str:
    """SHA-256 over the tasks of a suite, each once, whatever their order."""
    return digest_of(sorted({task_of(one) for one in scenarios}))
