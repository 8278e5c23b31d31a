"""The JSON of errors."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from service.api.problem_codes import CODES

_KNOWN: dict[str, Any] = {"enum": list(CODES)}


class FieldError(BaseModel):
    """One wrong field of a request."""

    field: str
    value: Any
    message: str


class ProblemDetails(BaseModel):
    """RFC 9457. `errors` is there when fields of the request are wrong."""

    type: str = "about:blank"
    title: str
    status: int
    code: str = Field(description="The kind of problem; it stays, sentences may change.", json_schema_extra=_KNOWN)
    detail: str
    instance: str | None = None
    errors: list[FieldError] | None = None
