"""cases.jsonl: a line for each insertion, with all that its result says; code and machine stand in the manifest."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.manifest import CASES, ORIGIN, Manifest
from benchmarks.cases import Case, Outcome

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

LONGEST_LINE = 4_000_000  # bytes: a scenario with a list of poses
MOST_CASES = 200_000
_FIELDS = ("id", "labels", "scenario", "result", "arm", "origin", "series_sha256")
Json = dict[str, Any]


@dataclass(frozen=True)
class CaseRecord:
    """A case as a bundle holds it. result: without provenance. arm: its id, None of a case that left no result.
    origin: number of its code and machine in the manifest. series_sha256: of the file that its run left, if any."""

    id: str
    labels: Json
    scenario: Json
    result: Json
    arm: str | None
    origin: int | None
    series_sha256: str | None

    def line(self) -> bytes:
        """As it stands in the file."""
        text = json.dumps(
            {name: getattr(self, name) for name in _FIELDS},
            sort_keys=True,
            separators=(",", ":"),
            ensure_ascii=False,
            allow_nan=False,
        )
        return text.encode() + b"\n"

    def outcome(self, manifest: Manifest) -> Outcome:
        """As the analyses take it, with the provenance that the manifest says."""
        provenance: Json = {"scenario": self.scenario}
        if self.arm is not None:
            arm = next(one for one in manifest.arms if one.id == self.arm)
            provenance["arm"] = arm.arm().data()
        if self.origin is not None:
            provenance |= manifest.origins[self.origin].model_dump(exclude={"cases"})
        return Outcome(Case(self.id, self.scenario, self.labels), {**self.result, "provenance": provenance})


def origin_of(result: Mapping[str, Any]) -> Json:
    """Code and machine of a result, without names; empty of one that does not say."""
    provenance = result.get("provenance") or {}
    return {name: provenance[name] for name in ORIGIN if name in provenance}


def cases_text(records: Iterable[CaseRecord]) -> bytes:
    """The file. Raises BundleError for a value that JSON has no form for."""
    try:
        return b"".join(record.line() for record in records)
    except (TypeError, ValueError, RecursionError) as error:
        raise BundleError(f"a result cannot be written as JSON: {error}") from None


def read_cases(lines: Iterable[bytes]) -> list[CaseRecord]:
    """The cases of a file's lines. Raises BundleError, which names the line."""
    records = list[CaseRecord]()
    for number, line in enumerate(lines, start=1):
        if number > MOST_CASES:
            raise BundleError(f"{CASES} has more than {MOST_CASES} lines")
        records.append(_read(line, f"{CASES}, line {number}"))
    return records


def _read(line: bytes, where: str) -> CaseRecord:
    try:
        data = json.loads(line)
        record = CaseRecord(**data)
        same = record.line() == line + b"\n"
    except (ValueError, TypeError, RecursionError) as error:
        raise BundleError(f"{where} is no case: {str(error)[:200]}") from None
    kinds = {"id": str, "labels": dict, "scenario": dict, "result": dict}
    wrong = [name for name, kind in kinds.items() if not isinstance(getattr(record, name), kind)]
    if wrong or not isinstance(record.arm, str | None) or not isinstance(record.origin, int | None):
        raise BundleError(f"{where} is no case: {(wrong or ['arm or origin'])[0]} is of another kind")
    if not same:
        raise BundleError(f"{where} is not spelled as a bundle spells it")
    return record


def ids_of(records: Sequence[CaseRecord]) -> list[str]:
    """In the order of the suite."""
    return [record.id for record in records]
