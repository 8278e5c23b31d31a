"""What the benchmarks are handed: a recorder, and worker processes as the service has them."""

from __future__ import annotations

import contextlib
import shutil
import time
import uuid
from typing import TYPE_CHECKING, Any

from simcore.errors import NeedlebenchError, Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from benchmarks.cases import Case, Outcome
    from benchmarks.observed_run import ObservedRun
    from benchmarks.ports import ClusterCost
    from service.recording.observer import RerunObserver
    from service.worker.crew import Crew
    from simcore.scenario.scenario import Scenario


def recorder(path: Path) -> RerunObserver:
    """A recorder with an identity of its own."""
    from service.recording.observer import RerunObserver

    return RerunObserver(path, recording_id=uuid.uuid4().hex)


class JobFailedError(NeedlebenchError):
    """A job of a benchmark crashed in its worker."""


@contextlib.contextmanager
def bench_crew(workers: int, scratch: Path, say: Callable[[str], None]) -> Iterator[BenchCrew]:
    """Warm workers, gone at the end."""
    from service.settings import RUNNER
    from service.worker.crew import Crew

    with Crew(workers, folder=scratch, files=scratch, runner=RUNNER) as crew:
        crew.start()
        yield BenchCrew(crew, scratch, say)


class BenchCrew:
    """Worker processes as the service has them; see `benchmarks.ports.Crew`."""

    def __init__(self, crew: Crew, scratch: Path, say: Callable[[str], None]) -> None:
        self._crew, self._scratch, self._say = crew, scratch, say

    def seconds(self, batches: Sequence[Sequence[Scenario]]) -> float:
        """Wall time of the batches, one on each worker, all at once; the jobs are recorded as the scenario says."""
        cases = [[_case(scenario) for scenario in batch] for batch in batches]
        started = time.perf_counter()
        outcomes = self._crew.run_batches(cases)
        elapsed = time.perf_counter() - started
        for outcome in outcomes:
            self._remove(outcome)
        return elapsed

    def run_many(self, scenarios: Sequence[Scenario]) -> list[ObservedRun]:
        """Each worker takes the next scenario that nobody has."""
        from benchmarks.observed_run import JOB, load

        cases = [_case(scenario) for scenario in scenarios]
        results: dict[str, ObservedRun] = {}
        for outcome in self._crew.run_many(cases, runner=JOB, own_folders=True):
            self._say(f"{len(results) + 1} of {len(cases)} runs done: {outcome.case.scenario['name']}")
            result = {name: value for name, value in _checked(outcome).items() if name != "cost"}
            results[outcome.case.id] = load(self._scratch / outcome.case.id, result)
            self._remove(outcome)
        return [results[case.id] for case in cases]

    def _remove(self, outcome: Outcome) -> None:
        _checked(outcome)
        shutil.rmtree(self._scratch / outcome.case.id, ignore_errors=True)


def _case(scenario: Scenario) -> Case:
    from benchmarks.cases import Case

    return Case(uuid.uuid4().hex, scenario.resolved(), {})


def _checked(outcome: Outcome) -> dict[str, Any]:
    """The result. Raises JobFailedError for a job that crashed."""
    from service.worker.crew import CRASHED

    if outcome.result["status"] == CRASHED:
        raise JobFailedError(outcome.result["message"])
    return outcome.result


def cluster_cost(tasks: int, workers: int, folder: Path) -> ClusterCost:
    """What tasks of 5 ms cost on a cluster of this machine. Raises ScenarioError without Dask."""
    try:
        from service.cluster.overhead import measure
    except ModuleNotFoundError:
        problem = "needs Dask: pip install 'needlebench[cluster]'"
        raise ScenarioError([Problem("NAME", "cluster", problem)]) from None
    return measure(tasks, workers, folder)
