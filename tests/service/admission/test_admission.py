"""What is let in: a mesh is never in the server's memory, and few are looked at at a time."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

from service.admission import admission
from service.admission.admission import AdmissionBusyError, names_mesh
from service.settings import Limits
from simcore.errors import ScenarioError
from simcore.mesh.reader import MeshFile
from tests.service.http import idle_service
from tests.service.store.uploads import box, scenario, send

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

MESH = f"artefact:{'0' * 64}.msh"


@pytest.fixture
def http(tmp_path: Path) -> Iterator[TestClient]:
    with idle_service(tmp_path / "data") as (client, _):
        yield client


@pytest.mark.slow
def test_a_submission_with_a_mesh_is_checked_outside_of_the_server(
    http: TestClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = send(http, box(tmp_path)).json()["reference"]

    def refuse(*_: Any) -> Any:
        raise AssertionError("a mesh was read in the server")

    monkeypatch.setattr(MeshFile, "read", refuse)
    job = http.post("/api/v1/jobs", json={"scenario": scenario(reference)})
    assert job.status_code == 202, job.text
    assert len(job.json()["scenario"]["tissue"]["mesh_sha256"]) == 64
    grid = {"name": "two", "scenario": scenario(reference), "grid": {"tissue.young_kpa": [3.0, 6.3]}}
    campaign = http.post("/api/v1/campaigns", json=grid)
    assert (campaign.status_code, campaign.json()["cases"]) == (202, 2), campaign.text
    for page in ("/", "/submit", f"/submit?from={job.json()['id']}", f"/jobs/{job.json()['id']}"):
        assert http.get(page).status_code == 200
    wrong = scenario(reference)
    wrong["trajectory"]["entry_mm"] = [10, 20, 5]
    told = http.post("/api/v1/jobs", json={"scenario": wrong})
    assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "trajectory.entry_mm")


def test_a_check_that_does_not_end_is_a_refusal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(admission, "TIME_S", 0.01)
    with pytest.raises(ScenarioError) as refused:
        admission.admit({"tissue": {"mesh_file": MESH}}, tmp_path, Limits())
    (problem,) = refused.value.problems
    assert (problem.field, problem.value) == ("tissue.mesh_file", MESH)
    assert "takes more than 0.01 s or 4000 MB" in problem.message


def test_few_meshes_are_checked_at_a_time_and_few_requests_wait() -> None:
    gate = admission._Gate()
    go, inside = threading.Event(), threading.Semaphore(0)

    def pass_through() -> None:
        with gate.passed():
            inside.release()
            go.wait()

    threads = [threading.Thread(target=pass_through) for _ in range(admission.MOST_WAITING)]
    for thread in threads:
        thread.start()
    for _ in range(admission.AT_ONCE):
        assert inside.acquire(timeout=30)
    while gate.waiting < admission.MOST_WAITING:
        threading.Event().wait(0.01)
    assert not inside.acquire(blocking=False)
    with pytest.raises(AdmissionBusyError), gate.passed():
        pass
    go.set()
    for thread in threads:
        thread.join()
    assert gate.waiting == 0
    with gate.passed():
        pass


def test_too_many_checks_at_once_are_a_problem(http: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission.gate, "waiting", admission.MOST_WAITING)
    told = http.post("/api/v1/jobs", json={"scenario": {"tissue": {"mesh_file": MESH}}})
    assert (told.status_code, told.json()["code"], "retry-after" in told.headers) == (503, "busy", True)


@pytest.mark.parametrize(
    ("value", "names"),
    [
        ("demo", False),
        ({"tissue": {"mesh_file": "a.msh"}}, False),
        ({"controller": {"model": MESH.replace(".msh", ".json")}}, False),
        ({"tissue": {"mesh_file": MESH}}, True),
        ({"grid": {"tissue.mesh_file": [MESH]}}, True),
        ({"grid": {"tissue": [{"mesh_file": MESH}]}}, True),
    ],
)
def test_a_mesh_is_found_wherever_it_is_named(value: Any, names: bool) -> None:
    assert names_mesh(value) is names
