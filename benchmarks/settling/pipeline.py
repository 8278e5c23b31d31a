"""The settling experiment from data sets to outcomes; whatever runs, stores or trains is handed in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchmarks.learning.training import TRAINED_ON
from benchmarks.paper.pipeline import PaperPorts, gather_dataset, run_stage
from benchmarks.paper.suites import resolve_cases
from benchmarks.settling.plan import data_cases, data_title
from benchmarks.settling.plants import PLANTS, Plant
from simcore.errors import Problem, ScenarioError
from simcore.learning import load_model, model_digest

if TYPE_CHECKING:
    from benchmarks.cases import Outcome
    from benchmarks.settling.plan import SettlingPlan
    from benchmarks.settling.scale import SettlingScale

ELM_SEED = 0


def settle(plan: SettlingPlan, ports: PaperPorts) -> list[Outcome]:
    """Run every stage of the plan; the outcomes of all insertions, in its order.

    Raises ScenarioError where a named model was trained on another plant, EmptyDatasetError.
    """
    scale, outcomes, stages = plan.scale, list[Any](), {stage.title: stage for stage in plan.stages}
    for plant in PLANTS:
        if scale.named_model(plant) is not None:
            check_model(scale, plant)
            continue
        done = run_stage(stages[data_title(plant)], ports, stages[data_title(plant)].cases)
        outcomes += done
        if not ports.stored(scale.model_of(plant)):
            data = gather_dataset(plan, done, ports.table)
            ports.keep(f"dataset-{plant.name}.npz", data)
            ports.store(scale.model_of(plant), ports.train("elm", ELM_SEED, data))
    return outcomes + run_stage(stages["cells"], ports, resolve_cases(stages["cells"].cases))


def check_model(scale: SettlingScale, plant: Plant) -> None:
    """Raises ScenarioError for a model that was not trained on this plant at this discretisation."""
    name, wanted = scale.model_of(plant), data_cases(scale, plant)[0].scenario
    trained = load_model("elm", name, model_digest("elm", name, None)).provenance.get("trained_on") or {}
    problems = []
    for block in TRAINED_ON:
        here, there = _fields(block, wanted[block]), _fields(block, trained.get(block))
        problems += [
            Problem(f"{plant.name}_model", name, f"was trained at {field} = {there.get(field)}, this plant has {value}")
            for field, value in here.items()
            if there.get(field) != value
        ]
    if problems:
        raise ScenarioError(problems)


def _fields(name: str, block: Any) -> dict[str, Any]:
    """The fields of a scenario's block, or what is no block itself, by dotted name."""
    return {f"{name}.{field}": value for field, value in block.items()} if isinstance(block, dict) else {name: block}
