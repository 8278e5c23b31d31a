"""Lists by pages and by what they are asked for; the document describes scenarios and metrics field by field."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

import jsonschema_rs
import numpy as np
import pytest

from simcore.metric_definitions import METRICS
from simcore.scenario.presets import preset, preset_names
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

API = "/api/v1"


@pytest.fixture
def http(tmp_path: Path) -> Iterator[TestClient]:
    with idle_service(tmp_path) as (client, _):
        yield client


def pages(http: TestClient, path: str, **params: Any) -> list[list[Any]]:
    found, cursor = [], None
    while True:
        asked = {**params, **({"cursor": cursor} if cursor else {})}
        page = http.get(f"{API}/{path}", params=asked).json()
        found.append([item.get("id") or item["case"] for item in page["items"]])
        if (cursor := page["next_cursor"]) is None:
            return found


def flat(found: list[list[Any]]) -> list[Any]:
    return [item for page in found for item in page]


@pytest.mark.slow
def test_uploads_models_and_cases_come_by_pages(http: TestClient) -> None:
    sent = []
    for number in range(5):
        file = io.BytesIO()
        np.save(file, np.array([[0.0, 0.0, float(number), 1.0, 0.0, 0.0, 0.0]]))
        params = {"kind": "poses", "name": "a.npy"}
        sent.append(http.post(f"{API}/uploads", params=params, content=file.getvalue()).json()["id"])
    found = pages(http, "uploads", limit=2)
    assert list(map(len, found)) == [2, 2, 1]
    assert flat(found) == sent[::-1]
    assert pages(http, "uploads", limit=2, kind="mesh") == [[]]
    assert len(pages(http, "models", limit=1)) == 1
    campaign = http.post(
        f"{API}/campaigns", json={"scenario": {"noise_mm": 0.25}, "grid": {"seed": [0, 1, 2, 3, 4]}}
    ).json()["id"]
    cases = pages(http, f"campaigns/{campaign}/jobs", limit=2)
    assert list(map(len, cases)) == [2, 2, 1]
    assert flat(cases) == flat(pages(http, f"campaigns/{campaign}/jobs"))


@pytest.mark.slow
def test_jobs_are_listed_by_name_and_by_campaign(http: TestClient) -> None:
    for name in ("one", "two", "two"):
        http.post(f"{API}/jobs", json={"scenario": {"name": name}})
    campaign = http.post(f"{API}/campaigns", json={"scenario": {"noise_mm": 0.25}, "grid": {"seed": [0, 1]}}).json()[
        "id"
    ]
    assert len(flat(pages(http, "jobs", name="two", limit=1))) == 2
    assert len(flat(pages(http, "jobs", campaign=campaign))) == 2
    assert pages(http, "jobs", name="three") == [[]]
    assert len(flat(pages(http, "jobs"))) == 5


@pytest.mark.slow
def test_the_document_describes_scenarios_as_they_are_checked(http: TestClient) -> None:
    document = http.get("/openapi.json").json()
    schemas = document["components"]["schemas"]
    chosen = schemas["JobRequest"]["properties"]["scenario"]["anyOf"]
    assert {"$ref": "#/components/schemas/Scenario"} in chosen
    whole = {"$ref": "#/components/schemas/Scenario", "components": document["components"]}
    checker = jsonschema_rs.Draft202012Validator(whole)
    for name in preset_names():
        assert checker.is_valid(json.loads(json.dumps(preset(name).resolved()))), name
    assert not checker.is_valid({"tissue": {"young_kpa": -1}})
    assert not checker.is_valid({"surprise": 1})


@pytest.mark.slow
def test_the_document_describes_every_metric(http: TestClient) -> None:
    schemas = http.get("/openapi.json").json()["components"]["schemas"]
    assert schemas["MetricsView"]["properties"]["metrics"]["anyOf"][0] == {"$ref": "#/components/schemas/Metrics"}
    described = schemas["Metrics"]["properties"]
    for metric in METRICS:
        part, *names = metric.key.split(".")
        if part == "metrics" and len(names) == 1:
            one = described[names[0]]
            assert one["x-unit"] == metric.unit
            assert metric.sane_range in one["description"]
            assert {"type": "null"} in one["anyOf"]


@pytest.mark.slow
def test_a_grid_does_not_repeat_a_long_list_of_poses(http: TestClient) -> None:
    poses = [[18.0, 31.0, -180.0, 1.0, 0.0, 0.0, 0.0]] * 5000
    scenario = {"controller": {"kind": "replay", "poses": poses}}
    answer = http.post(
        f"{API}/campaigns",
        json={"scenario": scenario, "grid": {"tissue.young_kpa": [3.0 + 0.1 * i for i in range(50)]}},
    )
    assert answer.status_code == 422
    assert "name them in controller.poses_file" in answer.json()["detail"]
