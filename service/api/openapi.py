"""The OpenAPI document: the framework's, with the one error shape, the key and examples of answers added."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from service.access import OPEN_PATHS, SESSION_COOKIE, scope_of
from service.api.openapi_components import add_components
from service.api.openapi_examples import EXAMPLES
from service.api.problems import MEDIA_TYPE
from service.api.schemas.problems import ProblemDetails

SCOPE_FIELD = "x-needlebench-scope"  # of an operation: the scope it needs beyond that of its method
_CAUSES = {
    400: "The request cannot be read.",
    401: "The key is missing or wrong.",
    403: "The scope of the key does not cover this, or a page from another origin sent the request.",
    404: "It does not exist.",
    409: "Its state does not allow this.",
    410: "The file was damaged since it was written.",
    412: "It was changed since it was read.",
    413: "The body is too long.",
    414: "The address is too long.",
    415: "The type of the body is not supported.",
    416: "The Range header asks for bytes that the file does not have.",
    421: "The Host header is not a name of this machine.",
    422: "A field is missing or out of its range; `errors` names field, value and range.",
    429: "Too many requests with this key, or too many queued jobs; Retry-After says when to try again.",
    431: "The headers are too long.",
    503: "Not available now; Retry-After says when to try again.",
    507: "There is no space for more uploads; delete some.",
}
_ANYWHERE = (401, 403, 414, 421, 422, 429, 431)


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI entries of the errors of a route, in their one shape."""
    schema = {"$ref": f"#/components/schemas/{ProblemDetails.__name__}"}
    content = {MEDIA_TYPE: {"schema": schema}}
    return {status: {"description": _CAUSES[status], "content": content} for status in sorted({*statuses, *_ANYWHERE})}


def document_builder(app: FastAPI) -> Callable[[], dict[str, Any]]:
    """What `app.openapi` becomes: the document, built on the first call."""
    kept: dict[str, Any] = {}

    def document() -> dict[str, Any]:
        if not kept:
            kept.update(_build(app))
        return kept

    return document


def _build(app: FastAPI) -> dict[str, Any]:
    built = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
    problem = ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
    components = built.setdefault("components", {})
    components.setdefault("schemas", {}).update({**problem.pop("$defs", {}), ProblemDetails.__name__: problem})
    add_components(components["schemas"])
    for name, example in EXAMPLES.items():
        components["schemas"][name].setdefault("examples", [example])
    components["securitySchemes"] = {
        "key": {"type": "http", "scheme": "bearer", "description": "An API key, created by `needlebench key create`."},
        "login": {"type": "apiKey", "in": "cookie", "name": SESSION_COOKIE, "description": "Set by POST /login."},
    }
    for path, methods in built["paths"].items():
        for method, operation in methods.items():
            operation["security"] = _security(path, method.upper(), operation)
    return built


def _security(path: str, method: str, operation: dict[str, Any]) -> list[dict[str, list[str]]]:
    """Nothing where no key is required, as on loopback until the first one exists; else a key of this scope."""
    scope = operation.pop(SCOPE_FIELD, scope_of(method))
    return [{}] if path in OPEN_PATHS else [{}, {"key": [scope]}, {"login": [scope]}]
