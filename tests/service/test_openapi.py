from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.service.http import idle_service

OPERATIONS = {
    "submit_job": "POST /api/v1/jobs",
    "list_jobs": "GET /api/v1/jobs",
    "get_job": "GET /api/v1/jobs/{job_id}",
    "cancel_job": "POST /api/v1/jobs/{job_id}/cancel",
    "retry_job": "POST /api/v1/jobs/{job_id}/retry",
    "pin_job": "POST /api/v1/jobs/{job_id}/pin",
    "unpin_job": "DELETE /api/v1/jobs/{job_id}/pin",
    "get_job_events": "GET /api/v1/jobs/{job_id}/events",
    "get_events": "GET /api/v1/events",
    "delete_job": "DELETE /api/v1/jobs/{job_id}",
    "get_metrics": "GET /api/v1/jobs/{job_id}/metrics",
    "get_series": "GET /api/v1/jobs/{job_id}/series",
    "list_artefacts": "GET /api/v1/jobs/{job_id}/artefacts",
    "get_artefact": "GET /api/v1/jobs/{job_id}/artefacts/{name}",
    "get_recording": "GET /recordings/{job_id}.rrd",
    "list_scenarios": "GET /api/v1/scenarios",
    "get_scenario": "GET /api/v1/scenarios/{name}",
    "get_health": "GET /healthz",
    "get_readiness": "GET /readyz",
    "get_version": "GET /version",
}


@pytest.fixture
def document(tmp_path: Path) -> dict[str, Any]:
    with idle_service(tmp_path) as (http, _):
        found: dict[str, Any] = http.get("/openapi.json").json()
    return found


def operations(document: dict[str, Any]) -> dict[str, tuple[str, dict[str, Any]]]:
    return {
        operation["operationId"]: (f"{method.upper()} {path}", operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    }


def test_operation_ids_are_frozen(document: dict[str, Any]) -> None:
    assert {name: where for name, (where, _) in operations(document).items()} == OPERATIONS


def test_every_operation_says_what_it_does_and_every_error_is_a_problem(document: dict[str, Any]) -> None:
    for name, (_, operation) in operations(document).items():
        assert operation["summary"], name
        assert operation["description"], name
        for status, answer in operation["responses"].items():
            if status >= "400":
                assert list(answer["content"]) == ["application/problem+json"], (name, status)


def test_every_reference_leads_somewhere_and_the_request_has_examples(document: dict[str, Any]) -> None:
    text = json.dumps(document)
    schemas = document["components"]["schemas"]
    for part in text.split('"$ref": "#/components/schemas/')[1:]:
        assert part.partition('"')[0] in schemas
    assert "HTTPValidationError" not in schemas
    assert len(schemas["JobRequest"]["examples"]) == 2
