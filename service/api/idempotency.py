"""A request that is sent again gives the job of before: by its key, whose it is, and a digest of what was asked."""

from __future__ import annotations

import hashlib
from typing import Annotated

from fastapi import Header

IdempotencyKey = Annotated[
    str | None,
    Header(min_length=1, max_length=200, description="The same key and request give the same job again."),
]


def own_key(idempotency_key: str | None, owner: str | None) -> str | None:
    """Two API keys may use the same idempotency key for jobs of their own."""
    if idempotency_key is None or owner is None:
        return idempotency_key
    return f"{owner}/{hashlib.sha256(idempotency_key.encode()).hexdigest()}"
