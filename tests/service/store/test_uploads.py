"""Meshes and models over HTTP: kept by content, looked into first, named in scenarios by id, never by a path."""

from __future__ import annotations

import errno
import hashlib
import io
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from service.settings import Limits
from tests.service.http import finish, idle_service
from tests.service.learned import dataset_bytes, model_bytes
from tests.service.store.uploads import JOBS, UPLOADS, box, scenario, send

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service


@pytest.mark.slow
def test_the_same_content_is_one_upload(http: TestClient, tmp_path: Path) -> None:
    data = box(tmp_path)
    first = send(http, data, **{"Content-Type": "application/octet-stream"})
    sha256 = hashlib.sha256(data).hexdigest()
    told = first.json()
    assert (first.status_code, first.headers["location"]) == (201, f"{UPLOADS}/{sha256}.vtk")
    assert (told["id"], told["reference"], told["sha256"]) == (f"{sha256}.vtk", f"artefact:{sha256}.vtk", sha256)
    assert told["content"] == {"nodes": 105, "tetrahedra": 288}
    again = send(http, data, name="other name.vtk")
    assert (again.status_code, again.json()) == (200, told)
    assert http.get(UPLOADS).json()["items"] == [told]
    assert http.get(first.headers["location"]).json() == told
    assert http.get(told["url"]).content == data


@pytest.mark.slow
def test_a_job_names_an_upload_and_holds_it_until_it_has_ended(
    both: tuple[TestClient, Service], tmp_path: Path
) -> None:
    http, service = both
    sent = send(http, box(tmp_path)).json()
    job = http.post(JOBS, json={"scenario": scenario(sent["reference"])})
    assert job.status_code == 202, job.text
    tissue = job.json()["scenario"]["tissue"]
    assert (tissue["mesh_file"], tissue["mesh_sha256"]) == (sent["reference"], sent["sha256"])
    refused = http.delete(f"{UPLOADS}/{sent['id']}")
    assert (refused.status_code, job.json()["id"] in refused.json()["detail"]) == (409, True)
    finish(service)
    assert http.delete(f"{UPLOADS}/{sent['id']}").status_code == 204
    assert list(service.settings.uploads.iterdir()) == []
    told = http.post(JOBS, json={"scenario": scenario(sent["reference"])})
    assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "tissue.mesh_file")
    assert "no upload of this service" in told.json()["detail"]


@pytest.mark.slow
def test_a_replay_names_its_poses_as_an_upload_and_never_as_a_path(http: TestClient, tmp_path: Path) -> None:
    rows = np.array([[18.0, 31.0, -180.0 + 0.5 * i, 1.0, 0.0, 0.0, 0.0] for i in range(1000)])
    np.save(tmp_path / "log.npy", rows)
    data = (tmp_path / "log.npy").read_bytes()
    sent = send(http, data, "log.npy", "poses").json()
    assert (sent["kind"], sent["content"]) == ("poses", {"poses": 1000})
    controller = {"kind": "replay", "poses_file": sent["reference"]}
    job = http.post(JOBS, json={"scenario": {"controller": controller}})
    assert job.status_code == 202
    assert job.json()["progress"]["steps"] == 1000
    assert job.json()["scenario"]["controller"]["poses_sha256"] == hashlib.sha256(data).hexdigest()
    assert len(job.content) < 10_000  # the job keeps the name, not the poses
    assert http.delete(f"{UPLOADS}/{sent['id']}").status_code == 409
    controller = {"kind": "replay", "poses_file": str(tmp_path / "log.npy")}
    refused = http.post(JOBS, json={"scenario": {"controller": controller}})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["field"] == "controller.poses_file"
    wrong = io.BytesIO()
    np.save(wrong, rows[:, :6])
    refused = send(http, wrong.getvalue(), "log.npy", "poses")
    assert refused.status_code == 422
    assert "rows of 7 numbers, and is 1000 x 6" in refused.json()["detail"]


@pytest.mark.slow
@pytest.mark.parametrize("path", [JOBS, "/api/v1/campaigns"])
def test_an_upload_that_goes_while_something_is_submitted_is_told(
    both: tuple[TestClient, Service], tmp_path: Path, path: str
) -> None:
    http, service = both
    sent = send(http, box(tmp_path)).json()
    service.uploads.delete(sent["id"])
    (service.settings.uploads / sent["id"]).write_bytes(box(tmp_path))
    asked: dict[str, Any] = {"scenario": scenario(sent["reference"])}
    told = http.post(path, json=asked if path == JOBS else {**asked, "grid": {"dt_s": [0.01, 0.02]}})
    assert told.status_code == 422, told.text
    (error,) = told.json()["errors"]
    field = "tissue.mesh_file" if path == JOBS else "scenario.tissue.mesh_file"
    assert (error["field"], error["value"]) == (field, sent["reference"])
    assert service.store.page().items == []


@pytest.mark.slow
def test_a_mesh_that_does_not_fit_the_scenario_is_refused_at_submission(http: TestClient, tmp_path: Path) -> None:
    wrong = scenario(send(http, box(tmp_path)).json()["reference"])
    wrong["trajectory"]["entry_mm"] = [10, 20, 5]
    told = http.post(JOBS, json={"scenario": wrong})
    assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "trajectory.entry_mm")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["../box.vtk", "/etc/box.vtk", "a/b.vtk", "a\\b.vtk", "..", ".vtk", "box\x00.vtk", "b" * 200 + ".vtk", "ü.vtk", ""],
)
def test_a_name_is_a_label_and_no_path(http: TestClient, tmp_path: Path, name: str) -> None:
    answer = send(http, box(tmp_path), name=name)
    assert answer.status_code == 422
    assert not (tmp_path / "data" / "uploads").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "content_type"),
    [
        ("box.stl", "mesh", ""),
        ("box", "mesh", ""),
        ("model.npz", "mesh", ""),
        ("model.pkl", "model", ""),
        ("model.npz", "model", ""),
        ("data.json", "dataset", ""),
        ("data.pkl", "dataset", ""),
        ("box.vtk", "model", ""),
        ("box.vtk", "mesh", "application/json"),
        ("box.vtk", "mesh", "multipart/form-data; boundary=x"),
        ("model.json", "model", "application/x-npz"),
    ],
)
def test_other_types_are_415(http: TestClient, name: str, kind: str, content_type: str) -> None:
    headers = {"Content-Type": content_type} if content_type else {}
    answer = send(http, b"x", name, kind, **headers)
    assert (answer.status_code, answer.headers["content-type"]) == (415, "application/problem+json")


