"""Outcomes as rows: what each insertion was, how it ended, what it measured. Also as a CSV file, one line each."""

from __future__ import annotations

import csv
import io
import json
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from simcore.arms import Arm, makes_arm
from simcore.metrics import MEASURED

if TYPE_CHECKING:
    from benchmarks.cases import Label, Outcome

ALL = "ALL"
TRAINING = "DATA"  # group of the data set's insertions, in no comparison
GROUPS = ("LIN", "CUR")
QUIET_ARM = "elm_quiet"  # the ELM that was trained without target noise
ARMS = ("ifem", "elm", QUIET_ARM, "frozen", "linear", "neighbours", "mlp", "replay", "open_loop", "rigid")
ARM_NAMES = {
    "ifem": "I-FEM",
    "elm": "ELM",
    QUIET_ARM: "ELM trained without noise",
    "frozen": "frozen Jacobian",
    "linear": "linear regression",
    "neighbours": "nearest neighbours",
    "mlp": "small network",
    "open_loop": "open loop",
    "rigid": "rigid needle",
}
REFERENCES = ("open_loop", "rigid")  # what no feedback and no model reach
BESIDE = {
    "rcm_max_mm": ("RCM error, mm", 2),
    "max_push_n": ("Push, N", 2),
    "max_lateral_n": ("Lateral force, N", 2),
    "entry_drag_mm": ("Entry drag, mm", 2),
    "max_strain": ("Strain", 2),
    "max_needle_stress_mpa": ("Needle stress, MPa", 0),
}  # what a small tip error may have been paid with, each the largest of its run: heading and decimals in every table
OF_ARMS = ("arm", "jacobian")  # labels that name the arm, beside the fields of its controller
SPECIAL = ("model_seed", "parameter")  # labels of the ELM's seeds and of the sensitivity study
TIMED = ("plant", "jacobian", "command", "recording")


@dataclass(frozen=True)
class Row:
    """One insertion. end_mm, entry_mm: (x, y) mm, world. timing_ms: medians over its steps, and the mean of a step."""

    id: str
    group: str
    arm: str
    young: str
    noise: str
    end_point: str
    direction: str
    labels: Mapping[str, Label]
    scenario: Mapping[str, Any]
    status: str
    message: str
    stable: bool
    success: bool
    metrics: Mapping[str, Any]
    timing_ms: Mapping[str, float | None]
    digest: str
    warnings: tuple[str, ...] = ()
    steered_by: Arm | None = None  # as the result says it; None of a case without one

    @property
    def failed(self) -> bool:
        """Not stable, in the paper's sense of S."""
        return not self.stable

    @property
    def rmse_commanded_mm(self) -> float:
        """The paper's RMSE; a failure ranks behind everything."""
        return self.ranked("rmse_commanded_mm")

    @property
    def pair(self) -> tuple[str, str, str]:
        """What two insertions share that are to be compared with each other."""
        return self.group, self.end_point, self.direction

    @property
    def place(self) -> str:
        """What two cases share that differ in the arm alone, whatever became of them: every other label."""
        apart = {name: v for name, v in self.labels.items() if not (name in OF_ARMS or makes_arm(name))}
        return json.dumps(apart, sort_keys=True)

    @property
    def end_mm(self) -> tuple[float, float]:
        """Where the path ends on the far face."""
        return _lateral(self.scenario, "target_mm")

    @property
    def entry_mm(self) -> tuple[float, float]:
        """Where the needle goes in."""
        return _lateral(self.scenario, "entry_mm")

    @property
    def yielded(self) -> bool | None:
        """Whether the needle would have stayed bent; None where its stress was not measured."""
        stress, allowed = self.metrics.get("max_needle_stress_mpa"), self.scenario.get("needle", {}).get("yield_mpa")
        return None if stress is None or allowed is None else bool(stress >= allowed)

    def ranked(self, metric: str) -> float:
        """A metric of which less is better; infinite for a failure and where nothing was measured."""
        value = self.metrics.get(metric)
        return math.inf if self.failed or value is None or not math.isfinite(value) else float(value)


Keep = Callable[[Row], bool]


def rows(outcomes: Iterable[Outcome]) -> list[Row]:
    """One row for each outcome, by id. Labels that a campaign left out follow from the scenario; an arm whose code
    changed between two insertions is an arm for each edition."""
    table = sorted((_row(outcome) for outcome in outcomes), key=lambda row: row.id)
    editions: dict[str, set[str]] = {}
    for row in table:
        editions.setdefault(row.arm, set()).add(_edition(row))
    apart = {arm for arm, found in editions.items() if len(found - {""}) > 1}
    return [
        replace(row, arm=f"{row.arm} ({_edition(row)})") if row.arm in apart and _edition(row) else row for row in table
    ]


def _edition(row: Row) -> str:
    return "" if row.steered_by is None else row.steered_by.edition


def _row(outcome: Outcome) -> Row:
    case, result = outcome.case, outcome.result
    labels, scenario = case.labels, case.scenario
    measured = result.get("metrics") or {}
    end = _lateral(scenario, "target_mm")
    return Row(
        id=case.id,
        group=str(labels.get("group", "insertions")),
        arm=str(labels.get("arm") or _controller(scenario.get("controller", {}))),
        young=str(labels.get("young", "")),
        noise=str(labels.get("noise", "on" if scenario.get("noise_mm") else "off")),
        end_point=str(labels.get("end_point", f"{end[0]:g} {end[1]:g}")),
        direction=str(labels.get("direction", "")),
        labels=labels,
        scenario=scenario,
        status=str(result.get("status") or "unknown"),
        message=str(result.get("message") or ""),
        stable=bool(measured.get("stable", False)),
        success=bool(measured.get("success", False)),
        metrics=measured,
        timing_ms=_timing(result.get("timing") or {}, measured.get("steps_completed")),
        digest=str(result.get("digest") or ""),
        warnings=tuple(str(one) for one in result.get("warnings") or ()),
        steered_by=_arm(result),
    )


