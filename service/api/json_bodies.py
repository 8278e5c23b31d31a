"""Bodies of JSON are read and checked in a thread: a large one is not to hold up those who ask for something else."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

MOST_FAULTS = 50  # that an answer tells of
_AT_ONCE = 2048  # bytes of a body that cost less than the way into a thread


# What stands in the place of a body that is not what its route takes, until permissions and parameters are checked too.
# An object of a class of ours would not do: the framework reads those field by field, and all may be optional.
_REFUSED = ...
_FAULTS = "needlebench.faults"  # of the body, in the scope of its request


class JsonBodyRoute(APIRoute):
    """A route whose body the framework gets checked: parsing and validation happen in a thread."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The framework's, with a request that reads its body so."""
        handler, field = super().get_route_handler(), self.body_field
        if field is None:
            return handler

        async def handle(request: Request) -> Response:
            return await handler(_JsonRequest(request, field))

        return handle


class _JsonRequest(Request):
    def __init__(self, request: Request, field: Any) -> None:
        super().__init__(request.scope, request.receive)
        self._field = field

    async def json(self) -> Any:
        """The checked body, or what no route takes, its faults in the scope. Raises json.JSONDecodeError."""
        body = await self.body()
        if len(body) <= _AT_ONCE:
            checked, faults = _checked(body, self._field)
        else:
            checked, faults = await run_in_threadpool(_checked, body, self._field)
        self.scope[_FAULTS] = faults
        return _REFUSED if faults else checked


def _checked(body: bytes, field: Any) -> tuple[Any, list[dict[str, Any]]]:
    """The body, and what is wrong with it as pydantic tells it."""
    try:
        value = json.loads(body.decode("utf-8-sig"))
    except json.JSONDecodeError:
        raise
    except RecursionError:
        raise json.JSONDecodeError("it is nested too deep", "", 0) from None
    except UnicodeDecodeError:
        raise json.JSONDecodeError("it must be UTF-8", "", 0) from None
    except ValueError as error:  # an integer of thousands of digits
        raise json.JSONDecodeError(str(error)[:200], "", 0) from None
    checked, faults = field.validate(value, {}, loc=("body",))
    if not faults:
        return checked, []
    told = [{**fault, "loc": _short(fault["loc"])} for fault in faults[:MOST_FAULTS]]
    if len(faults) > MOST_FAULTS:
        more = len(faults) - MOST_FAULTS
        told.append({"type": "too_many", "loc": ("body",), "msg": f"has {more} more faults", "input": None})
    return None, told


def _short(place: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(part if isinstance(part, int) else str(part)[:100] for part in place)


def faults_of(request: Request, error: RequestValidationError) -> list[dict[str, Any]]:
    """What is wrong with a request: its parameters, and what was found in its body."""
    parameters = [fault for fault in error.errors() if fault.get("input") is not _REFUSED]
    return [*parameters, *request.scope.get(_FAULTS, [])]
