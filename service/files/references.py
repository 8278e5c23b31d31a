"""Which uploads a specification names, and in which fields."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from service.files.upload_names import SCHEME, UPLOAD_ID

_REFERENCE = re.compile(f"{SCHEME}({UPLOAD_ID})")


def references(value: Any, field: str = "") -> Iterator[tuple[str, str]]:
    """(field, id of the upload) of each that the JSON data names, fields written as in tissue.mesh_file."""
    if isinstance(value, str):
        if (match := _REFERENCE.fullmatch(value)) is not None:
            yield field, match[1]
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from references(item, f"{field}.{name}" if field else str(name))
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from references(item, f"{field}[{number}]")
