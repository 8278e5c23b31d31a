from __future__ import annotations

import json
from importlib import import_module
from pkgutil import iter_modules
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from service.admission import campaign_planner, training_request
from service.api import schemas
from service.api.openapi_examples import EXAMPLES
from simcore.metric_definitions import METRICS
from simcore.rollout.result import Rollout
from simcore.scenario.scenario import Scenario
from tests.service.http import finish_training, idle_service
from tests.service.learned import dataset_bytes

if TYPE_CHECKING:
    from pathlib import Path

    from pydantic import BaseModel

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
    "edit_job": "PATCH /api/v1/jobs/{job_id}",
    "act_on_jobs": "POST /api/v1/jobs/actions",
    "delete_job": "DELETE /api/v1/jobs/{job_id}",
    "get_metrics": "GET /api/v1/jobs/{job_id}/metrics",
    "get_series": "GET /api/v1/jobs/{job_id}/series",
    "list_artefacts": "GET /api/v1/jobs/{job_id}/artefacts",
    "get_job_zip": "GET /api/v1/jobs/{job_id}/zip",
    "get_log": "GET /api/v1/jobs/{job_id}/log",
    "get_artefact": "GET /api/v1/jobs/{job_id}/artefacts/{name}",
    "get_recording": "GET /recordings/{job_id}.rrd",
    "create_upload": "POST /api/v1/uploads",
    "list_uploads": "GET /api/v1/uploads",
    "get_upload": "GET /api/v1/uploads/{upload_id}",
    "get_upload_content": "GET /api/v1/uploads/{upload_id}/content",
    "delete_upload": "DELETE /api/v1/uploads/{upload_id}",
    "pin_upload": "POST /api/v1/uploads/{upload_id}/pin",
    "unpin_upload": "DELETE /api/v1/uploads/{upload_id}/pin",
    "list_models": "GET /api/v1/models",
    "train_model": "POST /api/v1/models/train",
    "get_model": "GET /api/v1/models/{model_id}",
    "get_model_content": "GET /api/v1/models/{model_id}/content",
    "list_controllers": "GET /api/v1/controllers",
    "list_keys": "GET /api/v1/keys",
    "create_key": "POST /api/v1/keys",
    "get_key": "GET /api/v1/keys/{key_id}",
    "revoke_key": "DELETE /api/v1/keys/{key_id}",
    "list_suites": "GET /api/v1/suites",
    "create_campaign": "POST /api/v1/campaigns",
    "list_campaigns": "GET /api/v1/campaigns",
    "get_campaign": "GET /api/v1/campaigns/{campaign_id}",
    "cancel_campaign": "POST /api/v1/campaigns/{campaign_id}/cancel",
    "delete_campaign": "DELETE /api/v1/campaigns/{campaign_id}",
    "list_campaign_jobs": "GET /api/v1/campaigns/{campaign_id}/jobs",
    "get_campaign_results": "GET /api/v1/campaigns/{campaign_id}/results",
    "get_campaign_report": "GET /api/v1/campaigns/{campaign_id}/report",
    "compare_campaigns": "POST /api/v1/comparisons",
    "list_trends": "GET /api/v1/trends",
    "get_trend": "GET /api/v1/trends/{suite}",
    "create_schedule": "POST /api/v1/schedules",
    "list_schedules": "GET /api/v1/schedules",
    "preview_cron": "GET /api/v1/schedules/preview",
    "get_schedule": "GET /api/v1/schedules/{schedule_id}",
    "change_schedule": "PATCH /api/v1/schedules/{schedule_id}",
    "delete_schedule": "DELETE /api/v1/schedules/{schedule_id}",
    "trigger_schedule": "POST /api/v1/schedules/{schedule_id}/trigger",
    "list_schedule_runs": "GET /api/v1/schedules/{schedule_id}/runs",
    "list_scenarios": "GET /api/v1/scenarios",
    "get_scenario": "GET /api/v1/scenarios/{name}",
    "clear_jobs": "POST /api/v1/gc",
    "get_monitoring": "GET /metrics",
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


@pytest.mark.slow
def test_operation_ids_are_frozen(document: dict[str, Any]) -> None:
    assert {name: where for name, (where, _) in operations(document).items()} == OPERATIONS


@pytest.mark.slow
def test_every_operation_says_what_it_does_and_every_error_is_a_problem(document: dict[str, Any]) -> None:
    for name, (_, operation) in operations(document).items():
        assert operation["summary"], name
        assert operation["description"], name
        for status, answer in operation["responses"].items():
            if status >= "400":
                assert list(answer["content"]) == ["application/problem+json"], (name, status)


@pytest.mark.slow
def test_every_reference_leads_somewhere_and_the_request_has_examples(document: dict[str, Any]) -> None:
    text = json.dumps(document)
    schemas = document["components"]["schemas"]
    for part in text.split('"$ref": "#/components/schemas/')[1:]:
        assert part.partition('"')[0] in schemas
    assert "HTTPValidationError" not in schemas
    assert len(schemas["JobRequest"]["examples"]) == 2
    assert len(schemas["TrainRequest"]["examples"]) == 2


