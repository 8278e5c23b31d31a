"""The boards of some bundles: one for each set of tasks, its arms ranked by the interquartile mean of their errors."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from benchmarks.bundles.manifest import RECORDINGS
from benchmarks.bundles.tasks import task_of
from benchmarks.grid.profiles import Profiles, profiles
from benchmarks.grid.report import arm_comparisons
from benchmarks.paper import statistics
from benchmarks.paper.comparison import as_json
from benchmarks.paper.report import rules
from benchmarks.paper.table import ALL, Row, arm_name, arms, beside, main_rows, only, rows
from benchmarks.paper.timing import part_ms

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.bundles.manifest import Manifest
    from benchmarks.bundles.verification import Verification
    from benchmarks.cases import Outcome

SCHEMA = "needlebench/leaderboard/1"
SHORT = 12  # digits of a bundle's id in names of files
WORST = 0.95  # the worst 5 % of the cases have at least this quantile
Json = dict[str, Any]


@dataclass(frozen=True)
class Entry:
    """A bundle that takes part. verifications: of it, the newest last."""

    manifest: Manifest
    outcomes: Sequence[Outcome]
    verifications: tuple[Verification, ...] = ()

    @property
    def id(self) -> str:
        """Of the bundle."""
        return self.manifest.id

    @property
    def recordings(self) -> dict[str, str]:
        """Case id -> name in the bundle, in the order of the manifest."""
        names = [file.name for file in self.manifest.files if file.name.startswith(f"{RECORDINGS}/")]
        return {self.manifest.case_of(name): name for name in names}


def recording_file(bundle_id: str, number: int) -> str:
    """Where a site has a recording; cases may have names that no address should."""
    return f"recordings/{bundle_id[:SHORT]}/{number + 1}.rrd"


def bundle_file(bundle_id: str) -> str:
    """Where a site has a bundle."""
    return f"bundles/{bundle_id[:SHORT]}.zip"


def document(entries: Sequence[Entry]) -> Json:
    """All boards as plain JSON; what is not finite (a mean with failures in it) is null.

    Bundles whose tasks are the same share a board, whatever they call their suite. Only tasks that all arms of a board
    ran count in its means, intervals and profiles.
    """
    boards: dict[str, list[Entry]] = {}
    for entry in sorted(entries, key=lambda one: (one.manifest.suite.name, one.id)):
        boards.setdefault(entry.manifest.suite.tasks_sha256, []).append(entry)
    found = {"schema": SCHEMA, "rules": rules(), "boards": [_board(tasks, mine) for tasks, mine in boards.items()]}
    result: Json = as_json(found)
    return result


def _board(tasks: str, entries: Sequence[Entry]) -> Json:
    tables = {entry.id: _table(entry) for entry in entries}
    twice = Counter(arm for table in tables.values() for arm in arms(table))
    table = list[Row]()
    for entry in entries:
        tables[entry.id] = [
            replace(row, arm=_name(row.arm, entry, alone=twice[row.arm] == 1)) for row in tables[entry.id]
        ]
        table += tables[entry.id]
    shown = profiles(table, fewest_arms=1)
    lines = [_line(entry, arm, tables[entry.id], shown) for entry in entries for arm in arms(tables[entry.id])]
    return {
        "title": " / ".join(dict.fromkeys(entry.manifest.suite.name for entry in entries)),
        "tasks_sha256": tasks,
        "file": f"board-{tasks[:SHORT]}.html",
        "suites": [
            {"name": name, "sha256": sha256}
            for name, sha256 in dict.fromkeys((e.manifest.suite.name, e.manifest.suite.sha256) for e in entries)
        ],
        "lines": sorted(lines, key=_rank),
        "profiles": shown,
        "comparisons": [one for one in arm_comparisons(table) if one.group == ALL or len({r.group for r in table}) < 2],
        "bundles": [_evidence(entry) for entry in entries],
    }


def _table(entry: Entry) -> list[Row]:
    """The rows of a bundle, paired with those of others by what they ask."""
    table = main_rows(rows(entry.outcomes))
    return [replace(row, labels={"task": task_of(row.scenario)}) for row in table]


def _name(arm: str, entry: Entry, *, alone: bool) -> str:
    """An arm that several bundles have is named with its bundle."""
    return arm if alone else f"{arm_name(arm)} · {entry.id[:6]}"


def _line(entry: Entry, arm: str, table: Sequence[Row], shown: Profiles | None) -> Json:
    """One arm of a bundle. Errors in mm over the shared tasks; the rest over all of its insertions."""
    mine = only(table, arm=arm)
    known = next((one for one in shown.aggregates if one.arm == arm), None) if shown is not None else None
    errors = [row.rmse_commanded_mm for row in mine]
    return {
        "arm": arm,
        "bundle": entry.id,
        "insertions": len(mine),
        "failed": sum(row.failed for row in mine),
        "cases": 0 if known is None else known.cases,
        "iqm_mm": math.nan if known is None else known.iqm_mm,
        "iqm_interval_mm": statistics.Interval(math.nan, math.nan) if known is None else known.iqm_interval_mm,
        "worst_mm": statistics.quantile(errors, WORST),
        "success": sum(row.success for row in mine) / len(mine),
        "beside": beside(mine),
        "command_l0": _command_l0(entry, mine),
        "steered_by": next((row.steered_by.data() for row in mine if row.steered_by is not None), None),
    }


def _rank(line: Json) -> tuple[bool, float, str]:
    """Smallest mean first; one that is not finite, or no number, comes after every other."""
    iqm = float(line["iqm_mm"])
    return (not math.isfinite(iqm), iqm if math.isfinite(iqm) else 0.0, str(line["arm"]))


def _command_l0(entry: Entry, mine: Sequence[Row]) -> float:
    """Median time of Jacobian and command in L0; nan where either was not measured."""
    times = [ms for row in mine if row.stable and math.isfinite(ms := part_ms(row, "controller"))]
    if entry.manifest.timing is None or not times:
        return math.nan
    return statistics.middle(times) / entry.manifest.timing.l0_ms


def _evidence(entry: Entry) -> Json:
    """What the figures of a bundle rest on."""
    manifest = entry.manifest
    return {
        "id": entry.id,
        "file": bundle_file(entry.id),
        "division": manifest.division,
        "cases": manifest.suite.cases,
        "failed": manifest.failed,
        "version": manifest.made_with.version,
        "lock_sha256": manifest.made_with.lock_sha256,
        "origins": [
            {name: getattr(one, name) for name in ("cases", "commit", "cpu", "blas_core", "platform")}
            for one in manifest.origins
        ],
        "recordings": [
            {"case": case, "file": recording_file(entry.id, number)} for number, case in enumerate(entry.recordings)
        ],
        "warnings": [{"text": one.text, "cases": one.cases} for one in manifest.warnings],
        "verifications": [
            {
                "at": one.at,
                "by": one.by,
                "result": one.result,
                "counts": {name: one.counts[name] for name in ("identical", "equal", "different", "not run")},
                "commit": one.code.commit,
                "cpu": one.code.cpu,
            }
            for one in entry.verifications
        ],
    }
