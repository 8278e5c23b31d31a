"""How much the service takes on: sizes, queue, rate, cost of a job. Each limit has one environment variable."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

from simcore.errors import Problem, ScenarioError


class SettingsError(ScenarioError):
    """A setting out of its range; `problems` names each setting, its value and the allowed range."""


def _limit(default: float, low: float, high: float, variable: str, text: str) -> Any:
    return field(default=default, metadata={"low": low, "high": high, "variable": variable, "text": text})


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What is refused, and from where on; all defaults [ours]. 1 MB = 10^6 bytes."""

    body_mb: float = _limit(32, 0.001, 1000, "NEEDLEBENCH_MAX_BODY_MB", "MB of a request's body, uploads apart")
    upload_mb: float = _limit(64, 0.001, 200, "NEEDLEBENCH_MAX_UPLOAD_MB", "MB of an uploaded file")
    uploads_mb: float = _limit(2000, 0.001, 1e9, "NEEDLEBENCH_MAX_UPLOADS_MB", "MB of all uploaded files together")
    queue: int = _limit(10_000, 1, 1_000_000, "NEEDLEBENCH_MAX_QUEUE", "queued jobs")
    queue_per_key: int = _limit(5_000, 1, 1_000_000, "NEEDLEBENCH_MAX_QUEUE_PER_KEY", "queued jobs of one key")
    rate_per_key: float = _limit(
        100, 0, 100_000, "NEEDLEBENCH_RATE_PER_KEY", "requests a second of one key, bursts of twice as many; 0 = any"
    )
    nodes: int = _limit(60_000, 8, 1_000_000, "NEEDLEBENCH_MAX_NODES", "nodes of a tissue mesh")
    steps: int = _limit(200_000, 1, 1_000_000, "NEEDLEBENCH_MAX_STEPS", "steps of a job")
    job_hours: float = _limit(24, 0.001, 1000, "NEEDLEBENCH_MAX_JOB_HOURS", "hours that a job may take by estimate")
    job_memory_mb: int = _limit(
        4096, 700, 1_000_000, "NEEDLEBENCH_JOB_MEMORY_MB", "MB of memory of a job, by estimate and while it runs"
    )

    def __post_init__(self) -> None:
        problems = []
        for item in fields(self):
            low, high, value = item.metadata["low"], item.metadata["high"], getattr(self, item.name)
            if not (math.isfinite(value) and low <= value <= high):
                problems.append(Problem(item.metadata["variable"], value, f"must be {low:g} to {high:g}"))
        if problems:
            raise SettingsError(problems)

    @property
    def body_bytes(self) -> int:
        return round(self.body_mb * 1e6)

    @property
    def upload_bytes(self) -> int:
        return round(self.upload_mb * 1e6)

    @classmethod
    def load(cls, environ: Mapping[str, str]) -> Self:
        """Environment variables, then defaults. Raises SettingsError."""
        given = {}
        for item in fields(cls):
            variable, whole = item.metadata["variable"], item.type == "int"
            text = environ.get(variable, "").strip()
            if text:
                given[item.name] = _number(variable, text, whole=whole)
        return cls(**given)


def limits_help() -> list[tuple[str, str]]:
    """Variable and meaning of each limit, with its default."""
    return [
        (item.metadata["variable"], f"{item.metadata['text']}; default {item.default:g}") for item in fields(Limits)
    ]


def _number(variable: str, text: str, *, whole: bool) -> Any:
    try:
        return int(text) if whole else float(text)
    except ValueError:
        kind = "a whole number" if whole else "a number"
        raise SettingsError([Problem(variable, text[:100], f"must be {kind}")]) from None
