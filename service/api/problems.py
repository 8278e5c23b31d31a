"""Every error of the HTTP surface in one shape: RFC 9457 problem details."""

from __future__ import annotations

import http
import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Match

from service.access import ForbiddenError
from service.admission.admission import AdmissionBusyError
from service.api.json_bodies import faults_of
from service.api.problem_codes import CODES, code_of
from service.files.disk import REFUSALS
from service.files.intact import DamagedFileError
from service.store.campaign import CampaignActiveError, CampaignPinnedError, UnknownCampaignError
from service.store.errors import OperationalError
from service.store.job import (
    IllegalTransitionError,
    InputGoneError,
    JobChangedError,
    JobPinnedError,
    KeyReusedError,
    QueueFullError,
    UnknownJobError,
    UploadGoneError,
)
from service.store.job_lists import CursorError
from service.store.keys import UnknownKeyError
from service.store.models import UnknownModelError
from service.store.schedule import ScheduleChangedError, ScheduleExistsError, UnknownScheduleError
from service.store.uploads import UnknownUploadError, UploadInUseError, UploadsFullError
from simcore.errors import Problem, ScenarioError

Handler = Callable[[Request, Exception], Response]

MEDIA_TYPE = "application/problem+json"
_NO_PAGES = ("/api/", "/recordings/", "/static/", "/viewer/")
_SHOWN = 200  # characters of an offending value that are echoed
_MOST_ERRORS = 50  # that are told one by one
_MOST_DETAIL, _MOST_MESSAGE = 5000, 2000  # characters
CODE_OF: dict[type[Exception], str] = {  # of errors whose own message is the detail
    ForbiddenError: "scope-missing",
    UnknownCampaignError: "campaign-unknown",
    UnknownJobError: "job-unknown",
    UnknownKeyError: "key-unknown",
    UnknownModelError: "model-unknown",
    UnknownScheduleError: "schedule-unknown",
    UnknownUploadError: "upload-unknown",
    CampaignActiveError: "campaign-state",
    CampaignPinnedError: "campaign-pinned",
    CursorError: "invalid",
    IllegalTransitionError: "job-state",
    InputGoneError: "job-input-gone",
    JobChangedError: "version-changed",
    JobPinnedError: "job-pinned",
    ScheduleExistsError: "schedule-exists",
    UploadInUseError: "upload-in-use",
    ScheduleChangedError: "version-changed",
    UploadGoneError: "upload-gone",
    UploadsFullError: "uploads-full",
    DamagedFileError: "file-damaged",
}


class HttpError(Exception):
    """An error response, raised by a route; `errors` names each wrong field, its value and the allowed range.

    code: of `CODES`, None = the general one of the status.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        errors: list[Problem] | None = None,
        headers: Mapping[str, str] | None = None,
        more: Mapping[str, Any] | None = None,
        code: str | None = None,
    ) -> None:
        self.status, self.detail, self.errors, self.headers, self.more = status, detail, errors, headers, more
        self.code = code_of(status, code)
        super().__init__(detail)


def problem_response(
    status: int,
    detail: str,
    *,
    instance: str | None = None,
    errors: list[Problem] | None = None,
    headers: Mapping[str, str] | None = None,
    more: Mapping[str, Any] | None = None,
    code: str | None = None,
) -> Response:
    """The response of an error, with `more` members; code: of `CODES`, None = the general one of the status.

    ASCII only, so that no malformed text of a request breaks it.
    """
    body: dict[str, Any] = {
        "type": "about:blank",
        "title": _title(status),
        "status": status,
        "code": code_of(status, code),
        "detail": detail if len(detail) <= _MOST_DETAIL else f"{detail[:_MOST_DETAIL]}...",
    }
    if instance is not None:
        body["instance"] = instance
    if errors is not None:
        body["errors"] = [
            {"field": item.field[:_SHOWN], "value": echoed(item.value), "message": item.message[:_MOST_MESSAGE]}
            for item in errors[:_MOST_ERRORS]
        ]
    body |= more or {}
    content = json.dumps(body, allow_nan=False)
    return Response(content, status_code=status, media_type=MEDIA_TYPE, headers=dict(headers or {}))


def echoed(value: Any) -> Any:
    """A value fit to be echoed: JSON, finite, and cut when it is long."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    if isinstance(value, int | float):
        return value if abs(value) < 1e300 else repr(value)[:_SHOWN]
    text = value if isinstance(value, str) else _json(value)
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def _json(value: Any) -> str:
    try:
        return json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        return type(value).__name__


def _title(status: int) -> str:
    return http.HTTPStatus(status).phrase if status in {one.value for one in http.HTTPStatus} else "Error"


def install(app: FastAPI, *, page: Callable[[Request, int, str, str], Response] | None = None) -> None:
    """Map every exception, the framework's own included, to a problem.

    page: renders (request, status, title, detail) for a browser that asked for a page.
    """
    app.state.problem_page = page
    for error, code in CODE_OF.items():
        app.add_exception_handler(error, _handler_of(code))
    for error, handler in _HANDLERS.items():
        app.add_exception_handler(error, handler)


