"""The API document as a page: every operation with its parameters, bodies and answers; loads nothing from elsewhere."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

from fastapi import APIRouter, Request, Response

from service.web.site import page

router = APIRouter(include_in_schema=False)

_METHODS = ("get", "post", "put", "patch", "delete")


class Parameter(NamedTuple):
    """One parameter of an operation, or one field of a body."""

    name: str
    place: str
    kind: str
    text: str
    required: bool


class Operation(NamedTuple):
    """What one method does at one address. answers: (status, text). example: of its body, as JSON."""

    id: str
    method: str
    path: str
    summary: str
    text: str
    parameters: list[Parameter]
    body: list[Parameter]
    example: str
    answers: list[tuple[str, str]]


@router.get("/docs")
def get_docs(request: Request) -> Response:
    """Every operation, by its tag."""
    document = request.app.openapi()
    groups: dict[str, list[Operation]] = {}
    for tag, operation in operations(document):
        groups.setdefault(tag, []).append(operation)
    return page(request, "api.html", info=document["info"], groups=groups)


def operations(document: dict[str, Any]) -> Iterator[tuple[str, Operation]]:
    """Those of an OpenAPI document in its order, each with its first tag."""
    for path, methods in document["paths"].items():
        for method in _METHODS:
            if (one := methods.get(method)) is not None:
                body = one.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
                yield (
                    (one.get("tags") or ["other"])[0],
                    Operation(
                        id=one["operationId"],
                        method=method.upper(),
                        path=path,
                        summary=one.get("summary", ""),
                        text=one.get("description", ""),
                        parameters=[_parameter(document, given) for given in one.get("parameters", ())],
                        body=list(_fields(document, body)),
                        example=_example(document, body),
                        answers=[(code, told.get("description", "")) for code, told in one["responses"].items()],
                    ),
                )


def _resolved(document: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """What a reference within the document leads to."""
    while "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return schema


def _parameter(document: dict[str, Any], given: dict[str, Any]) -> Parameter:
    schema = given.get("schema", {})
    text = given.get("description") or schema.get("description", "")
    return Parameter(given["name"], given["in"], kind_of(document, schema), text, given.get("required", False))


def _fields(document: dict[str, Any], schema: dict[str, Any]) -> Iterator[Parameter]:
    whole = _resolved(document, schema)
    for name, field in whole.get("properties", {}).items():
        text = field.get("description") or _resolved(document, field).get("description", "")
        yield Parameter(name, "body", kind_of(document, field), text, name in whole.get("required", ()))


def kind_of(document: dict[str, Any], schema: dict[str, Any]) -> str:
    """The type of a schema in a few words, as in "number or null", "list of text", "one of done, running"."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if choices := schema.get("anyOf") or schema.get("oneOf"):
        return " or ".join(dict.fromkeys(kind_of(document, one) for one in choices))
    if values := schema.get("enum"):
        return "one of " + ", ".join(str(value) for value in values)
    kind = schema.get("type", "anything")
    if kind == "array":
        return f"list of {kind_of(document, schema.get('items', {}))}"
    return {"string": "text", "integer": "whole number", "boolean": "true or false"}.get(str(kind), str(kind))


def _example(document: dict[str, Any], schema: dict[str, Any]) -> str:
    examples = _resolved(document, schema).get("examples") or ()
    return json.dumps(examples[0], indent=2, ensure_ascii=False) if examples else ""
