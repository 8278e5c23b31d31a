"""What a rerun of some cases of a bundle showed: a record beside the bundle, which a leaderboard shows."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.manifest import Origin, Sha256, Text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

SCHEMA: Literal["needlebench/verification/1"] = "needlebench/verification/1"
EQUAL = 1e-6  # of a measure in its own unit, and of the tip's path in mm
Result = Literal["identical", "equal", "different", "not run"]
MOST_BYTES = 10_000_000


class CaseVerification(BaseModel):
    """One case. where: what differs, or why it was not run; empty of an identical one."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: Text
    result: Result
    where: Text = ""
    tip_mm: float | None = None


class Verification(BaseModel):
    """A verification. by: who says so, as they call themselves. code: commit, versions and machine of the rerun."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_: Literal["needlebench/verification/1"] = Field(SCHEMA, alias="schema")
    bundle: Sha256
    suite: Text
    at: Annotated[str, StringConstraints(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")]
    by: Annotated[str, StringConstraints(max_length=200)] | None
    seed: int
    code: Origin
    cases: list[CaseVerification]

    @property
    def counts(self) -> Counter[str]:
        """How many cases have which result."""
        return Counter(case.result for case in self.cases)

    @property
    def result(self) -> Result:
        """The worst of all that were run."""
        ranked: tuple[Result, ...] = ("different", "equal", "identical")
        return next((one for one in ranked if self.counts[one]), "not run")

    def text(self) -> str:
        """The content of the record."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


def read_verification(path: Path) -> Verification:
    """A record. Raises BundleError."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BundleError(f"{path}: is too large for a verification")
        return Verification.model_validate_json(path.read_bytes())
    except OSError as error:
        raise BundleError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise BundleError(f"{path}: is no verification of {SCHEMA}: {where} {fault['msg']}") from None


def record_of(bundle: Path) -> Path:
    """Where the verification of a bundle lies: beside it."""
    return bundle.with_suffix(".verification.json")


def measure_apart(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """The first measure that is not within 1e-6 of what it was, as text; empty where all are."""
    for name in sorted(before.keys() & now.keys()):
        old, new = before[name], now[name]
        numbers = isinstance(old, int | float) and isinstance(new, int | float)
        if not (abs(old - new) <= EQUAL * max(1.0, abs(old)) if numbers else old == new):
            return f"metrics.{name}: {old} then, {new} now"
    return ""
