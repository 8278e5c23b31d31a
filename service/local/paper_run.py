"""An experiment in a folder, such as a rerun of the paper: worker processes, storage and training for its stages."""

from __future__ import annotations

import itertools
import os
import shutil
import tempfile
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from benchmarks.paper.plan import Stage, StagedPlan, StepCost, model_names, probes, steps
from benchmarks.paper.scale import BAND_FIELDS
from service.local.paper_folder import RECORDINGS, SERIES, PaperFolder, write_text
from service.worker.insertion_job import RECORDING_RUNNER
from service.worker.memory import available_mb
from service.worker.network_trainer import require_scikit_learn
from simcore.errors import NeedlebenchError, Problem, ScenarioError
from simcore.file_names import names_mean
from simcore.provenance import commit
from simcore.rollout.dataset import Dataset, Table, save_dataset, table_one

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from benchmarks.cases import Case, Outcome
    from benchmarks.paper.pipeline import PaperPorts
    from service.worker.crew import CaseRunner

WORKER_MB = 350  # that a worker holds, at least [ours]
SPARE = 1.2  # of the estimated disk space

Result = TypeVar("Result")


class NotReproducedError(NeedlebenchError):
    """A second run of the same scenario gave another digest."""


class CostProbeError(NeedlebenchError):
    """The two insertions that measure what a step costs did not succeed."""


class ProgressListener(Protocol):
    """Hears how far a run is."""

    def begin(self, stage: Stage) -> None:
        """A stage begins."""

    def ended(self, outcome: Outcome) -> None:
        """An insertion of it has ended, now or in an earlier run."""

    def say(self, text: str) -> None:
        """Something else happens."""


def identity(plan: StagedPlan) -> dict[str, Any]:
    """What makes a run the same run; the content of run.json."""
    scale = plan.scale.model_dump(mode="json", exclude=BAND_FIELDS)  # may be set after the run
    return {"schema": plan.schema, "scale": scale, "plan_sha256": plan.sha256, "commit": commit()}


def measured_cost(plan: StagedPlan, crew: CaseRunner) -> StepCost:
    """CPU seconds of a step, from three insertions at the plan's discretisation, each run twice: the first time loads
    the code as well. Raises CostProbeError."""
    least: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="needlebench-", dir=crew.scratch) as scratch:
        runs = (crew.run_many(probes(plan.scale), folder=Path(scratch)) for _ in range(2))
        for outcome in itertools.chain.from_iterable(runs):
            if "cost" not in outcome.result:
                raise CostProbeError(f"{outcome.case.id}: {outcome.result['message']}")
            step_s = outcome.result["cost"]["cpu_s"] / steps(outcome.case)
            least[outcome.case.id] = min(step_s, least.get(outcome.case.id, step_s))
    noise_s = max(0.0, least["probe-noise"] - least["probe-ifem"])
    return StepCost(ifem_s=least["probe-ifem"], plain_s=least["probe-plain"], noise_s=noise_s)


def check_needs(plan: StagedPlan, path: Path, workers: int) -> None:
    """Look at whatever the run will need before it begins: scikit-learn, a folder that can be written, space, memory
    of this machine for so many workers.

    Raises ScenarioError, MissingScikitLearnError.
    """
    learns_network = any(case.scenario.get("controller", {}).get("kind") == "mlp" for case in _cases(plan))
    if learns_network and not (path / model_names()["mlp"]).exists():
        require_scikit_learn()
    there = nearest_folder(path)
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise ScenarioError([Problem("--out", str(path), f"cannot be written: {there} is not writable for this user")])
    enough_space(plan, path)
    free_mb = available_mb()
    if free_mb is not None and free_mb < workers * WORKER_MB:
        needed = f"need about {workers * WORKER_MB} MB of memory, {free_mb:.0f} MB are available"
        raise ScenarioError([Problem("--workers", workers, needed)])


def _cases(plan: StagedPlan) -> Iterator[Case]:
    for stage in plan.stages:
        yield from stage.cases


