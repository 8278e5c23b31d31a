from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from service.api.context import Service, _sweep_of
from service.cli.main import main
from service.engine.housekeeper import SWEEP_S, Keeper
from service.engine.retention import Policy, clear, seconds_of
from service.store.job import Outcome
from service.store.jobs import Store
from simcore.errors import ScenarioError
from tests.service.http import finish, finish_training, idle_service
from tests.service.learned import dataset_bytes, model_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

DAY = 86400.0


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


class Clock:
    """Days since 1970 that a test sets."""

    day = 100.0

    def __call__(self) -> float:
        return self.day * DAY


def ended(service: Service, clock: Clock, days: list[float], *, size: int = 1000) -> tuple[Store, list[str]]:
    """Jobs that ended on these days, oldest first, with a file each."""
    store = Store(service.store.engine, now=clock)
    ids = []
    for day in days:
        clock.day = day
        fields = {"spec": {"scenario": {}}, "spec_hash": "0", "steps": 1, "priority": 0, "timeout_s": 1.0}
        store.submit(name="a", **fields)  # type: ignore[arg-type]
        job = store.claim()
        assert job is not None
        folder = service.settings.data / job.folder
        folder.mkdir(parents=True)
        (folder / "recording.rrd").write_bytes(b"x" * size)
        store.finish(job, Outcome(state="finished", result={}))
        ids.append(job.id)
    clock.day = 100.0
    return store, ids


def cleared(service: Service, policy: Policy, days: list[float], *, pin: int | None = None) -> list[int]:
    """Which of the jobs went, by their place in the list; files and rows must go together."""
    store, ids = ended(service, Clock(), days)
    if pin is not None:
        store.pin(ids[pin], pinned=True)
    told = clear(store, service.settings.jobs, policy, dry_run=True)
    assert store.ids() == set(ids)
    done = clear(store, service.settings.jobs, policy, dry_run=False)
    assert done == told
    assert done.bytes == 1000 * len(done.jobs)
    assert (done.kept, done.kept_bytes) == (len(ids) - len(done.jobs), 1000 * (len(ids) - len(done.jobs)))
    assert set(os.listdir(service.settings.jobs)) == store.ids() == set(ids) - set(done.jobs)
    return [ids.index(job) for job in done.jobs]


DAYS = [10.0, 50.0, 69.0, 71.0, 99.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "gone"),
    [
        (Policy(), []),
        (Policy(older_than_s=30 * DAY), [0, 1, 2]),
        (Policy(keep_last=2), [0, 1, 2]),
        (Policy(older_than_s=30 * DAY, keep_last=4), [0]),
        (Policy(max_bytes=3500), [0, 1]),
        (Policy(max_bytes=0), [0, 1, 2, 3, 4]),
        (Policy(max_bytes=0, keep_last=3), [0, 1]),
        (Policy(older_than_s=60 * DAY, max_bytes=4000), [0]),
    ],
)
def test_jobs_go_by_age_number_and_size(both: tuple[TestClient, Service], policy: Policy, gone: list[int]) -> None:
    assert cleared(both[1], policy, DAYS) == gone


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "pin", "gone"),
    [
        (Policy(older_than_s=30 * DAY), 0, [1, 2]),
        (Policy(keep_last=2), 1, [0, 2]),
        (Policy(max_bytes=3500), 0, [1, 2]),  # the pinned one counts, and another goes in its place
        (Policy(max_bytes=0), 4, [0, 1, 2, 3]),
    ],
)
def test_pinned_jobs_stay_and_are_not_announced_as_going(
    both: tuple[TestClient, Service], policy: Policy, pin: int, gone: list[int]
) -> None:
    assert cleared(both[1], policy, DAYS, pin=pin) == gone


@pytest.mark.slow
def test_pinned_and_active_jobs_stay(both: tuple[TestClient, Service]) -> None:
    http, service = both
    active = http.post("/api/v1/jobs", json={"scenario": "line"}).json()["id"]
    service.store.claim()
    store, ids = ended(service, Clock(), DAYS)
    store.pin(ids[0], pinned=True)
    done = clear(store, service.settings.jobs, Policy(max_bytes=0), dry_run=False)
    assert list(done.jobs) == ids[1:]
    assert store.ids() == {active, ids[0]}


def test_folders_without_a_job_and_of_earlier_attempts_are_swept(both: tuple[TestClient, Service]) -> None:
    """What a kill between the removal of a row and that of its files leaves, and what a crashed attempt left."""
    http, service = both
    folder = service.settings.jobs
    _, (kept,) = ended(service, Clock(), [99.0])
    (folder / "0123456789abcdef" / "1").mkdir(parents=True)
    (folder / "0123456789abcdef" / "1" / "job.log").write_text("12345")
    job = http.post("/api/v1/jobs", json={"scenario": "line"}).json()["id"]
    for _ in range(2):
        running = service.store.claim()
        assert running is not None
        (folder / job / str(running.attempt)).mkdir(parents=True)
        if running.attempt == 1:
            service.store.requeue(running, reason="signal 9", crashed=True)
    assert clear(service.store, folder, Policy(), dry_run=False).orphans == ("0123456789abcdef",)
    assert running is not None
    service.store.finish(running, Outcome(state="finished", result={}))
    assert clear(service.store, folder, Policy(), dry_run=False).orphans == (f"{job}/1",)
    assert sorted(os.listdir(folder)) == sorted([kept, job])
    assert os.listdir(folder / job) == ["2"]


