"""The cases of a grid over two fields as a table of shaded cells, each with its value and the way to its job."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.grid.names import label, value_names
from service.campaigns.cases import MEASURES
from service.web.formatting import number, state
from service.web.pictures.scale import Scale, measured

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from service.campaigns.cases import CaseResult

WIDEST = 40  # columns of a table that can still be read
LONGEST = 200  # rows


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One case. shade: None where there is no value; the text then says why."""

    text: str
    shade: int | None
    case_id: str
    job_id: str | None


@dataclass(frozen=True, kw_only=True)
class Heatmap:
    """down, across: the fields. columns: names of the values across. rows: name of the value down, its cells, None
    where the grid has no case."""

    down: str
    across: str
    columns: list[str]
    rows: list[tuple[str, list[Cell | None]]]
    scale: Scale | None
    digits: int


def heatmap(cases: Sequence[CaseResult], axes: Mapping[str, Sequence[Any]], measure: str) -> Heatmap | None:
    """Of a grid over two fields with several values each; None of any other, and of one too large for a table.

    measure: name in `MEASURES`. The field with more values runs down.
    """
    varied = [path for path, values in axes.items() if len(values) > 1]
    if len(varied) != 2:
        return None
    across, down = sorted(varied, key=lambda path: len(axes[path]))
    if len(axes[across]) > WIDEST or len(axes[down]) > LONGEST:
        return None
    digits = MEASURES[measure].digits
    scale = Scale.of(value for case in cases if (value := measured(case, measure)) is not None)
    placed = {
        (case.labels.get(down), case.labels.get(across)): _cell(case, measured(case, measure), scale, digits)
        for case in cases
    }
    columns = [label(value) for value in axes[across]]
    rows = [
        (name, [placed.get((label(value), column)) for column in columns])
        for name, value in zip(names(down, axes[down]), axes[down], strict=True)
    ]
    return Heatmap(down=down, across=across, columns=names(across, axes[across]), rows=rows, scale=scale, digits=digits)


def names(path: str, values: Sequence[Any]) -> list[str]:
    """Values of a field as people read them: blocks and lists by what sets them apart."""
    if any(isinstance(value, list | dict) for value in values):
        return value_names(path, values)
    return [str(value) for value in values]


def _cell(case: CaseResult, value: float | None, scale: Scale | None, digits: int) -> Cell:
    shade = None if scale is None or value is None else scale.shade(value)
    text = number(value, digits) if value is not None else state(case.outcome if case.status else case.state)
    return Cell(text=text, shade=shade, case_id=case.case_id, job_id=case.job_id)
