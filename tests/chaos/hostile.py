"""Requests of every kind, for every route: what the OpenAPI document allows, what it forbids, and plain malice."""

from __future__ import annotations

import json
from typing import Any, cast
from urllib.parse import quote, urlencode

import requests
import schemathesis
from hypothesis import strategies as st
from schemathesis import Case, GenerationMode
from schemathesis.core.result import Ok

from tests.chaos.wire import Request
from tests.strategies import scenarios

IDS = {
    "job_id": "/api/v1/jobs", "campaign_id": "/api/v1/campaigns", "schedule_id": "/api/v1/schedules",
    "upload_id": "/api/v1/uploads", "key_id": "/api/v1/keys",
}  # fmt: skip
PAGES = (
    "/", "/submit", "/jobs/{job_id}", "/campaigns", "/campaigns/{campaign_id}", "/compare", "/schedules", "/trends",
    "/trends/{name}", "/viewer/", "/viewer/{name}", "/static/{name}", "/login", "/logout", "/openapi.json",
)  # fmt: skip
KNOWN = "~"  # in a path: an id that is there, put in by the one who asks

_SENT = ("method", "url", "params", "headers", "cookies", "data", "json", "files")
_ADDED = ("content-length", "user-agent")
_METHODS = ["GET", "GET", "GET", "HEAD", "POST", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "QUERY"]
_TOKEN = st.text("ABCDEFGHIJKLMNOPQRSTUVWXYZ-_!", min_size=1, max_size=20)
_WORDS = st.sampled_from(
    ["..", ".", "%00", "%2e%2e%2f", "%ff", "%", "%zz", "0", "-1", "null", "NaN", "1e999", "demo", "line", "index.html",
     "result.json", "series.npz", "job.log", "recording.rrd", "lin100-v2-smoke", "9" * 400, "a" * 33, "'", "%0d%0a",
     "\u00e4", "a,b,,c", "t_s,tip_m", "json", "csv", "npz", "queued", "running", "true", "[]", "*", "mesh", "model"]
)  # fmt: skip
_TARGET = st.text(st.characters(min_codepoint=0x21, max_codepoint=0x7E), max_size=40)
_TEXT = st.one_of(_WORDS, st.text(max_size=30))
_NAMES = st.sampled_from(
    ["limit", "cursor", "after", "wait", "format", "names", "state", "dry_run", "kind", "name", "next", "suite", "a",
     "campaign", "b", "controllers", "job", "again", "scenario", "url", "x"]
)  # fmt: skip
_HEADERS = st.sampled_from(
    ["Accept", "Range", "If-None-Match", "If-Match", "If-Range", "Last-Event-ID", "Cookie", "Authorization", "Origin",
     "Idempotency-Key", "Content-Type", "X-Request-Id", "Accept-Encoding", "Sec-Fetch-Site", "Expect",
     "X-Forwarded-For", "Content-Encoding", "Upgrade", "If-Modified-Since", "Accept-Language", "Host",
     "Transfer-Encoding"]
)  # fmt: skip
_VALUES = st.one_of(
    st.sampled_from(
        ["text/event-stream", "text/html", "*/*", "bytes=0-3", "bytes=-1", "bytes=5-1", "bytes=0-0,2-3", "bytes=a-b",
         "bytes=99999999999999999999-", '"1"', 'W/"1"', "*", "0", "9" * 30, "Bearer", "Bearer x", "Basic eDp4", "null",
         "needlebench_session=x", "application/json", "application/json; charset=utf-16", "multipart/form-data",
         "application/x-www-form-urlencoded", "application/octet-stream", "gzip", "websocket", "h2c", "cross-site",
         "http://127.0.0.1", "http://evil.example", "chunked", "100-continue", "x" * 5000, ""]
    ),
    st.text(st.characters(min_codepoint=0x21, max_codepoint=0xFF, exclude_characters="\x7f\x85\xa0"), max_size=40),
)  # fmt: skip
_TYPES = [(("Content-Type", "application/json"),)] * 3 + [()]
_MORE_HEADERS = st.lists(st.tuples(_HEADERS, _VALUES), max_size=3)
_LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20), st.integers(10**30, 10**31)
)
_JSON = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=12,
)
_DOCUMENTS: list[dict[str, Any]] = [
    {"scenario": "demo", "priority": 1, "timeout_s": 60},
    {"scenario": {"name": "s", "tissue": {"element_size_mm": 10, "young_kpa": 5}, "controller": {"kind": "ifem"}}},
    {"name": "g", "scenario": "line", "grid": {"dt_s": [0.01, 0.02], "tissue.young_kpa": [3.0]}},
    {"suite": "lin100-v2-smoke"},
    {"name": "n", "cron": "0 3 * * *", "timezone": "Europe/Berlin", "campaign": {"grid": {"seed": [1]}}},
    {"campaigns": ["a", "b"], "controllers": ["ifem", "elm"]},
    {"scope": "read", "note": "x"},
    {"older_than_s": 1e9, "keep_last": 1, "max_bytes": 1, "dry_run": False},
]  # fmt: skip


