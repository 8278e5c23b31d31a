"""What an experiment will do before it does it, the rerun of the paper first of all: its stages, how long they take,
how much they store."""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from benchmarks.cases import Case
from benchmarks.paper.scale import BAND_FIELDS
from benchmarks.paper.suites import (
    nominal_ifem_cases,
    paper_cases,
    seed_cases,
    sensitivity_cases,
    timing_cases,
    training_cases,
)
from benchmarks.paper.training_study import other_training_cases, quiet_cases, training_study_cases

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.paper.scale import ExperimentScale, Scale

SPEED_MM_S = 10.0
PERTURBATION_SOLVES = 18.0  # cost of a step whose Jacobian is perturbed, in plain steps; measured
SEPARATE_SOLVES = 2.5  # and of one whose controller steps a model of its own
STATE_BYTES, WHOLE_BYTES = 60.0, 300.0  # stored for one step of a test and of a training insertion; measured
CASE_BYTES, RECORDING_BYTES = 12_000.0, 15_000.0  # for one insertion, and for one recorded step; measured
RECORDED_ARMS = 4  # I-FEM and ELM along LIN and CUR: best, median and worst of each


@dataclass(frozen=True)
class StepCost:
    """Measured at the scale's discretisation: CPU seconds of a step that steers by I-FEM and of one that does not, and
    what target noise adds, since a needle that jerks takes more iterations."""

    ifem_s: float
    plain_s: float
    noise_s: float = 0.0

    def of(self, case: Case) -> float:
        """Estimated CPU seconds of an insertion."""
        block = case.scenario["controller"]
        if block.get("jacobian") == "perturbation":
            each = self.plain_s * PERTURBATION_SOLVES
        elif block["kind"] == "ifem" and block.get("model", {}).get("kind", "shared") == "separate":
            each = self.ifem_s * SEPARATE_SOLVES
        else:
            each = self.ifem_s if block["kind"] == "ifem" else self.plain_s
        noise_s = self.noise_s if case.scenario.get("noise_mm") else 0.0
        return (each + noise_s) * steps(case)


@dataclass(frozen=True)
class Stage:
    """Some insertions that are run together; `alone`: one after the other, for their times; `trains`: ELMs are trained
    on them before the next stage."""

    title: str
    cases: tuple[Case, ...]
    alone: bool = False
    trains: bool = False


class StagedPlan(ABC):
    """All stages of an experiment's scale. The cases are drafts: the models that they name are trained on the way."""

    schema: ClassVar[str]  # of the run.json of its folder
    scale: ExperimentScale
    recorded = 0  # insertions that are run again for a recording

    @cached_property
    @abstractmethod
    def stages(self) -> tuple[Stage, ...]:
        """In the order in which they are run."""

    @property
    def insertions(self) -> int:
        """How many there are in all stages."""
        return sum(len(stage.cases) for stage in self.stages)

    @cached_property
    def sha256(self) -> str:
        """Digest of the scale and of every draft: two runs with the same one do the same."""
        drafts = [[case.id, case.labels, case.scenario] for stage in self.stages for case in stage.cases]
        content = json.dumps(
            [self.scale.model_dump(mode="json", exclude=BAND_FIELDS), drafts], sort_keys=True, separators=(",", ":")
        )
        return hashlib.sha256(content.encode()).hexdigest()

    def seconds(self, cost: StepCost, workers: int) -> dict[str, float]:
        """Estimated wall time of each stage on cores of their own, by title."""
        return {stage.title: sum(map(cost.of, stage.cases)) / (1 if stage.alone else workers) for stage in self.stages}

    @property
    def bytes(self) -> int:
        """Estimated size of the folder."""
        total = 0.0
        for stage in self.stages:
            each = WHOLE_BYTES if stage.trains else STATE_BYTES
            total += sum(CASE_BYTES + each * steps(case) for case in stage.cases)
        longest = max(steps(case) for case in self.stages[0].cases)
        return math.ceil(total + self.recorded * longest * RECORDING_BYTES)


@dataclass(frozen=True)
class Plan(StagedPlan):
    """The rerun of the paper."""

    schema: ClassVar[str] = "needlebench/paper-run/1"
    scale: Scale

    @property
    def recorded(self) -> int:  # type: ignore[override]
        """Best, median and worst of the chosen arms, and the failures that the scale asks for."""
        return 3 * RECORDED_ARMS + self.scale.recordings

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """In the order in which they are run."""
        scale = self.scale
        stages = (
            Stage("data set", tuple(training_cases(scale)), trains=True),
            Stage("other data sets", tuple(other_training_cases(scale)), trains=True),
            Stage("experiments", experiments(scale)),
            Stage("ELM seeds", tuple(seed_cases(scale, elm_names(scale)))),
            Stage("sensitivity", (*sensitivity_cases(scale, model_names()), *training_study_cases(scale))),
            Stage("timing", tuple(timing_cases(scale, model_names())), alone=True),
        )
        return tuple(stage for stage in stages if stage.cases)


def experiments(scale: Scale) -> tuple[Case, ...]:
    """LIN, CUR and variable Young's modulus, there with I-FEM as well, and the ELM that was trained without noise."""
    return (*paper_cases(scale, model_names()), *nominal_ifem_cases(scale), *quiet_cases(scale))


def elm_names(scale: Scale) -> list[str]:
    """Files of the ELMs, one for each seed; the first is the one of the experiments."""
    return [f"models/elm-{seed:02}.json" for seed in range(scale.seeds)]


def model_names() -> dict[str, str]:
    """Files of the models that the experiments use, by kind."""
    return {"elm": "models/elm-00.json", **{kind: f"models/{kind}.json" for kind in ("linear", "neighbours", "mlp")}}


def steps(case: Case) -> int:
    """Number of steps of an insertion, by its chord: a sine of 1 mm adds a thousandth."""
    trajectory: dict[str, Any] = case.scenario["trajectory"]
    length = math.dist(trajectory["entry_mm"], trajectory["target_mm"])
    return math.ceil(length / (SPEED_MM_S * float(case.scenario["dt_s"])))


def probes(scale: ExperimentScale) -> Sequence[Case]:
    """Three insertions whose CPU time tells what the others will cost: with I-FEM, with target noise besides, and
    without a controller."""
    noisy = training_cases(scale)[0].scenario
    quiet = {**noisy, "noise_mm": 0.0}
    plain = {**quiet, "controller": {"kind": "open_loop"}}
    return [Case("probe-ifem", quiet, {}), Case("probe-noise", noisy, {}), Case("probe-plain", plain, {})]
