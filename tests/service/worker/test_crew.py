"""Many cases on worker processes: results as they end, deaths survived, nothing left behind."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import pytest

from benchmarks.cases import Case, Outcome
from service.worker.crew import CRASHED, Crew, CrewStartError
from simcore.metrics import MEASURED
from tests.acceptance.server import alive, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

RUNNER = "tests.service.many_runner:insertion"
linux = pytest.mark.skipif(sys.platform != "linux", reason="kills by signal")


def cases(*names: str) -> list[Case]:
    return [Case(f"{i}-{name}", {"name": name}, {"group": "LIN"}) for i, name in enumerate(names)]


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Crew, Path]]:
    folder = tmp_path_factory.mktemp("crew")
    with Crew(2, folder=folder, files=folder, runner=RUNNER) as crew:
        yield crew, folder


def by_name(outcomes: list[Outcome]) -> dict[str, Outcome]:
    return {outcome.case.id.partition("-")[2]: outcome for outcome in outcomes}


@pytest.mark.slow
@linux
def test_every_case_has_an_outcome_whatever_becomes_of_it(shared: tuple[Crew, Path], tmp_path: Path) -> None:
    crew, _ = shared
    wanted = cases("ok", "dies", "raises", "dies-once", "ok")
    outcomes = list(crew.run_many(wanted, folder=tmp_path))
    assert sorted(outcome.case.id for outcome in outcomes) == sorted(case.id for case in wanted)
    found = by_name(outcomes)
    assert found["ok"].result["cost"]["attempts"] == 1
    assert found["dies-once"].result["status"] == "completed"
    assert found["dies-once"].result["cost"]["attempts"] == 2
    assert (tmp_path / "1-dies.attempts").read_text() == "3"
    assert found["dies"].result["status"] == found["raises"].result["status"] == CRASHED
    assert "signal 9" in found["dies"].result["message"]
    assert "ValueError: no good" in found["raises"].result["message"]


@pytest.mark.slow
@linux
def test_a_crash_has_the_shape_of_a_result(shared: tuple[Crew, Path], tmp_path: Path) -> None:
    (outcome,) = shared[0].run_many(cases("raises"), folder=tmp_path)
    metrics = outcome.result["metrics"]
    assert not metrics["stable"]
    assert not metrics["success"]
    assert all(metrics[name] is None for name in MEASURED)
    assert outcome.result["provenance"]["scenario"] == outcome.case.scenario


@pytest.mark.slow
@linux
def test_closing_early_ends_the_work_and_the_crew_goes_on(shared: tuple[Crew, Path], tmp_path: Path) -> None:
    crew, _ = shared
    running = crew.run_many(cases("ok", "sleeps", "sleeps"), folder=tmp_path)
    assert next(running).result["status"] == "completed"
    began = time.monotonic()
    running.close()
    assert time.monotonic() - began < 30.0
    (outcome,) = crew.run_many(cases("ok"), folder=tmp_path / "again")
    assert outcome.result["status"] == "completed"


def test_alone_is_one_process(shared: tuple[Crew, Path], tmp_path: Path) -> None:
    outcomes = list(shared[0].run_many(cases("ok", "ok", "ok"), alone=True, folder=tmp_path))
    assert [outcome.case.id for outcome in outcomes] == ["0-ok", "1-ok", "2-ok"]
    assert len({outcome.result["pid"] for outcome in outcomes}) == 1


@pytest.mark.slow
@linux
def test_nobody_is_left_behind(tmp_path: Path) -> None:
    with Crew(1, folder=tmp_path, files=tmp_path, runner=RUNNER) as crew:
        (outcome,) = crew.run_many(cases("ok"))
        pid = outcome.result["pid"]
        assert alive(pid)
    until(lambda: not alive(pid))


@pytest.mark.slow
@linux
def test_batches_are_done_one_by_each_worker_with_one_attempt_a_case(tmp_path: Path) -> None:
    with Crew(2, folder=tmp_path, files=tmp_path, runner=RUNNER) as crew:
        crew.start()
        first, second = cases("ok", "ok"), [Case("2-dies-once", {"name": "dies-once"}, {})]
        outcomes = {outcome.case.id: outcome.result for outcome in crew.run_batches([first, second])}
        assert outcomes["0-ok"]["pid"] == outcomes["1-ok"]["pid"]
        assert outcomes["2-dies-once"]["status"] == CRASHED
        assert "signal 9, attempt 1" in outcomes["2-dies-once"]["message"].replace("(", "").replace(")", "")
        assert (tmp_path / "0-ok" / "0-ok.attempts").read_text() == "1"
        with pytest.raises(ValueError, match="1 batches for 2 workers"):
            crew.run_batches([first])


@pytest.mark.slow
@linux
def test_a_crew_whose_workers_never_get_ready_says_so(tmp_path: Path) -> None:
    with (
        Crew(1, folder=tmp_path, files=tmp_path, runner="tests.service.dead_runner:insertion") as crew,
        pytest.raises(CrewStartError, match="could not be started in 3 attempts: its worker process died"),
    ):
        crew.start()


def test_no_cases_start_no_process(tmp_path: Path) -> None:
    with Crew(1, folder=tmp_path, files=tmp_path, runner="no.such.module:runner") as crew:
        assert list(crew.run_many([])) == []


def test_a_crew_needs_a_worker(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="workers = 0: must be at least 1"):
        Crew(0, folder=tmp_path, files=tmp_path)
