"""The JSON of health, readiness, version and built-in scenarios."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Literal, Self

from pydantic import BaseModel, Field

from service.engine.health_checks import Check


class Health(BaseModel):
    """The process is alive."""

    status: Literal["ok"] = "ok"


class CheckView(BaseModel):
    """The result of one check."""

    name: str
    level: Literal["ok", "warn", "bad"]
    found: str
    advice: str = Field(description="What to do if it is not ok.")

    @classmethod
    def of(cls, check: Check) -> Self:
        """The JSON of a check."""
        return cls(**asdict(check))


class Readiness(BaseModel):
    """Whether jobs can run."""

    status: Literal["ready", "starting"]
    workers: int = Field(description="Slots for jobs.")
    workers_ready: int = Field(description="Slots with a warm worker process.")
    problem: str | None
    warnings: list[str] = Field(description="What an operator should know, such as a disk that is nearly full.")
    checks: list[CheckView]


class ScenarioInfo(BaseModel):
    """A built-in scenario."""

    name: str
    description: str
    scenario: dict[str, Any] = Field(description="Every field; null where it follows from others.")


class ScenarioList(BaseModel):
    """The built-in scenarios."""

    items: list[ScenarioInfo]


class Version(BaseModel):
    """Versions of the program, of Python and of the scenario format."""

    name: Literal["needlebench"] = "needlebench"
    version: str
    python: str
    scenario_schema: str