_IN_ITS_ROOM = [import_module(f"{schemas.__name__}.{one.name}") for one in iter_modules(schemas.__path__)]
MODELS = (campaign_planner, training_request, *_IN_ITS_ROOM)


def model_of(name: str) -> type[BaseModel]:
    """The class behind a schema of the document."""
    found: type[BaseModel] = next(vars(module)[name] for module in MODELS if name in vars(module))
    return found


@pytest.mark.slow
def test_every_body_has_examples_and_every_example_is_one(document: dict[str, Any]) -> None:
    components = document["components"]["schemas"]
    for name, (_, operation) in operations(document).items():
        body = operation.get("requestBody", {}).get("content", {}).get("application/json")
        if body is not None:
            assert components[body["schema"]["$ref"].rpartition("/")[2]]["examples"], name
    for name, schema in components.items():
        for example in schema.get("examples", ()):
            model_of(name).model_validate(example)
    assert EXAMPLES.keys() <= components.keys()
    for name, example in EXAMPLES.items():
        assert set(example) == set(components[name]["properties"]), name


@pytest.mark.slow
def test_every_operation_names_its_scope(document: dict[str, Any]) -> None:
    for name, (where, operation) in operations(document).items():
        scopes = {scope for option in operation["security"] for found in option.values() for scope in found}
        if where.endswith(("/healthz", "/readyz")):
            assert scopes == set(), name
        elif "/keys" in where:
            assert scopes == {"admin"}, name
        elif where.startswith("GET"):
            assert scopes == {"read"}, name
        else:
            assert scopes <= {"submit", "admin"}, name
            assert len(scopes) == 1, name
        assert not any(field.startswith("x-") for field in operation), name
    assert set(document["components"]["securitySchemes"]) == {"key", "login"}


@pytest.mark.slow
def test_every_operation_tells_its_refusals(document: dict[str, Any]) -> None:
    for name, (where, operation) in operations(document).items():
        if "/api/" in where:
            assert {"401", "403", "421", "422", "429"} <= set(operation["responses"]), name


def component(document: dict[str, Any], reference: dict[str, str]) -> dict[str, Any]:
    found: dict[str, Any] = document["components"]["schemas"][reference["$ref"].rpartition("/")[2]]
    return found


def alternatives(document: dict[str, Any], holder: str, name: str) -> list[str]:
    allowed = document["components"]["schemas"][holder]["properties"][name]["anyOf"]
    return [one["$ref"].rpartition("/")[2] if "$ref" in one else one["type"] for one in allowed]


def test_results_and_metrics_of_jobs_are_described(document: dict[str, Any]) -> None:
    assert alternatives(document, "JobView", "result") == ["InsertionResult", "TrainingResult", "null"]
    assert alternatives(document, "JobView", "scenario") == ["Scenario", "null"]
    for holder in ("JobView", "JobSummary"):
        assert alternatives(document, holder, "metrics") == ["Metrics", "TrainingMetrics", "null"]
    assert alternatives(document, "MetricsView", "metrics") == ["Metrics", "TrainingMetrics"]
    assert alternatives(document, "MetricsView", "timing") == ["Timing", "TrainingTiming", "null"]


def test_every_metric_is_in_the_schema_with_unit_range_and_null(document: dict[str, Any]) -> None:
    for metric in METRICS:
        part, *names = metric.key.split(".")
        schema = component(document, document["components"]["schemas"]["InsertionResult"]["properties"][part])
        for name in names[:-1]:
            schema = schema["properties"][name]["anyOf"][0]
        told = schema["properties"][names[-1]]
        assert told["x-unit"] == metric.unit
        assert told["x-sane-range"].get("minimum") == metric.low
        assert told["x-sane-range"].get("maximum") == metric.high
        assert {"type": "null"} in told["anyOf"]


@pytest.mark.slow
def test_a_result_has_the_parts_that_its_schema_names(document: dict[str, Any], tmp_path: Path) -> None:
    scenario = Scenario.load("demo")
    parts = ("status", "message", "metrics", "timing", "solver", "held", "digest")
    run: Any = SimpleNamespace(scenario=scenario, warnings=[], **{part: {} for part in parts})
    schemas_of = document["components"]["schemas"]
    assert set(Rollout.result(run)) == set(schemas_of["InsertionResult"]["properties"])
    with idle_service(tmp_path / "training") as (http, service):
        sent = http.post("/api/v1/uploads", params={"kind": "dataset", "name": "d.npz"}, content=dataset_bytes()).json()
        asked = http.post("/api/v1/models/train", json={"data": sent["reference"], "kind": "linear"})
        finish_training(service)
        result = http.get(asked.headers["location"]).json()["result"]
    assert set(result) == set(schemas_of["TrainingResult"]["properties"])
    for part, name in (("metrics", "TrainingMetrics"), ("timing", "TrainingTiming")):
        assert set(result[part]) == set(schemas_of[name]["properties"])
