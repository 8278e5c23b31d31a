"""JSON with one spelling (RFC 8785), so that a digest of it is a digest of what it says."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import rfc8785

from simcore.errors import NeedlebenchError


class BundleError(NeedlebenchError, ValueError):
    """A file that is no bundle, a bundle that was changed, or one that cannot be made; the message says why."""


def canonical(value: Any) -> bytes:
    """The one spelling of JSON data. Raises BundleError for what it has none for, such as NaN or 2^53."""
    try:
        return rfc8785.dumps(value)
    except (rfc8785.CanonicalizationError, RecursionError) as error:
        raise BundleError(f"cannot be written as canonical JSON: {error}") from None


def read_canonical(data: bytes, name: str) -> Any:
    """The data that a canonical text says. name: of its file. Raises BundleError for any other text."""
    try:
        value = json.loads(data)
        same = canonical(value) == data
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{name} is not readable JSON: {str(error)[:200]}") from None
    if not same:
        raise BundleError(f"{name} is not canonical JSON (RFC 8785): it was changed, or written by something else")
    return value


def digest_of(value: Any) -> str:
    """SHA-256 of the canonical text."""
    return hashlib.sha256(canonical(value)).hexdigest()
