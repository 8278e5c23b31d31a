"""The OpenAPI document: the framework's, with the one error shape, the key and examples of answers added."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from service.access import SCOPE_FIELD, scope_of
from service.api.middleware.key_guard import COOKIE, OPEN_PATHS
from service.api.openapi_examples import EXAMPLES
from service.api.schemas.jobs import ProblemDetails


def document_of(app: FastAPI) -> Callable[[], dict[str, Any]]:
    """What `app.openapi` is to be: made once, then kept."""
    kept: dict[str, Any] = {}

    def document() -> dict[str, Any]:
        if not kept:
            kept.update(_made(app))
        return kept

    return document


def _made(app: FastAPI) -> dict[str, Any]:
    made = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
    problem = ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
    components = made.setdefault("components", {})
    components.setdefault("schemas", {}).update({**problem.pop("$defs", {}), ProblemDetails.__name__: problem})
    for name, example in EXAMPLES.items():
        components["schemas"][name].setdefault("examples", [example])
    components["securitySchemes"] = {
        "key": {"type": "http", "scheme": "bearer", "description": "An API key, made by `needlebench key create`."},
        "login": {"type": "apiKey", "in": "cookie", "name": COOKIE, "description": "Set by POST /login."},
    }
    for path, methods in made["paths"].items():
        for method, operation in methods.items():
            operation["security"] = _security(path, method.upper(), operation)
    return made


def _security(path: str, method: str, operation: dict[str, Any]) -> list[dict[str, list[str]]]:
    """Nothing where no key is asked for, which is so on loopback until there is one; else a key of this scope."""
    scope = operation.pop(SCOPE_FIELD, scope_of(method))
    return [{}] if path in OPEN_PATHS else [{}, {"key": [scope]}, {"login": [scope]}]
