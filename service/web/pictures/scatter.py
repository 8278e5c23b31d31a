"""The cases of a campaign as points over two fields or measures; a third is their colour, and their shape or size."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from service.campaigns.cases import MEASURES
from service.web.pictures.frame import SHAPES, Ruler, Value, frame, rulers
from service.web.pictures.scale import Scale, measured

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.campaigns.cases import CaseResult

WIDTH, HEIGHT = 560, 360  # px
LISTED = 200  # points of the table below the picture


@dataclass(frozen=True, kw_only=True)
class Point:
    """One case. x, y, color: a number, or the text of a value that is none."""

    case_id: str
    job_id: str | None
    x: Value
    y: Value
    color: Value


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """x, y, color: what is shown. choices: what can be, name -> heading. left_out: cases that have no value.
    legend: class, SVG path and text of each mark."""

    x: str
    y: str
    color: str
    choices: dict[str, str]
    points: list[Point]
    left_out: int
    legend: list[tuple[str, str, str]]
    svg: Markup


def choices(cases: Sequence[CaseResult]) -> dict[str, str]:
    """Name -> heading: the labels in which the cases differ, then the measures."""
    seen: dict[str, set[str]] = {}
    for case in cases:
        for name, value in case.labels.items():
            seen.setdefault(name, set()).add(str(value))
    varied = {name: name.replace("_", " ") if "." not in name else name for name in seen if len(seen[name]) > 1}
    return {**varied, **{name: measure.heading for name, measure in MEASURES.items()}}


def scatter(cases: Sequence[CaseResult], *, x: str, y: str, color: str) -> Scatter | None:
    """The picture; a name that is no choice is replaced by the usual one. None without two cases that have values."""
    known = choices(cases)
    x, y, color = _chosen(cases, known, x, y, color)
    points = [
        Point(case_id=case.case_id, job_id=case.job_id, x=values[0], y=values[1], color=values[2])
        for case in cases
        if None not in (values := [_value(case, name) for name in (x, y, color)])
    ]
    if len(points) < 2:
        return None
    marks, legend = _marks([point.color for point in points])
    axes = rulers([point.x for point in points], [point.y for point in points], WIDTH, HEIGHT)
    headings = (known[x], known[y], known[color])
    return Scatter(
        x=x,
        y=y,
        color=color,
        choices=known,
        points=points,
        left_out=len(cases) - len(points),
        legend=legend,
        svg=_svg(points, marks, axes, headings),
    )


def _chosen(cases: Sequence[CaseResult], known: dict[str, str], x: str, y: str, color: str) -> tuple[str, str, str]:
    labels = [name for name in known if name not in MEASURES]
    fields = [name for name in labels if name not in ("arm", "controller.kind", "seed", "end_point")]
    counted = [name for name in fields if all(isinstance(case.labels.get(name), int | float) for case in cases)]
    x = x if x in known else next(iter(counted), "rcm")
    y = y if y in known else "rmse"
    spare = [name for name in ("arm", *fields, "push") if name in known and name not in (x, y)]
    return x, y, color if color in known else next(iter(spare), "rmse")


def _value(case: CaseResult, name: str) -> Any:
    if name in MEASURES:
        return measured(case, name)
    value = case.labels.get(name)
    return value if value is None or isinstance(value, int | float) else str(value)


def _marks(values: Sequence[Value]) -> tuple[list[tuple[str, str]], list[tuple[str, str, str]]]:
    """Class and path of each value's mark, and their legend."""
    if all(isinstance(value, int | float) for value in values) and len(set(values)) > len(SHAPES):
        scale = Scale.of(map(float, values))
        if scale is not None:
            shown = [f"{low:.3g} to {high:.3g}" for low, high in itertools.pairwise(scale.edges)]
            shades = [scale.shade(float(value)) for value in values]
            return [(f"heat-{i}", _disc(i)) for i in shades], [
                (f"heat-{i}", _disc(i), text) for i, text in enumerate(shown)
            ]
    number = {value: i for i, value in enumerate(sorted(set(values), key=str if _named(values) else float))}
    legend = [(f"dot-{i % len(SHAPES) + 1}", SHAPES[i % len(SHAPES)], _said(value)) for value, i in number.items()]
    return [legend[number[value]][:2] for value in values], legend


def _named(values: Sequence[Value]) -> bool:
    return any(isinstance(value, str) for value in values)


def _disc(shade: int) -> str:
    """Larger for a larger value, so that it is read without its colour."""
    r = 3.0 + 0.6 * shade
    return f"M{-r:.1f} 0a{r:.1f} {r:.1f} 0 1 0 {2 * r:.1f} 0a{r:.1f} {r:.1f} 0 1 0 {-2 * r:.1f} 0Z"


def _svg(
    points: Sequence[Point],
    marks: Sequence[tuple[str, str]],
    axes: tuple[Ruler, Ruler],
    headings: tuple[str, str, str],
) -> Markup:
    across, up = axes
    about = f"{len(points)} cases: {headings[1]} over {headings[0]}, coloured by {headings[2]}"
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(about)}">',
        *frame(across, up, headings[:2], WIDTH, HEIGHT),
    ]
    for point, (shade, path) in zip(points, marks, strict=True):
        where = f"translate({across.at(point.x):.1f} {up.at(point.y):.1f})"
        job = f' data-job="{escape(point.job_id)}"' if point.job_id else ""
        tip = escape(f"{point.case_id}: {', '.join(_said(value) for value in (point.x, point.y, point.color))}")
        parts.append(f'<path class="{shade}" d="{path}" transform="{where}"{job}><title>{tip}</title></path>')
    return Markup("\n".join([*parts, "</svg>"]))


def _said(value: Value) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
