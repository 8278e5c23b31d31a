"""`needlebench settle`: goes on where it stopped, refuses what it must, and runs in a coarse block."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.cases import Case, Outcome
from benchmarks.settling.pipeline import settle
from benchmarks.settling.plan import SettlingPlan, data_cases
from benchmarks.settling.plants import PLANTS, Plant
from benchmarks.settling.report import write
from benchmarks.settling.scale import SettlingScale
from service.cli.main import main
from service.local.paper_folder import open_folder
from service.local.paper_run import PaperRun, identity
from simcore.errors import ScenarioError
from simcore.learning import ExtremeLearningMachine, TrainedModel

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from benchmarks.paper.plan import Stage
    from service.worker.crew import Crew
    from simcore.rollout.dataset import Dataset

pytestmark = pytest.mark.slow

TINY = {"element_size_mm": 20.0, "dt_s": 0.05, "training": 3, "samples": 300, "end_points": 1, "directions": 1}


class FakeCrew:
    """Answers at once; stops after `patience` insertions."""

    def __init__(self, patience: int) -> None:
        self.patience, self.ran = patience, list[str]()

    def run_many(self, cases: Sequence[Case], *, alone: bool = False) -> Iterator[Outcome]:
        assert not alone
        for case in cases:
            if len(self.ran) == self.patience:
                raise KeyboardInterrupt
            self.ran.append(case.id)
            metrics = {"stable": True, "success": True, "rmse_commanded_mm": 0.1, "rcm_max_mm": 0.5}
            yield Outcome(case, {"status": "completed", "metrics": metrics, "provenance": {"scenario": case.scenario}})


class Silent:
    def begin(self, stage: Stage) -> None: ...
    def ended(self, outcome: Outcome) -> None: ...
    def say(self, text: str) -> None: ...


def no_training(kind: str, seed: int, data: Dataset) -> str:
    raise AssertionError((kind, seed, data))


def model_file(folder: Path, scale: SettlingScale, plant: Plant, **changes: Any) -> str:
    """An ELM that says it was trained on this plant."""
    rng = np.random.default_rng(1)
    machine = ExtremeLearningMachine(nodes=5, seed=0)
    machine.fit(rng.normal(size=(40, 6)), rng.normal(size=(40, 3)))
    trained = {**data_cases(scale, plant)[0].scenario, **changes}
    path = folder / f"{plant.name}.json"
    path.write_text(TrainedModel(machine, {"trained_on": trained}).text())
    return str(path)


def plan_with_models(folder: Path) -> SettlingPlan:
    plain = SettlingScale(name="tiny", **TINY)
    models = {f"{plant.name}_model": model_file(folder, plain, plant) for plant in PLANTS}
    return SettlingPlan(SettlingScale(name="tiny", **TINY, **models))


def run(plan: SettlingPlan, path: Path, crew: Any) -> list[Outcome]:
    made: Crew = crew
    with open_folder(path, identity(plan), extend=None) as folder:
        return PaperRun(folder, made, Silent(), no_training).run(lambda ports: settle(plan, ports))


def test_it_goes_on_where_it_stopped(tmp_path: Path) -> None:
    plan, folder = plan_with_models(tmp_path), tmp_path / "run"
    first, second, third = FakeCrew(7), FakeCrew(100), FakeCrew(0)
    with pytest.raises(KeyboardInterrupt):
        run(plan, folder, first)
    outcomes = run(plan, folder, second)
    ids = [case.id for case in plan.stages[-1].cases]
    assert len(first.ran) == 7
    assert [*first.ran, *second.ran] == ids
    assert [outcome.case.id for outcome in outcomes] == ids
    assert [o.result for o in run(plan, folder, third)] == [o.result for o in outcomes]
    assert write(outcomes, plan.scale, folder, {}).name == "settling.html"


def test_another_plan_in_the_same_folder_is_refused_and_no_path_can_be_added(tmp_path: Path) -> None:
    plan = SettlingPlan(SettlingScale(name="tiny", **TINY))
    with open_folder(tmp_path / "run", identity(plan), extend=None):
        pass
    larger = SettlingPlan(SettlingScale(name="tiny", **{**TINY, "end_points": 2}))
    with pytest.raises(ScenarioError, match=r"scale differs\); choose another folder$"):
        open_folder(tmp_path / "run", identity(larger), extend=None).__enter__()


def test_a_model_of_another_plant_is_refused(tmp_path: Path) -> None:
    plain = SettlingScale(name="tiny", **TINY)
    wrong = model_file(tmp_path, plain, PLANTS[0], solver={"mode": "linearised"})
    plan = SettlingPlan(SettlingScale(name="tiny", **TINY, converged_model=wrong))
    with pytest.raises(ScenarioError, match=r"converged_model = .*solver.mode = linearised, this plant has converged"):
        run(plan, tmp_path / "run", FakeCrew(0))


def test_a_scale_that_is_none_is_refused_and_a_printed_one_can_be_read(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["settle", "--scale", "quick", "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert "is neither a file nor one of smoke, full" in done.stderr
    assert not list(tmp_path.iterdir())
    printed = CliRunner().invoke(main, ["settle", "--scale", "full", "--fields"])
    assert SettlingScale.model_validate_json(printed.stdout) == SettlingScale(name="full")


@pytest.mark.slow
def test_a_tiny_experiment_from_data_sets_to_page(tmp_path: Path) -> None:
    scale, folder = tmp_path / "tiny.json", tmp_path / "run"
    scale.write_text(json.dumps({"name": "tiny", **TINY}))
    words = ["settle", "--scale", str(scale), "--out", str(folder), "--any-commit"]
    done = CliRunner().invoke(main, words, catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    report = json.loads((folder / "settling.json").read_text())
    assert report["counts"]["insertions"] == 20
    assert report["counts"]["training"] == 6
    assert {one["claim"]["verdict"] for one in report["planned"]} == {"undecided"}
    assert {path.name for path in (folder / "models").iterdir()} == {"elm-converged.json", "elm-linearised.json"}
    for plant in PLANTS:
        origin = json.loads((folder / "models" / f"elm-{plant.name}.json").read_text())["provenance"]["trained_on"]
        assert origin["solver"]["mode"] == plant.mode
        assert origin["tissue"]["density_kg_m3"] == plant.density_kg_m3