class Sent:
    """Uploads of a service whose clock a test sets, by what a test calls them."""

    def __init__(self, http: TestClient, service: Service) -> None:
        self._http, self._service = http, service
        self.clock = Clock()
        self.ids: dict[str, str] = {}
        service.store._now = self.clock

    def send(self, name: str, data: bytes, *, day: float = 10.0) -> str:
        self.clock.day = day
        kind, suffix = ("dataset", "npz") if name.startswith("data") else ("model", "json")
        query = {"kind": kind, "name": f"{name}.{suffix}"}
        answer = self._http.post("/api/v1/uploads", params=query, content=data)
        assert answer.status_code == 201, answer.text
        self.ids[name] = answer.json()["id"]
        self.clock.day = 100.0
        return f"artefact:{self.ids[name]}"

    def cleared(self, *, dry_run: bool = False, **policy: float) -> set[str]:
        """Which went, by what the test calls them; the files must agree."""
        body = {"older_than_s": 30 * DAY, **policy, "dry_run": dry_run}
        gone = set(self._http.post("/api/v1/gc", json=body).json()["uploads"])
        there = {path.name for path in self._service.settings.uploads.iterdir()}
        listed = {item["id"] for item in self._http.get("/api/v1/uploads").json()["items"]}
        assert there == listed
        assert bool(gone & there) is (dry_run and bool(gone))
        return {name for name, upload_id in self.ids.items() if upload_id in gone}


def steer(model: str) -> dict[str, object]:
    return {"trajectory": {"kind": "line"}, "controller": {"kind": "linear", "model": model}}


@pytest.mark.slow
def test_uploads_go_by_age_unless_something_names_them(both: tuple[TestClient, Service]) -> None:
    http, service = both
    sent = Sent(http, service)
    names = ("unused", "pinned", "by_job", "by_campaign", "by_schedule")
    named = {name: sent.send(name, model_bytes("linear", ridge=1.0 + i)) for i, name in enumerate(names)}
    sent.send("young", model_bytes("linear", ridge=0.9), day=90.0)
    http.post(f"/api/v1/uploads/{sent.ids['pinned']}/pin")
    job = http.post("/api/v1/jobs", json={"scenario": steer(named["by_job"])})
    assert job.status_code == 202, job.text
    grid = {"scenario": steer(named["by_campaign"]), "grid": {"tissue.young_kpa": [6.3]}}
    assert http.post("/api/v1/campaigns", json=grid).status_code == 202
    nightly = {"scenario": steer(named["by_schedule"]), "grid": {"tissue.young_kpa": [6.3]}}
    made = http.post("/api/v1/schedules", json={"name": "nightly", "cron": "0 2 * * *", "campaign": nightly})
    assert made.status_code == 201, made.text
    assert sent.cleared(dry_run=True) == {"unused"}
    assert sent.cleared() == {"unused"}
    http.post(f"/api/v1/jobs/{job.json()['id']}/cancel")
    assert sent.cleared() == set()  # the job has ended, and stays
    sent.clock.day = 200.0
    assert sent.cleared(dry_run=True) == {"by_job", "young"}  # it would go, and nothing else names the model
    assert sent.cleared() == {"by_job", "young"}
    assert http.post("/api/v1/gc", json={"max_bytes": 0}).json()["uploads"] == []
    assert http.delete(f"/api/v1/schedules/{made.json()['id']}").status_code == 204
    http.delete(f"/api/v1/uploads/{sent.ids['pinned']}/pin")
    assert sent.cleared() == {"pinned", "by_schedule"}


@pytest.mark.slow
def test_a_data_set_stays_as_long_as_a_model_that_learned_from_it(both: tuple[TestClient, Service]) -> None:
    http, service = both
    sent = Sent(http, service)
    data = sent.send("data", dataset_bytes())
    sent.send("data_unused", dataset_bytes(seed=1))
    sent.clock.day = 20.0
    job = http.post("/api/v1/models/train", json={"data": data}).json()["id"]
    sent.ids["trained"] = (finish_training(service).metrics or {})["model"]
    http.post(f"/api/v1/jobs/{job}/pin")
    sent.clock.day = 100.0
    assert sent.cleared() == {"data_unused"}
    http.delete(f"/api/v1/jobs/{job}/pin")
    http.post(f"/api/v1/uploads/{sent.ids['trained']}/pin")
    assert sent.cleared() == set()
    assert service.store.ids() == set()
    http.delete(f"/api/v1/uploads/{sent.ids['trained']}/pin")
    assert sent.cleared() == {"trained", "data"}


