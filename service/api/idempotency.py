"""A request that is sent again returns the original job: by its key, its owner and a digest of the request."""

from __future__ import annotations

import hashlib
from typing import Annotated

from fastapi import Header

IdempotencyKey = Annotated[
    str | None,
    Header(min_length=1, max_length=200, description="The same key and request return the same job again."),
]


def own_key(idempotency_key: str | None, owner: str | None) -> str | None:
    """The idempotency key as stored: two API keys may use the same one for jobs of their own."""
    if idempotency_key is None or owner is None:
        return idempotency_key
    return f"{owner}/{hashlib.sha256(idempotency_key.encode()).hexdigest()}"
