"""Many cases on a cluster of real processes: workers and scheduler die, and every case has one outcome."""

from __future__ import annotations

import json
import random
import sys
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING

import pytest

from benchmarks.cases import Case
from service.cluster import crew as crew_module
from service.cluster.address import ClusterAddress
from service.cluster.connection import NoSchedulerError
from service.cluster.crew import ClusterCrew
from service.cluster.shared_store import FOLDER
from service.cluster.sign_on import RefusedError
from service.cluster.task import NotSharedError
from service.worker.crew import CRASHED
from tests.acceptance.server import until
from tests.budget import LONG
from tests.service.cluster.local_cluster import LocalCluster, local_cluster
from tests.service.cluster.worker_main import RUNNER

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from benchmarks.cases import Outcome

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="kills by signal"),
]
KILLS = 20 if LONG else 3


def cases(*names: str) -> list[Case]:
    return [Case(f"{i}-{name}", {"name": name}, {"group": "LIN"}) for i, name in enumerate(names)]


def crew_of(cluster: LocalCluster, folder: Path) -> ClusterCrew:
    return ClusterCrew(cluster.address, folder=folder, files=folder, runner=RUNNER)


def check(outcomes: list[Outcome], wanted: list[Case], folder: Path) -> None:
    """Each case once, with its series, and nothing left over."""
    assert Counter(outcome.case.id for outcome in outcomes) == Counter(case.id for case in wanted)
    for outcome in outcomes:
        if outcome.result["status"] == "completed":
            assert (folder / f"{outcome.case.id}.npz").read_text() == f"series of {outcome.case.id}"
    assert not (folder / FOLDER).exists()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalCluster]:
    with local_cluster(tmp_path_factory.mktemp("cluster"), 2) as running:
        yield running


def test_every_case_has_an_outcome_whatever_becomes_of_it(cluster: LocalCluster, tmp_path: Path) -> None:
    wanted = cases("ok", "raises", "dies-once", "ok", *(["dies"] if LONG else []))
    with crew_of(cluster, tmp_path) as crew:
        outcomes = list(crew.run_many(wanted))
        assert crew.slots == 2
    check(outcomes, wanted, tmp_path)
    found = {outcome.case.id.partition("-")[2]: outcome.result for outcome in outcomes}
    assert found["ok"]["status"] == found["dies-once"]["status"] == "completed"
    assert (found["ok"]["cost"]["attempts"], found["dies-once"]["cost"]["attempts"]) == (1, 2)
    assert found["raises"]["status"] == CRASHED
    assert "ValueError: no good" in found["raises"]["message"]
    assert found["raises"]["provenance"]["scenario"] == {"name": "raises"}
    if LONG:
        assert "signal 9), attempt 5" in found["dies"]["message"]


def test_results_that_an_earlier_call_left_are_not_run_again(cluster: LocalCluster, tmp_path: Path) -> None:
    wanted = cases("ok", "ok", "ok", "ok")
    with crew_of(cluster, tmp_path) as crew:
        running = crew.run_many(wanted)
        first = next(running)
        running.close()  # whoever runs the campaign is gone before that one is kept
        store = tmp_path / FOLDER
        until(lambda: len(list((tmp_path).glob("*.begun"))) == len(list((store / "results").iterdir())))
    begun = {path.name for path in tmp_path.glob("*.begun")}
    with crew_of(cluster, tmp_path) as crew:
        outcomes = list(crew.run_many(wanted))
    check(outcomes, wanted, tmp_path)
    assert {path.name for path in tmp_path.glob("*.begun")} >= begun
    again = [path for path in tmp_path.glob("*.begun") if len(path.read_text().splitlines()) > 1]
    assert not again
    assert first.result["digest"] == "d"


def test_insertions_whose_series_are_the_same_have_one_each(cluster: LocalCluster, tmp_path: Path) -> None:
    wanted = cases(*["alike"] * 12)
    with crew_of(cluster, tmp_path) as crew:
        outcomes = list(crew.run_many(wanted))
    assert {outcome.result["status"] for outcome in outcomes} == {"completed"}
    assert all((tmp_path / f"{case.id}.npz").read_text() == "all alike" for case in wanted)


