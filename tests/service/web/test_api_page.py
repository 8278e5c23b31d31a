"""The API document as a page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from service.web.api_page import kind_of, operations
from tests.service.http import idle_service

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        ({"type": "integer"}, "whole number"),
        ({"anyOf": [{"type": "number"}, {"type": "null"}]}, "number or null"),
        ({"type": "array", "items": {"$ref": "#/components/schemas/JobView"}}, "list of JobView"),
        ({"enum": ["done", "running"]}, "one of done, running"),
        ({}, "anything"),
    ],
)
def test_types_in_words(schema: dict[str, Any], words: str) -> None:
    assert kind_of({}, schema) == words


@pytest.mark.slow
def test_every_operation_of_the_document_is_on_the_page(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, _):
        document = http.get("/openapi.json").json()
        told = [operation for _, operation in operations(document)]
        text = http.get("/docs").text
    wanted = {
        one["operationId"] for methods in document["paths"].values() for one in methods.values() if "operationId" in one
    }
    assert {operation.id for operation in told} == wanted
    assert all(f'id="{operation.id}"' in text and operation.summary for operation in told)
    submit = next(operation for operation in told if operation.id == "submit_job")
    assert {"scenario", "priority", "timeout_s"} <= {field.name for field in submit.body}
    assert '"demo"' in submit.example
    assert "dry_run" in {one.name for one in submit.parameters}
