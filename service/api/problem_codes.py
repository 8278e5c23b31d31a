"""The kinds of problems: each has a code that stays, so that clients need not read sentences, and one HTTP status."""

from __future__ import annotations

# code -> (status, what it means); `docs/http_api.md` shows the table
CODES: dict[str, tuple[int, str]] = {
    "bad-request": (400, "the request cannot be read"),
    "bad-host": (400, "the request has no Host header, more than one, or one that is no host"),
    "body-incomplete": (400, "the body ended early"),
    "json-invalid": (400, "the body is not JSON"),
    "key-missing": (401, "the key is missing, unknown or revoked"),
    "account-unknown": (401, "it cannot be told which account of this machine is asking"),
    "scope-missing": (403, "the scope of the key does not cover this"),
    "account-foreign": (403, "another account of this machine runs this service, and it has no keys"),
    "origin-foreign": (403, "a page from another origin sent the request"),
    "not-found": (404, "there is nothing at this address"),
    "job-unknown": (404, "there is no such job"),
    "campaign-unknown": (404, "there is no such campaign"),
    "schedule-unknown": (404, "there is no such schedule"),
    "upload-unknown": (404, "there is no such upload"),
    "model-unknown": (404, "there is no such model"),
    "key-unknown": (404, "there is no such key"),
    "result-absent": (404, "the job has no such result or file, and will have none"),
    "file-missing": (404, "the file is no longer in the data folder"),
    "method-not-allowed": (405, "the address does not take this method; Allow names those that it takes"),
    "request-timeout": (408, "the request did not arrive in time"),
    "job-state": (409, "the state of the job does not allow this"),
    "job-pinned": (409, "the job is pinned"),
    "job-input-gone": (409, "an upload that the job names was deleted"),
    "campaign-state": (409, "the campaign, or a job of it, is not at its end"),
    "campaign-pinned": (409, "a job of the campaign is pinned"),
    "schedule-exists": (409, "another schedule has this name"),
    "upload-in-use": (409, "the upload is pinned, or a job that has not ended names it"),
    "first-key": (409, "the first key is created on the command line"),
    "result-pending": (409, "the job has no result yet"),
    "file-damaged": (410, "the file was changed since it was written: it is not what its digest says"),
    "version-changed": (412, "it was changed since it was read"),
    "body-too-long": (413, "the body is too long"),
    "address-too-long": (414, "the address is too long"),
    "body-type": (415, "the type of the body is not supported"),
    "body-encoding": (415, "compressed bodies are not taken"),
    "range-unsatisfiable": (416, "the file has no such bytes"),
    "host-foreign": (421, "the request was meant for another host"),
    "invalid": (422, "a field is missing or out of its range"),
    "scenario-invalid": (422, "the scenario cannot be run"),
    "upload-gone": (422, "an upload that is named was deleted meanwhile"),
    "upload-unusable": (422, "the content of the file does not match its kind"),
    "idempotency-key-reused": (422, "the idempotency key was used with another request"),
    "rate-exceeded": (429, "too many requests with this key"),
    "queue-full": (429, "too many queued jobs"),
    "headers-too-long": (431, "the headers are too long"),
    "internal": (500, "an error of the service; its log has the details"),
    "transfer-coding": (501, "the body is sent in a transfer coding other than chunked"),
    "unavailable": (503, "not available now"),
    "busy": (503, "too many connections, large requests or checks of meshes at once"),
    "closing": (503, "the service is shutting down"),
    "not-ready": (503, "the service cannot run jobs; `checks` says why"),
    "database-unavailable": (503, "the database cannot be used now; nothing was changed"),
    "disk-full": (507, "the disk of the service is full"),
    "uploads-full": (507, "there is no space for more uploads"),
}

_GENERAL = {
    400: "bad-request",
    401: "key-missing",
    403: "scope-missing",
    404: "not-found",
    405: "method-not-allowed",
    408: "request-timeout",
    412: "version-changed",
    413: "body-too-long",
    414: "address-too-long",
    415: "body-type",
    416: "range-unsatisfiable",
    421: "host-foreign",
    422: "invalid",
    431: "headers-too-long",
    500: "internal",
    501: "transfer-coding",
    503: "unavailable",
    507: "disk-full",
}


def code_of(status: int, code: str | None) -> str:
    """The code given, or that of a problem of which only the status is known. Raises ValueError when they disagree."""
    chosen = code or _GENERAL.get(status, "bad-request")
    if code is not None and CODES[code][0] != status:
        raise ValueError(f"a problem {code} has the status {CODES[code][0]}, not {status}")
    return chosen
