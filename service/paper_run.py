"""A rerun of the paper in a folder: the plan's stages, with worker processes, storage and training handed to them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from benchmarks.paper import paper
from benchmarks.paper.plan import Cost, Plan, Stage, probes, steps
from benchmarks.paper.records import Case, Outcome, RunMany
from service.paper_folder import RECORDINGS, SCHEMA, SERIES, PaperFolder, write_text
from service.run_many import INSERTION, RECORDING, Crew
from simcore.dataset import Dataset, Table, table_one
from simcore.errors import NeedlebenchError, Problem, ScenarioError
from simcore.files import names_mean
from simcore.provenance import commit

SPARE = 1.2  # of the estimated disk space


class NotReproduced(NeedlebenchError):
    """A second run of the same scenario gave another digest."""


class NoCost(NeedlebenchError):
    """The two insertions that are to tell what a step costs did not work."""


class Watcher(Protocol):
    """Who is told how far it is."""

    def begin(self, stage: Stage) -> None:
        """A stage begins."""

    def ended(self, outcome: Outcome, *, fresh: bool) -> None:
        """An insertion of it is there; `fresh`: it was run now."""

    def say(self, text: str) -> None:
        """Something else happens."""


def identity(plan: Plan) -> dict[str, Any]:
    """What makes a run the same run; the content of run.json."""
    scale = plan.scale.model_dump(mode="json")
    return {"schema": SCHEMA, "scale": scale, "plan_sha256": plan.sha256, "commit": commit()}


def measured_cost(plan: Plan, runner: str = INSERTION) -> Cost:
    """CPU seconds of a step, from two insertions at the plan's discretisation. Raises NoCost."""
    with tempfile.TemporaryDirectory(prefix="needlebench-") as scratch:
        folder = Path(scratch)
        with Crew(1, folder=folder, files=folder, runner=runner) as crew:
            done = {outcome.case.id: outcome for outcome in crew.run_many(probes(plan.scale))}
    each = {}
    for name, outcome in done.items():
        if "cost" not in outcome.result:
            raise NoCost(f"{name}: {outcome.result['message']}")
        each[name] = outcome.result["cost"]["cpu_s"] / steps(outcome.case)
    return Cost(ifem_s=each["probe-ifem"], plain_s=each["probe-plain"])


def enough_space(plan: Plan, path: Path) -> int:
    """Free bytes where the folder is or will be. Raises ScenarioError if the plan needs more."""
    there = path.absolute()
    while not there.exists():
        there = there.parent
    free = shutil.disk_usage(there).free
    if free < SPARE * plan.bytes:
        needed = f"needs about {plan.bytes / 1e6:.0f} MB and some to spare, {free / 1e6:.0f} MB are free"
        raise ScenarioError([Problem("--out", str(path), needed)])
    return free


@dataclass(frozen=True)
class PaperRun:
    """One run, or its continuation. train: (kind, seed, data) -> text of a model file."""

    plan: Plan
    folder: PaperFolder
    workers: int
    watcher: Watcher
    train: Callable[[str, int, Dataset], str]
    runner: str = INSERTION
    recorder: str = RECORDING

    def run(self) -> paper.Findings:
        """Every stage; what the folder already has is not run again."""
        root = self.folder.path
        with names_mean(lambda name: root / name):
            return paper.rerun(self.plan, self._hands())

    def _hands(self) -> paper.Hands:
        return paper.Hands(
            run_many=self._on(self.workers),
            run_alone=self._on(1),
            begin=self.watcher.begin,
            table=self._table,
            train=self.train,
            store=lambda name, text: write_text(self.folder.path / name, text),
            record=self._record,
        )

    def _on(self, workers: int) -> RunMany:
        """`run_many` over worker processes, started only if something is left to run."""

        new: set[str] = set()

        def fresh(cases: Sequence[Case]) -> Iterator[Outcome]:
            new.update(case.id for case in cases)
            if not cases:
                return
            crew = Crew(min(workers, len(cases)), folder=self.folder.series, files=self.folder.path, runner=self.runner)
            with crew, closing(crew.run_many(cases)) as outcomes:
                yield from outcomes

        def run(cases: Sequence[Case]) -> Iterator[Outcome]:
            for outcome in self.folder.remembering(fresh)(cases):
                self.watcher.ended(outcome, fresh=outcome.case.id in new)
                yield outcome

        return run

    def _table(self, case: Case) -> Table:
        with np.load(self.folder.path / SERIES / f"{case.id}.npz", allow_pickle=False) as file:
            return table_one(file)

    def _record(self, outcomes: Sequence[Outcome]) -> dict[str, str]:
        """Recordings by case id, relative to the folder. Raises NotReproduced for a digest that is not the first."""
        names = {outcome.case.id: f"{RECORDINGS}/{outcome.case.id}.rrd" for outcome in outcomes}
        before = {outcome.case.id: outcome.result["digest"] for outcome in outcomes}
        missing = [outcome.case for outcome in outcomes if not (self.folder.path / names[outcome.case.id]).exists()]
        self.watcher.say(f"recording {len(missing)} of {len(names)} chosen cases again")
        if not missing:
            return names
        drafts = self.folder.path / f".{RECORDINGS}"
        shutil.rmtree(drafts, ignore_errors=True)
        drafts.mkdir()
        crew = Crew(min(self.workers, len(missing)), folder=drafts, files=self.folder.path, runner=self.recorder)
        with crew, closing(crew.run_many(missing)) as done:
            for outcome in done:
                name, result = outcome.case.id, outcome.result
                if result["digest"] != before[name]:
                    raise NotReproduced(f"{name}: its rerun has the digest {result['digest']}, not {before[name]}")
                if result.get("recording_warning"):
                    self.watcher.say(f"warning: {name}: {result['recording_warning']}")
                    del names[name]
                    continue
                (drafts / f"{name}.rrd").replace(self.folder.path / names[name])
        shutil.rmtree(drafts, ignore_errors=True)
        return names