def test_a_long_file_is_413_declared_or_not_and_leaves_nothing(both: tuple[TestClient, Service]) -> None:
    http, service = both
    assert send(http, b" " * 100_001).status_code == 413
    chunks = http.post(UPLOADS, params={"kind": "mesh", "name": "a.vtk"}, content=iter([b" " * 60_000] * 2))
    assert chunks.status_code == 413
    assert list(service.settings.uploads.iterdir()) == []


@pytest.mark.slow
def test_content_that_is_not_what_its_suffix_says_is_refused_and_leaves_nothing(
    both: tuple[TestClient, Service], tmp_path: Path
) -> None:
    http, service = both
    told = send(http, box(tmp_path), name="box.inp")
    assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "body")
    assert str(service.settings.data) not in told.text
    assert list(service.settings.uploads.iterdir()) == []


@pytest.mark.slow
def test_what_is_in_a_model_and_in_a_data_set_is_told(http: TestClient) -> None:
    told = send(http, dataset_bytes(rows=40), "data.npz", "dataset").json()["content"]
    assert told["splits"] == {"sample": [72, 8], "trajectory": [40, 40]}
    assert (told["rows"], told["insertions"], told["drawn"], told["seed"]) == (80, 2, 80, 0)
    told = send(http, model_bytes("elm", nodes=3), "elm.json", "model").json()["content"]
    assert (told["kind"], told["inputs"], told["outputs"], told["settings"]["nodes"]) == ("elm", 6, 3, 3)
    assert told["provenance"]["train_rows"] == 72


def test_what_a_dead_server_left_half_received_is_swept(tmp_path: Path) -> None:
    left = tmp_path / "uploads" / "1-1.part.msh"
    left.parent.mkdir()
    left.write_bytes(b"half")
    with idle_service(tmp_path):
        assert not left.exists()


@pytest.mark.slow
def test_all_uploads_together_have_a_limit(tmp_path: Path) -> None:
    text = [model_bytes("linear", ridge=ridge) for ridge in (0.1, 0.2)]
    with idle_service(tmp_path / "data", limits=Limits(uploads_mb=1.5e-6 * len(text[0]))) as (http, service):
        first = send(http, text[0], "a.json", "model")
        full = send(http, text[1], "b.json", "model")
        assert (first.status_code, full.status_code) == (201, 507)
        assert full.headers["content-type"] == "application/problem+json"
        assert send(http, text[0], "c.json", "model").status_code == 200
        assert [path.name for path in service.settings.uploads.iterdir()] == [first.json()["id"]]
        assert http.delete(first.headers["location"]).status_code == 204
        assert send(http, text[1], "b.json", "model").status_code == 201


@pytest.mark.slow
def test_limits_are_told_in_the_estimate(tmp_path: Path) -> None:
    with idle_service(tmp_path / "data", limits=Limits(nodes=100)) as (http, _):
        reference = send(http, box(tmp_path)).json()["reference"]
        told = http.post(JOBS, json={"scenario": scenario(reference)}).json()
    (error,) = told["errors"]
    assert error["field"] == "tissue.mesh_file"
    assert "gives 105 nodes, at most 100 are allowed here (estimate: 105 nodes" in error["message"]
    assert json.dumps(told)


@pytest.mark.slow
def test_what_is_still_coming_in_is_counted_and_removed(tmp_path: Path) -> None:
    with idle_service(tmp_path / "data", limits=Limits(uploads_mb=0.01)) as (http, service):
        uploads = service.uploads
        first = uploads.draft(".msh")
        first.write_bytes(b"x" * 6000)
        uploads.grow(first, 6000)
        answer = send(http, b"y" * 5000)
        assert (answer.status_code, answer.json()["code"]) == (507, "uploads-full")
        assert "with those that are coming in" in answer.json()["detail"]
        assert [path.name for path in uploads.folder.iterdir()] == [first.name]
        uploads.drop(first)
        uploads.drop(first)
        assert list(uploads.folder.iterdir()) == []
        assert send(http, b"y" * 5000).status_code == 422  # looked into: it is no mesh
        assert uploads._incoming == {}


def test_a_disk_that_is_full_during_an_upload_is_507_and_leaves_nothing(
    http: TestClient, both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch
) -> None:
    service = both[1]

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(service.uploads, "grow", refuse)
    answer = send(http, b"y" * 5000)
    assert (answer.status_code, answer.json()["code"]) == (507, "disk-full")
    assert "No space left on device" in answer.json()["detail"]
    assert list(service.settings.uploads.iterdir()) == []


@pytest.mark.slow
def test_a_truncated_archive_of_arrays_is_422(http: TestClient) -> None:
    whole = dataset_bytes()
    for length in (10, 200, len(whole) // 2, len(whole) - 30):
        answer = send(http, whole[:length], "data.npz", "dataset")
        assert (answer.status_code, answer.json()["code"]) == (422, "upload-unusable"), length
