"""What the ELMs of other training conditions are run on: paths of the sensitivity study, and tests of over-fitting."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.cases import Case
from benchmarks.paper.retraining import PARAMETER, WITHOUT_NOISE, retraining_cases, training_conditions
from benchmarks.paper.suites import (
    STEERED,
    case_labels,
    controller,
    curved_paths,
    discretisation,
    pairs,
    scenario,
    straight_paths,
)
from benchmarks.paper.table import QUIET_ARM

if TYPE_CHECKING:
    from benchmarks.paper.scale import Scale


def other_training_cases(scale: Scale) -> list[Case]:
    """The data sets of the training study: hold times, speed limits, no noise."""
    return retraining_cases(scale, discretisation(scale))


def training_study_cases(scale: Scale) -> list[Case]:
    """The ELM of each training condition along the paths of the sensitivity study, with the robot of its training;
    where that is another than the nominal one, I-FEM and the open loop with it too."""
    paths = [*straight_paths(scale.sensitivity_lin), *curved_paths(scale.sensitivity_cur, 1)]
    cases = []
    for condition in training_conditions(scale.dt_s) if scale.retraining else ():
        arms = (*STEERED, "open_loop") if condition.robot else ("elm",)
        for path, arm in pairs(paths, arms):
            name = f"sens-{PARAMETER}-{condition.name}-{path.name}-{arm}"
            block = controller(arm, scale, {"elm": condition.model})
            data = scenario(name, scale, seed=0, trajectory=path.trajectory(), controller=block)
            data |= {"robot": dict(condition.robot)} if condition.robot else {}
            more = {"parameter": PARAMETER, "value": condition.value}
            cases.append(Case(name, data, case_labels(path, arm, "sensitivity", **more)))
    return cases


def quiet_cases(scale: Scale) -> list[Case]:
    """The ELM that was trained without target noise, as an arm of its own: LIN, and CUR along one direction each."""
    if not scale.retraining:
        return []
    (condition,) = (c for c in training_conditions(scale.dt_s) if c.name == WITHOUT_NOISE)
    cases = []
    for path in [*straight_paths(scale.quiet), *curved_paths(scale.quiet, 1)]:
        name, block = f"{path.name}-{QUIET_ARM}", controller("elm", scale, {"elm": condition.model})
        data = scenario(name, scale, seed=0, trajectory=path.trajectory(), controller=block)
        cases.append(Case(name, data, case_labels(path, QUIET_ARM, "main")))
    return cases
