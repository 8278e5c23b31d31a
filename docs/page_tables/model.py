"""What a scenario holds and what a result holds, from the models themselves."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, get_args

from pydantic import BaseModel

from page_tables.markdown import table
from simcore.errors import STATUSES
from simcore.metric_definitions import METRICS, SERIES
from simcore.rollout.digest import DIGESTED
from simcore.scenario.parameters import Parameter, parameters
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Iterator

TOP = "scenario"  # the fields that are in no block


def block_names() -> list[str]:
    """TOP and the blocks of a scenario, in the order of the model."""
    return [TOP, *(name for name in Scenario.model_fields if _blocks(name))]


def parameter_table(block: str) -> str:
    """The fields of one block; one table a kind where a block has kinds."""
    if block == TOP:
        return _fields(row for row in parameters() if "." not in row.path)
    kinds = _blocks(block)
    if not kinds:
        raise KeyError(block)
    if len(kinds) == 1:
        return _fields(parameters(kinds[0], f"{block}."))
    return "\n\n".join(_of_kind(block, kind) for kind in kinds)


def _of_kind(block: str, kind: type[BaseModel]) -> str:
    rows = [row for row in parameters(kind, f"{block}.") if row.path != f"{block}.kind"]
    head = f"**`{block}.kind = {kind.model_fields['kind'].default}`**. {inspect.getdoc(kind)}"
    return f"{head}\n\n{_fields(rows) if rows else 'It has no fields of its own.'}"


def _fields(rows: Iterator[Parameter] | list[Parameter]) -> str:
    once: dict[str, Parameter] = {}
    for row in rows:
        once.setdefault(row.path, row)  # the kinds of a nested block each name `kind`
    return table(
        ("field", "default", "what it is; range", "source"),
        (
            (f"`{row.path}`", f"`{row.default}`", row.text, row.source.replace("ours", "our choice"))
            for row in once.values()
        ),
    )


def _blocks(name: str) -> list[type[BaseModel]]:
    """The models that a field of the scenario can be."""
    info = Scenario.model_fields.get(name)
    if info is None:
        return []
    candidates = get_args(info.annotation) or (info.annotation,)
    return [found for found in candidates if isinstance(found, type) and issubclass(found, BaseModel)]


def metric_table(block: str) -> str:
    """The numbers in one block of result.json: metrics, timing or solver."""
    found = [metric for metric in METRICS if metric.key.split(".")[0] == block]
    if not found:
        raise KeyError(block)
    return table(
        ("key", "unit", "definition", "sane range", "outside it"),
        (
            (
                f"`{metric.key.removeprefix(f'{block}.')}`",
                metric.unit,
                metric.definition,
                metric.sane_range,
                metric.outside,
            )
            for metric in found
        ),
    )


def series_table() -> str:
    """The arrays of series.npz."""
    return table(
        ("array", "unit", "shape", "what it is", "digested"),
        (
            (f"`{array.name}`", array.unit, " × ".join(array.shape), array.definition, _digested(array.name))
            for array in SERIES
        ),
    )


def _digested(name: str) -> str:
    return "yes" if name in DIGESTED else "its last frame" if name == "tissue_m" else ""


def status_table() -> str:
    """How a run can end."""
    return table(("status", "meaning"), ((f"`{status}`", text) for status, text in STATUSES.items()))