def _controller(block: Mapping[str, Any]) -> Any:
    return block.get("name") or block.get("kind", "unknown")


def _arm(result: Mapping[str, Any]) -> Arm | None:
    data = (result.get("provenance") or {}).get("arm")
    return None if data is None else Arm.of_data(data)


def _lateral(scenario: Mapping[str, Any], name: str) -> tuple[float, float]:
    point = scenario.get("trajectory", {}).get(name) or (math.nan, math.nan)
    return float(point[0]), float(point[1])


def _timing(timing: Mapping[str, Any], steps: int | None) -> dict[str, float | None]:
    medians: dict[str, float | None] = {name: (timing.get(name) or {}).get("median_ms") for name in TIMED}
    wall = timing.get("loop_wall_s")
    medians["mean_step"] = 1e3 * wall / steps if wall is not None and steps else None
    return medians


def beside(table: Iterable[Row]) -> dict[str, float]:
    """Median of each metric of BESIDE over the stable rows that have it; nan where none has."""
    kept = [row for row in table if row.stable]
    return {metric: _median(row.metrics.get(metric) for row in kept) for metric in BESIDE}


def _median(values: Iterable[Any]) -> float:
    known = [float(value) for value in values if value is not None and math.isfinite(value)]
    return statistics.median(known) if known else math.nan


def only(table: Iterable[Row], **wanted: str) -> list[Row]:
    """The rows whose fields have these values."""
    return [row for row in table if all(getattr(row, name) == value for name, value in wanted.items())]


def main_rows(table: Iterable[Row]) -> list[Row]:
    """The rows of the experiments themselves: no training data, no seeds, no sensitivity study, no timing pass."""
    return [
        row
        for row in table
        if row.group != TRAINING
        and row.labels.get("purpose", "main") == "main"
        and not any(name in row.labels for name in SPECIAL)
    ]


def in_order(names: Iterable[str], order: Sequence[str]) -> list[str]:
    """Unique names, the known ones first in their order; references stay last."""
    place = {name: i for i, name in enumerate(order)}
    unknown = len(order) - len(REFERENCES) - 0.5
    return sorted(set(names), key=lambda name: (place.get(name, unknown), name))


def arms(table: Iterable[Row]) -> list[str]:
    """Controllers that there are, the references last."""
    return in_order((row.arm for row in table), ARMS)


def arm_name(arm: str) -> str:
    """As people call it; what stands in brackets behind it, an edition or a campaign, is kept."""
    name, *behind = arm.split(" (", 1)
    return " (".join([ARM_NAMES.get(name, name), *behind])


def groups(table: Iterable[Row]) -> list[str]:
    """Groups that there are, LIN and CUR first."""
    names = {row.group for row in table} - {TRAINING}
    return [name for name in GROUPS if name in names] + sorted(names - set(GROUPS))


def by_group(table: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows by group; with two groups or more also all of them together."""
    members = {name: only(table, group=name) for name in groups(table)}
    if len(members) > 1:
        members[ALL] = [row for name in groups(table) for row in members[name]]
    return members


def insertions_csv(table: Sequence[Row]) -> str:
    """A header and a line for each row, full precision; what was not measured is empty."""
    labels = sorted({name for row in table for name in row.labels})
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    ends = ("status", "message", "stable", "success")
    steered = ("arm_id", "arm_version", "arm_code_sha256")
    counts = ("steps_completed", "steps")
    timed = [*(f"{name}_median_ms" for name in TIMED), "mean_step_ms"]
    places = ("entry_x_mm", "entry_y_mm", "end_x_mm", "end_y_mm")
    writer.writerow(
        ["id", *labels, "young_kpa", *places, *ends, *counts, *MEASURED, *timed, "digest", *steered, "warnings"]
    )
    for row in table:
        writer.writerow(
            [
                row.id,
                *(row.arm if name == "arm" else row.labels.get(name, "") for name in labels),
                _cell(row.scenario.get("tissue", {}).get("young_kpa")),
                *(_cell(value) for value in (*row.entry_mm, *row.end_mm)),
                *(row.status, row.message, _yes_no(row.stable), _yes_no(row.success)),
                *(_cell(row.metrics.get(name)) for name in (*counts, *MEASURED)),
                *(_cell(row.timing_ms[name]) for name in (*TIMED, "mean_step")),
                row.digest,
                *_steered(row.steered_by),
                "; ".join(row.warnings),
            ]
        )
    return text.getvalue()


def _steered(arm: Arm | None) -> tuple[str, str, str]:
    return ("", "", "") if arm is None else (arm.id, arm.version or "", arm.code_sha256 or "")


def _cell(value: Any) -> Any:
    """The value, empty where nothing was measured."""
    return "" if value is None or (isinstance(value, float) and not math.isfinite(value)) else value


def _yes_no(yes: bool) -> str:
    return "yes" if yes else "no"
