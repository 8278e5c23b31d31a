"""ELMs trained under other conditions: how long target noise is held, how fast the robot may be, and without noise.

With noise of +-0.25 mm that is redrawn every step, the targets ask for more than the robot's speed in most steps: what
is learned then is largely how the limits answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.cases import Case
from benchmarks.learning.training_insertions import training_insertions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.paper.scale import Scale
    from benchmarks.paper.table import Row

HOLDS_S = (0.01, 0.05, 0.1)  # the first is the nominal one
SPEEDS_MM_S = (50.0, 100.0)  # likewise
PARAMETER, LABEL = "training", "training"
WITHOUT_NOISE = "quiet"


@dataclass(frozen=True)
class TrainingCondition:
    """Fields of the training insertions that differ from the nominal ones, and whether the test's robot does."""

    name: str  # in file names
    value: str  # for people
    changes: tuple[tuple[str, Any], ...]
    robot: tuple[tuple[str, Any], ...] = ()

    @property
    def model(self) -> str:
        """File of its ELM."""
        return f"models/elm-{self.name}.json"


def training_conditions(dt_s: float) -> list[TrainingCondition]:
    """Every hold time with every speed limit but the nominal pair, then no noise at all. Hold times are whole steps of
    dt_s; those that are the same number of steps are one."""
    steps = list(dict.fromkeys(max(1, round(hold_s / dt_s)) for hold_s in HOLDS_S))
    conditions = []
    for speed in SPEEDS_MM_S:
        for count in steps:
            if (count, speed) == (steps[0], SPEEDS_MM_S[0]):
                continue
            hold_ms = 1e3 * count * dt_s
            robot = (("max_speed_mm_s", speed),) if speed != SPEEDS_MM_S[0] else ()
            changes: tuple[tuple[str, Any], ...] = (("noise_hold_s", round(count * dt_s, 9)),)
            changes += (("robot", dict(robot)),) if robot else ()
            value = f"hold {hold_ms:g} ms, limit {speed:g} mm/s"
            conditions.append(TrainingCondition(f"hold-{hold_ms:g}-limit-{speed:g}", value, changes, robot))
    return [*conditions, TrainingCondition(WITHOUT_NOISE, "no target noise", (("noise_mm", 0.0),))]


def retraining_cases(scale: Scale, shared: dict[str, Any]) -> list[Case]:
    """The insertions of every condition's data set; none at a scale without retraining. shared: discretisation."""
    if not scale.retraining:
        return []
    cases = []
    for condition in training_conditions(scale.dt_s):
        changes = {**shared, **dict(condition.changes)}
        for case in training_insertions(insertions=scale.retraining, seed=0, changes=changes):
            labels = {**case.labels, LABEL: condition.name, "noise": "on" if case.scenario["noise_mm"] else "off"}
            cases.append(Case(f"{case.id}-{condition.name}", case.scenario, labels))
    return cases


@dataclass(frozen=True)
class TrainingScore:
    """The insertions of one data set. saturated: share of their steps in which the robot's speed limits acted."""

    condition: str
    insertions: int
    failed: int
    steps: int
    noise_mm: float
    hold_ms: float
    speed_mm_s: float
    saturated: float | None


def training_scores(training: Sequence[Row]) -> list[TrainingScore]:
    """One for each data set, the nominal one first. training: rows of training insertions."""
    names = dict.fromkeys(str(row.labels.get(LABEL, "")) for row in training)
    rows_by_name = {name: [row for row in training if str(row.labels.get(LABEL, "")) == name] for name in sorted(names)}
    return [_score(name or "nominal", rows) for name, rows in rows_by_name.items()]


def _score(name: str, rows: Sequence[Row]) -> TrainingScore:
    scenario = rows[0].scenario
    dt_s = scenario.get("dt_s", 0.01)
    hold_s = scenario.get("noise_hold_s") or max(HOLDS_S[0], dt_s)
    known = [(int(row.metrics.get("steps_completed") or 0), row.metrics.get("limited_fraction")) for row in rows]
    steps = sum(count for count, share in known if share is not None)
    acted = sum(count * share for count, share in known if share is not None)
    return TrainingScore(
        condition=name,
        insertions=len(rows),
        failed=sum(row.failed for row in rows),
        steps=sum(count for count, _ in known),
        noise_mm=scenario.get("noise_mm", 0.0),
        hold_ms=1e3 * hold_s,
        speed_mm_s=scenario.get("robot", {}).get("max_speed_mm_s", SPEEDS_MM_S[0]),
        saturated=acted / steps if steps else None,
    )