def test_a_window_of_twice_the_workers_is_submitted(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []
    submit = crew_module._Window._submit

    def counting(self: crew_module._Window, task: crew_module._Task) -> None:
        submit(self, task)
        sizes.append(len(self.running))

    monkeypatch.setattr(crew_module._Window, "_submit", counting)
    with crew_of(cluster, tmp_path) as crew:
        check(list(crew.run_many(wanted := cases(*["ok"] * 20))), wanted, tmp_path)
        assert max(sizes) == 4
        sizes.clear()
        check(list(crew.run_many(wanted := cases(*["ok"] * 3), alone=True)), wanted, tmp_path)
        assert max(sizes) == 1


def test_a_worker_that_does_not_see_the_folder_is_named(cluster: LocalCluster, tmp_path: Path) -> None:
    with crew_of(cluster, tmp_path) as crew:
        running = crew.run_many(cases("ok", "held", "held", "held", "held", "held"))
        assert next(running).result["status"] == "completed"
        (tmp_path / FOLDER / "token").write_text("of another disk")
        (tmp_path / "go").touch()
        with pytest.raises(NotSharedError, match=r"does not see .* on a disk that all machines share"):
            list(running)


def test_workers_killed_at_random_moments_lose_nothing(tmp_path: Path) -> None:
    wanted = cases(*["waits"] * (10 * KILLS))
    random_kill = random.Random(KILLS)
    with local_cluster(tmp_path / "cluster", 4) as cluster, crew_of(cluster, tmp_path) as crew:
        killed: list[int] = []

        def kill() -> None:
            until(lambda: len(list(tmp_path.glob("*.begun"))) > 4)
            for _ in range(KILLS):
                victim = random_kill.choice([one for one in cluster.workers if one.poll() is None])
                victim.kill()
                killed.append(victim.pid)
                cluster.start_worker()
                time.sleep(random_kill.uniform(0.5, 1.5))

        thread = threading.Thread(target=kill)
        thread.start()
        outcomes = list(crew.run_many(wanted))
        thread.join()
    check(outcomes, wanted, tmp_path)
    assert len(killed) == KILLS
    assert {outcome.result["status"] for outcome in outcomes} == {"completed"}
    attempts = [outcome.result["cost"]["attempts"] for outcome in outcomes]
    assert max(attempts) > 1  # some did lose an attempt


def test_a_scheduler_that_dies_is_waited_for_and_what_is_missing_goes_on(tmp_path: Path) -> None:
    wanted = cases(*["waits"] * 24)
    with local_cluster(tmp_path / "cluster", 2) as cluster, crew_of(cluster, tmp_path) as crew:
        outcomes = []
        for outcome in crew.run_many(wanted):
            outcomes.append(outcome)
            if len(outcomes) == 4:
                before = cluster.endpoint()
                cluster.kill_scheduler()
                cluster.start_scheduler()
                assert cluster.endpoint() != before
        assert all(worker.poll() is None for worker in cluster.workers)  # they came back by themselves
    check(outcomes, wanted, tmp_path)
    assert {outcome.result["status"] for outcome in outcomes} == {"completed"}


def test_another_commit_is_refused_with_a_sentence(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = {"identity": {"commit": "0" * 40}}
    (tmp_path / "cluster.json").write_text(json.dumps(about))
    (tmp_path / "scheduler.json").write_text(cluster.file.read_text())
    other = LocalCluster(tmp_path)
    assert other.start_worker().wait(timeout=60) == 1
    assert "this worker is refused: commit is" in other.log("worker0")
    assert "and 000000000000 for the campaign" in other.log("worker0")

    monkeypatch.setattr("service.cluster.connection.identity", lambda: {"commit": "f" * 40})
    with pytest.raises(RefusedError, match=r"does not take this campaign: commit is .* and ffffffffffff for"):
        crew_of(cluster, tmp_path).__enter__()


def test_a_worker_of_another_commit_is_sent_away_and_the_others_do_its_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = cases(*["waits"] * 6)
    with local_cluster(tmp_path / "cluster", 1) as cluster, crew_of(cluster, tmp_path) as crew:
        other = cluster.start_worker("--commit", "e" * 40)
        outcomes = list(crew.run_many(wanted))
        assert other.wait(timeout=600) == 1
        assert "is refused: commit is eeeeeeeeeeee there and" in cluster.log("worker1")
    check(outcomes, wanted, tmp_path)
    assert "is refused: commit is eeeeeeeeeeee there and" in capsys.readouterr().err


def test_a_worker_that_is_told_to_end_gives_its_attempt_back(tmp_path: Path) -> None:
    with local_cluster(tmp_path / "cluster", 1) as cluster, crew_of(cluster, tmp_path) as crew:
        outcomes: list[Outcome] = []
        thread = threading.Thread(target=lambda: outcomes.extend(crew.run_many(cases("held"))))
        thread.start()
        until((tmp_path / "0-held.begun").exists)
        cluster.workers[0].terminate()
        assert cluster.workers[0].wait(timeout=600) == 0
        cluster.start_worker()
        (tmp_path / "go").touch()
        thread.join()
    assert len((tmp_path / "0-held.begun").read_text().splitlines()) == 2
    assert outcomes[0].result["cost"]["attempts"] == 1


def test_a_worker_whose_time_is_over_begins_nothing(tmp_path: Path) -> None:
    wanted = cases("held", "ok", "ok")
    with local_cluster(tmp_path / "cluster", 0) as cluster, crew_of(cluster, tmp_path) as crew:
        outcomes: list[Outcome] = []
        thread = threading.Thread(target=lambda: outcomes.extend(crew.run_many(wanted)))
        thread.start()
        short_lived = cluster.start_worker("--lifetime", "0.1")
        assert short_lived.wait(timeout=600) == 0  # over before it began anything
        cluster.start_worker()
        until((tmp_path / "0-held.begun").exists)
        (tmp_path / "go").touch()
        thread.join()
    check(outcomes, wanted, tmp_path)


def test_a_scheduler_that_never_comes_is_said_to_be_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    address = ClusterAddress(f"file:{tmp_path}/scheduler.json")
    with pytest.raises(NoSchedulerError, match=r"scheduler\.json for 1 s; the same command goes on"):
        ClusterCrew(address, folder=tmp_path, files=tmp_path, patience_s=1.0).__enter__()
    assert "waiting for a scheduler at file:" in capsys.readouterr().err
