"""Every field of a scenario with default, range and source tag, for `scenario --fields` and the documentation."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from simcore.scenario.scenario import Scenario

_TAG = re.compile(r"\s*\[(paper|cited|ours)([^\]]*)\]")


class Parameter(NamedTuple):
    """One field: dotted path, default as JSON, what it is, where the default comes from."""

    path: str
    default: str
    text: str
    source: str


def parameters(model: type[BaseModel] = Scenario, prefix: str = "") -> Iterator[Parameter]:
    """All fields in the order of the model; of a union, the fields of every kind."""
    seen: set[Parameter] = set()
    for name, info in model.model_fields.items():
        path = prefix + (info.alias or name)
        blocks = _blocks(info)
        if not blocks:
            yield _parameter(path, info)
        for block in blocks:
            for row in parameters(block, f"{path}."):
                if row not in seen:
                    seen.add(row)
                    yield row


def _blocks(info: FieldInfo) -> list[type[BaseModel]]:
    candidates = get_args(info.annotation) or (info.annotation,)
    return [block for block in candidates if isinstance(block, type) and issubclass(block, BaseModel)]


def _parameter(path: str, info: FieldInfo) -> Parameter:
    description = info.description or ""
    sources = [" ".join(f"{tag}{rest}".split()) for tag, rest in _TAG.findall(description)]
    return Parameter(path, _shown(info), _TAG.sub("", description), "; ".join(sources))


def _shown(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    default: Any = info.default
    return json.dumps(default, default=list)


def markdown_table() -> str:
    """The table of the README; tags: paper = Perrusi et al. 2021, cited = a published source, ours = our choice."""
    lines = ["| field | default | what it is; range | source |", "| --- | --- | --- | --- |"]
    for row in parameters():
        source = row.source.replace("ours", "our choice")
        lines.append(f"| `{row.path}` | `{row.default}` | {row.text.replace('|', '/')} | {source} |")
    return "\n".join(lines)