def _handler_of(code: str) -> Handler:
    def handler(request: Request, error: Exception) -> Response:
        fields = getattr(error, "problems", None)
        return _reply(request, CODES[code][0], str(error), errors=fields, code=code)

    return handler


def _reply(request: Request, status: int, detail: str, **more: Any) -> Response:
    path = request.url.path
    page = getattr(request.app.state, "problem_page", None)
    if page is None or not _is_page(request.method, path, request.headers.get("accept", "")):
        return problem_response(status, detail, instance=path, **more)
    response: Response = page(request, status, _title(status), detail)
    response.headers.update(more.get("headers") or {})
    return response


def _is_page(method: str, path: str, accept: str) -> bool:
    """Whether a browser asks for a page."""
    return method == "GET" and "text/html" in accept and not path.startswith(_NO_PAGES)


def _on_http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HttpError)
    return _reply(
        request,
        error.status,
        error.detail,
        errors=error.errors,
        headers=error.headers,
        more=error.more,
        code=error.code,
    )


def _on_framework(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    detail = str(error.detail)
    if error.status_code == 404 and detail == "Not Found":
        detail = "there is nothing at this address"
    headers = dict(error.headers or {})
    if error.status_code == 405:
        detail = f"{request.method} is not allowed here"
        headers["Allow"] = ", ".join(_methods_at(request))
    return _reply(request, error.status_code, detail, headers=headers)


def _methods_at(request: Request) -> list[str]:
    """Every method that some route takes at this address: the framework names those of the first route alone."""
    methods: set[str] = set()
    for route in request.app.state.every_route:
        if route.matches(request.scope)[0] is not Match.NONE:
            methods |= set(getattr(route, "methods", None) or ())
    return sorted(methods | ({"HEAD"} if "GET" in methods else set()))


def _on_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    wrong = faults_of(request, error)
    broken = next((item for item in wrong if item["type"] == "json_invalid"), None)
    if broken is not None:
        reason = broken.get("ctx", {}).get("error", broken["msg"])
        return _reply(request, 400, f"the body is not JSON: {reason}", code="json-invalid")
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if any(item["loc"] == ("body",) for item in wrong) and not media_type.endswith("json"):
        return _reply(request, 415, f"the body must be application/json, not {media_type[:100] or 'untyped'}")
    errors = [Problem(_field(item["loc"]), item.get("input"), _message(item)) for item in wrong]
    return _reply(request, 422, "; ".join(f"{item.field}: {item.message}" for item in errors), errors=errors)


def _field(loc: tuple[Any, ...]) -> str:
    """Where a value stood: the name within the body, or the name of a parameter."""
    names = [str(part) for part in (loc[1:] if len(loc) > 1 else loc)]
    return ".".join(names)


def _message(item: Any) -> str:
    if item["type"] == "extra_forbidden":
        return "unknown field"
    return str(item["msg"]).replace("Input should", "should").removeprefix("Value error, ")


def _on_scenario(request: Request, error: Exception) -> Response:
    assert isinstance(error, ScenarioError)
    detail = "the scenario cannot be run: " + "; ".join(f"{p.field}: {p.message}" for p in error.problems)
    return _reply(request, 422, detail, errors=error.problems, code="scenario-invalid")


def _on_key(request: Request, error: Exception) -> Response:
    field = Problem("Idempotency-Key", request.headers.get("idempotency-key"), str(error))
    return _reply(request, 422, str(error), errors=[field], code="idempotency-key-reused")


def _on_full(request: Request, error: Exception) -> Response:
    return _reply(request, 429, f"{error}; try again later", headers={"Retry-After": "10"}, code="queue-full")


def _on_busy(request: Request, error: Exception) -> Response:
    return _reply(request, 503, str(error), headers={"Retry-After": "10"}, code="busy")


def database_refusal(request: Request, error: Exception) -> Response:
    """503 for a full disk, a locked database or a data folder that became read-only; nothing was changed."""
    assert isinstance(error, OperationalError)
    detail = f"the database cannot be used now: {error.orig}"
    return _reply(request, 503, detail, headers={"Retry-After": "10"}, code="database-unavailable")


def _on_disk(request: Request, error: Exception) -> Response:
    """A write that the disk refused is its state, not a fault of the service; anything else is."""
    assert isinstance(error, OSError)
    if error.errno not in REFUSALS:
        return _on_crash(request, error)
    detail = f"the disk of the service refuses: {error.strerror}; try again once it has room"
    return _reply(request, 507, detail, headers={"Retry-After": "60"}, code="disk-full")


def _on_crash(request: Request, _error: Exception) -> Response:
    return _reply(request, 500, "an internal error; the log of the service has the details")


_HANDLERS: dict[type[Exception], Handler] = {
    HttpError: _on_http_error,
    HTTPException: _on_framework,
    RequestValidationError: _on_request,
    ScenarioError: _on_scenario,
    KeyReusedError: _on_key,
    QueueFullError: _on_full,
    AdmissionBusyError: _on_busy,
    OperationalError: database_refusal,
    OSError: _on_disk,
    Exception: _on_crash,
}
