"""Requests that are just within, at or just beyond a limit: of bodies, of headers, of addresses, of values."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import strategies as st

from service.api.json_bodies import _AT_ONCE
from service.api.middleware.body_limit import LARGE_BYTES
from service.api.middleware.host_guard import MAXIMUM_HEADER_BYTES, MAXIMUM_URL_BYTES
from service.server.uvicorn_overrides import MAXIMUM_OVERHEAD_BYTES
from service.settings import Limits
from tests.chaos.wire import Request

UPLOAD_MB = 0.3  # that the service of the test takes
_JSON = (("Content-Type", "application/json"),)
_SIZES = (_AT_ONCE, LARGE_BYTES, Limits().body_bytes)
_TARGETS = st.sampled_from(
    [("POST", f"/api/v1/{name}") for name in ("jobs", "jobs", "campaigns?dry_run=1", "schedules", "keys", "comparisons",
                                             "models/train", "gc")]
    + [("PATCH", "/api/v1/schedules/~"), ("POST", "/login")]
)  # fmt: skip
_SHAPES = (  # beginning, what is repeated, end
    (b'{"scenario": "line"', b" ", b"}"),
    (b'{"scenario": {"name": "', b"x", b'"}}'),
    (b'{"scenario": {"name": "', b"\\ud83d\\ude00", b'"}}'),
    (b'{"scenario": [', b"[],", b"[]]}"),
    (b'{"scenario": {"trajectory": {"poses": [', b"[0,0,0,1,0,0,0],", b"[0,0,0,1,0,0,0]]}}}"),
    (b'{"grid": {"seed": [', b"1,", b"1]}}"),
    (b'{"scenario": ', b"[", b"]}"),
    (b'{"scenario": {"dt_s": 0.', b"0", b"1}}"),
    (b'{"seed": ', b"9", b"}"),
    (b'{"campaigns": [', b'"a",', b'"b"], "arms": null}'),
    (b"{", b'"a": 1, ', b'"b": 2}'),
    (b"key=", b"%41", b""),
)
_OFFSETS = st.sampled_from([-2, -1, 0, 1, 2])
_VALUES: tuple[tuple[str, dict[str, Any]], ...] = tuple(
    [("jobs", {"scenario": {"name": "a" * n}}) for n in (1, 99, 100, 101)]
    + [("jobs", {"scenario": "line", "timeout_s": value}) for value in (0.999, 1, 86400, 86400.001)]
    + [("jobs", {"scenario": "line", "priority": value}) for value in (-101, -100, 100, 101, 2**62, 2**63)]
    + [("jobs", {"scenario": {"dt_s": value}}) for value in (1e-4, 9.9e-5, 0.1, 0.1001, 5e-324, 1.8e308)]
    + [("jobs", {"scenario": {"seed": value}}) for value in (-1, 0, 2**31, 2**32, 2**53, 2**63 - 1, 2**63, 2**64)]
    + [("jobs", {"scenario": {"tissue": {"element_size_mm": value}}}) for value in (0.5, 1, 1.5, 2, 50)]
    + [("campaigns?dry_run=1", {"grid": {"seed": list(range(count))}}) for count in (0, 1, 99, 100, 101, 5001)]
    + [("campaigns", {"name": "b" * n, "grid": {"seed": [0]}}) for n in (0, 100, 101)]
    + [("schedules", {"name": "c" * n, "cron": "0 0 30 2 *", "campaign": {"suite": "x"}}) for n in (100, 101)]
    + [("schedules", {"name": "d", "cron": "* " * n, "campaign": {"suite": "x"}}) for n in (4, 5, 6, 99, 100)]
    + [("schedules", {"name": "e", "cron": "0 0 * * *", "timezone": z}) for z in ("UTC", "../UTC", "/etc/passwd", "\0")]
    + [("keys", {"scope": "read", "note": "n" * n}) for n in (200, 201)]
)


def near_limits() -> st.SearchStrategy[Request]:
    """One of all kinds; bodies are the most of them."""
    bodies = st.builds(_sized, _TARGETS, st.sampled_from(_SIZES), _OFFSETS, st.sampled_from(_SHAPES))
    values = st.sampled_from(_VALUES).map(
        lambda found: Request("POST", f"/api/v1/{found[0]}", _JSON, json.dumps(found[1]).encode())
    )
    headers = st.builds(_wide, st.sampled_from([MAXIMUM_HEADER_BYTES, MAXIMUM_OVERHEAD_BYTES]), st.integers(-300, 300))
    addresses = st.builds(_long, st.integers(-60, 60), st.sampled_from(["/", "/api/v1/jobs/", "/api/v1/jobs?name="]))
    files = st.builds(_file, _OFFSETS, st.sampled_from([b"\x93NUMPY", b"{", b"PK\x03\x04"]))
    kinds = [bodies] * 10 + [values] * 6 + [headers, headers, addresses, files]
    return st.sampled_from(kinds).flatmap(lambda kind: kind)


def _sized(target: tuple[str, str], size: int, offset: int, shape: tuple[bytes, bytes, bytes]) -> Request:
    """A body of exactly so many bytes and `offset` more; what the filler leaves is blanks."""
    beginning, filler, end = shape
    times, rest = divmod(size + offset - len(beginning) - len(end), len(filler))
    method, path = target
    kind = (("Content-Type", "application/x-www-form-urlencoded"),) if path == "/login" else _JSON
    return Request(method, path, kind, beginning, (filler, times), end + b" " * rest)


def _wide(size: int, offset: int) -> Request:
    """Headers of about so many bytes, the others that there are included."""
    return Request("GET", "/api/v1/jobs", (("X-Wide", "w" * (size - 150 + offset)),))


def _long(offset: int, beginning: str) -> Request:
    return Request("GET", beginning + "p" * (MAXIMUM_URL_BYTES - len(beginning) + offset))


def _file(offset: int, beginning: bytes) -> Request:
    size = round(UPLOAD_MB * 1e6) + offset
    return Request("POST", "/api/v1/uploads?kind=poses&name=a.npy", (), beginning, (b"\0", size - len(beginning)))