def allowed_and_forbidden(document: dict[str, Any]) -> st.SearchStrategy[Request]:
    """What schemathesis makes of the OpenAPI document, valid and invalid."""
    schema = schemathesis.openapi.from_dict(document)
    made = []
    for found in schema.get_all_operations():
        assert isinstance(found, Ok)
        operation = found.ok()
        made += [operation.as_strategy(generation_mode=mode) for mode in GenerationMode]
    known = st.booleans()
    return st.builds(_of_case, st.one_of(made), known)


def _of_case(case: Case[Any], known: bool) -> Request:
    for name in case.path_parameters if known else ():
        if name in IDS:
            case.path_parameters[name] = KNOWN
    options = case.as_transport_kwargs(base_url="http://127.0.0.1")
    ready = requests.Request(**{name: value for name, value in options.items() if name in _SENT}).prepare()
    body = ready.body.encode() if isinstance(ready.body, str) else cast("bytes | None", ready.body)
    headers = [(str(name), value) for name, value in ready.headers.items() if name.lower() not in _ADDED]
    texts = tuple((name, value if isinstance(value, str) else value.decode("latin-1")) for name, value in headers)
    return Request(ready.method or "GET", ready.path_url, texts, body)


def malicious(templates: list[str]) -> st.SearchStrategy[Request]:
    """Any method, odd paths, headers and bodies, for these routes."""
    return st.builds(
        Request,
        st.one_of(st.sampled_from(_METHODS), st.sampled_from(_METHODS), _TOKEN),
        st.builds(_target, st.sampled_from(templates), st.lists(_segment(), min_size=3, max_size=3), _queries()),
        st.builds(lambda own, more: (*own, *more), st.sampled_from(_TYPES), _MORE_HEADERS),
        st.one_of(st.none(), _bodies()),
    )


def _segment() -> st.SearchStrategy[str]:
    return st.one_of(
        st.just(KNOWN), st.just(KNOWN), _WORDS.map(_ascii), _TARGET.map(lambda text: text.replace("#", ""))
    )


def _ascii(text: str) -> str:
    return quote(text, safe="%/.,:*'[]")


def _target(template: str, values: list[str], query: str) -> str:
    for value in values:
        before, brace, rest = template.partition("{")
        if brace:
            template = before + value + rest.partition("}")[2]
    return template + query


def _queries() -> st.SearchStrategy[str]:
    pairs = st.lists(st.tuples(_NAMES, _TEXT), min_size=1, max_size=3).map(_query)
    return st.one_of(st.just(""), st.just(""), pairs, _TARGET.map(lambda text: "?" + text.replace("#", "")))


def _query(pairs: list[tuple[str, str]]) -> str:
    return "?" + urlencode([(name, value.encode("utf-8", "surrogatepass")) for name, value in pairs])


@st.composite
def _bodies(draw: st.DrawFn) -> bytes:
    document = draw(st.one_of(st.sampled_from(_DOCUMENTS), st.builds(lambda s: {"scenario": s}, scenarios())))
    way = draw(st.sampled_from(["whole", "changed", "changed", "any", "cut", "bytes"]))
    if way == "bytes":
        return draw(st.binary(max_size=200))
    if way == "any":
        return json.dumps(draw(_JSON)).encode()
    if way == "changed":
        document = draw(_changed(document))
    text = json.dumps(document).encode()
    return text[: draw(st.integers(0, len(text)))] if way == "cut" else text


@st.composite
def _changed(draw: st.DrawFn, document: Any) -> Any:
    """The document with one value of it replaced, somewhere down."""
    if not isinstance(document, dict) or not document or draw(st.integers(0, 3)) == 0:
        return draw(_JSON)
    name = draw(st.sampled_from(sorted(document)))
    return {**document, name: draw(_changed(document[name]))}