def nearest_folder(path: Path) -> Path:
    """The folder itself, or the nearest one above it that exists."""
    there = path.absolute()
    while not there.exists():
        there = there.parent
    return there


def enough_space(plan: StagedPlan, path: Path) -> None:
    """Raises ScenarioError if there is less space than the plan needs where the folder is or will be."""
    there = nearest_folder(path)
    free = shutil.disk_usage(there).free
    if free < SPARE * plan.bytes:
        needed = f"needs about {plan.bytes / 1e6:.0f} MB and some to spare, {free / 1e6:.0f} MB are free"
        raise ScenarioError([Problem("--out", str(path), needed)])


@dataclass(frozen=True)
class PaperRun:
    """One run, or its continuation. train: (kind, seed, data) -> text of a model file."""

    folder: PaperFolder
    crew: CaseRunner
    listener: ProgressListener
    train: Callable[[str, int, Dataset], str]

    def run(self, stages: Callable[[PaperPorts], Result]) -> Result:
        """The result of the stages; what the folder already has is not run again."""
        root = self.folder.path
        with names_mean(lambda name: root / name):
            return stages(self)

    # ---- the ports of the stages (`PaperPorts`)

    def run_many(self, cases: Sequence[Case]) -> Iterator[Outcome]:
        """On all workers."""
        return self._run(cases, alone=False)

    def run_alone(self, cases: Sequence[Case]) -> Iterator[Outcome]:
        """One after the other."""
        return self._run(cases, alone=True)

    def _run(self, cases: Sequence[Case], *, alone: bool) -> Iterator[Outcome]:
        """Run what is not in the folder yet, and report everything to the listener."""

        def fresh(left: Sequence[Case]) -> Iterator[Outcome]:
            with closing(self.crew.run_many(left, alone=alone)) as outcomes:
                yield from outcomes

        for outcome in self.folder.cached(fresh)(cases):
            self.listener.ended(outcome)
            yield outcome

    def begin(self, stage: Stage) -> None:
        """Announce a stage."""
        self.listener.begin(stage)

    def table(self, case: Case) -> Table:
        """Table I, from the series in the folder."""
        with np.load(self.folder.path / SERIES / f"{case.id}.npz", allow_pickle=False) as file:
            return table_one(file)

    def keep(self, name: str, data: Dataset) -> None:
        """Save a data set."""
        save_dataset(data, self.folder.path / name)

    def store(self, name: str, text: str) -> None:
        """Write a file of the folder."""
        write_text(self.folder.path / name, text)

    def stored(self, name: str) -> bool:
        """Whether the folder has the file."""
        return (self.folder.path / name).exists()

    def record(self, outcomes: Sequence[Outcome]) -> dict[str, str]:
        """Recordings by case id, relative to the folder. Raises NotReproducedError for another digest."""
        names = {outcome.case.id: f"{RECORDINGS}/{outcome.case.id}.rrd" for outcome in outcomes}
        before = {outcome.case.id: outcome.result["digest"] for outcome in outcomes}
        missing = [outcome.case for outcome in outcomes if not (self.folder.path / names[outcome.case.id]).exists()]
        self.listener.say(f"recording {len(missing)} of {len(names)} chosen cases again")
        if not missing:
            return names
        drafts = self.folder.path / f".{RECORDINGS}"
        shutil.rmtree(drafts, ignore_errors=True)
        drafts.mkdir()
        with closing(self.crew.run_many(missing, runner=RECORDING_RUNNER, folder=drafts)) as done:
            for outcome in done:
                name, result = outcome.case.id, outcome.result
                if result["digest"] != before[name]:
                    raise NotReproducedError(f"{name}: its rerun has the digest {result['digest']}, not {before[name]}")
                if result.get("recording_warning"):
                    self.listener.say(f"warning: {name}: {result['recording_warning']}")
                    del names[name]
                    continue
                (drafts / f"{name}.rrd").replace(self.folder.path / names[name])
        shutil.rmtree(drafts, ignore_errors=True)
        return names