@pytest.mark.slow
def test_a_file_without_a_row_is_swept(both: tuple[TestClient, Service]) -> None:
    """What a kill between the two leaves."""
    http, service = both
    sent = Sent(http, service)
    sent.send("model", model_bytes("linear"))
    left = service.settings.uploads / ("0" * 64 + ".npz")
    left.write_bytes(b"left")
    told = gc("--data", str(service.settings.data), "--json")
    assert json.loads(told.output)["uploads"] == []
    assert {path.name for path in service.settings.uploads.iterdir()} == {sent.ids["model"]}


@pytest.mark.slow
def test_over_http_and_on_the_command_line(both: tuple[TestClient, Service]) -> None:
    http, service = both
    _, ids = ended(service, Clock(), DAYS)
    dry = http.post("/api/v1/gc", json={"keep_last": 3, "dry_run": True}).json()
    assert (dry["jobs"], dry["bytes"]) == (ids[:2], 2000)
    wrong = http.post("/api/v1/gc", json={"older_than_s": -1})
    assert (wrong.status_code, wrong.json()["errors"][0]["field"]) == (422, "older_than_s")
    told = gc("--data", str(service.settings.data), "--keep-last", "3", "--json")
    assert json.loads(told.output)["jobs"] == ids[:2]
    assert service.store.ids() == set(ids[2:])
    assert gc("--data", str(service.settings.data), "--max-gb", "0", "--dry-run").output.split()[:3] == ids[2:]


def test_bad_words_are_named(tmp_path: Path) -> None:
    told = gc("--data", str(tmp_path), "--older-than", "a month")
    assert (told.exit_code, "--older-than" in told.output, "30d" in told.output) == (2, True, True)
    assert gc("--data", str(tmp_path)).exit_code == 2
    assert not list(tmp_path.iterdir())


def gc(*words: str) -> Result:
    return CliRunner().invoke(main, ("gc", *words), env={"NEEDLEBENCH_URL": None})


@pytest.mark.slow
@given(st.floats(0, 1e6), st.sampled_from("smhdw"))
def test_ages_are_read(count: float, unit: str) -> None:
    text = f"{count:.3f}{unit}"
    assert seconds_of(text, "x") == pytest.approx(float(text[:-1]) * seconds_of(f"1{unit}", "x"))
    with pytest.raises(ScenarioError):
        seconds_of(f"-{text}", "x")


# ---- by the service itself


@pytest.mark.slow
def test_the_keeper_sweeps_at_first_and_then_once_a_day(tmp_path: Path) -> None:
    with idle_service(tmp_path, keep_days=30.0) as (_, service):
        moments = [0.0]
        store, ids = ended(service, Clock(), DAYS)
        sweep = _sweep_of(service.settings, store, service.uploads)
        parts = (service.campaigns, service.schedules, service.planner)
        keeper = Keeper(*parts, wake=lambda: None, sweep=sweep, clock=lambda: moments[0])
        keeper.tick()
        assert store.ids() == set(ids[3:])
        later, more = ended(service, Clock(), [1.0])
        for moments[0], there in ((SWEEP_S - 1.0, True), (SWEEP_S, False)):
            keeper.tick()
            assert (more[0] in later.ids()) is there


def test_without_a_rule_the_service_clears_nothing(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (_, service):
        ended(service, Clock(), [1.0])
        assert _sweep_of(service.settings, service.store, service.uploads) is None
        service.keeper.tick()
        assert len(service.store.ids()) == 1


@pytest.mark.slow
def test_a_size_alone_is_a_rule(tmp_path: Path) -> None:
    with idle_service(tmp_path, keep_gb=2500 / 2**30) as (_, service):
        _, ids = ended(service, Clock(), [97.0, 98.0, 99.0])
        service.keeper.tick()
        assert service.store.ids() == set(ids[1:])


@pytest.mark.slow
def test_jobs_of_a_campaign_stay_until_it_has_ended(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = http.post("/api/v1/campaigns", json={"scenario": {"noise_mm": 0.25}, "grid": {"seed": [0, 1]}}).json()[
        "links"
    ]["self"]
    first = finish(service)
    assert clear(service.store, service.settings.jobs, Policy(keep_last=0), dry_run=False).jobs == ()
    second = finish(service)
    service.keeper.tick()
    assert http.get(made).json()["state"] == "done"
    gone = clear(service.store, service.settings.jobs, Policy(keep_last=0), dry_run=False).jobs
    assert sorted(gone) == sorted([first.id, second.id])


@pytest.mark.slow
def test_all_else_in_the_data_folder_stays(both: tuple[TestClient, Service]) -> None:
    """The viewer's files are taken out of the wheel once; copies of the database are the operator's."""
    http, service = both
    kept = [service.settings.data / folder / "x" / "file" for folder in ("viewer", "backups", ".cache")]
    for path in kept:
        path.parent.mkdir(parents=True)
        path.write_text("kept")
    for _ in range(2):
        http.post("/api/v1/jobs", json={"scenario": "line"})
    finish(service)
    cleared = http.post("/api/v1/gc", json={"max_bytes": 0}).json()
    assert (len(cleared["jobs"]), cleared["orphans"]) == (1, [])
    assert all(path.read_text() == "kept" for path in kept)
