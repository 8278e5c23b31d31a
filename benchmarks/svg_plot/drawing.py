"""Panels drawn: bands, grid, curves with their shadows, boxes, a legend each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from benchmarks.svg_plot.axis import Axis, fitted_axis
from benchmarks.svg_plot.elements import COLOURS, GRID, INK, PALE, number, picture, text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.svg_plot.panel import BoxMark, Line, Panel

LEFT, RIGHT, TOP, BOTTOM = 68, 14, 34, 44  # px around the axes of a panel
LEGEND_ROW, GLYPH = 16, 6.1  # px: height of a row, mean width of a letter at size 11
HEAD = 34  # px above the panels for the title of the whole


def svg(
    panels: Sequence[Sequence[Panel]],
    *,
    title: str = "",
    width: int = 900,
    height: int = 420,
    name: str = "c",
    about: tuple[str, str] | None = None,
) -> str:
    """A picture of rows of panels, each `height` px high (legend included).

    name: begins the picture's ids, which must differ within a page. about: see `picture`.
    """
    head = HEAD if title else 0
    parts = [text(width / 2, 23, title, anchor="middle", size=15, weight=600)] if title else []
    for row, line in enumerate(panels):
        for column, panel in enumerate(line):
            share = width / len(line)
            parts.append(_panel(panel, column * share, head + row * height, share, height, f"{name}{row}-{column}"))
    return picture(parts, width=width, height=head + height * len(panels), name=name, about=about)


def _panel(panel: Panel, x0: float, y0: float, width: float, height: float, clip: str) -> str:
    labels = [label for label in [*(c.label for c in panel.lines), *(b.label for b in panel.bands)] if label]
    legend = _legend_rows(labels, width - LEFT - RIGHT)
    left, right = x0 + LEFT, x0 + width - RIGHT
    top, bottom = y0 + TOP, y0 + height - BOTTOM - LEGEND_ROW * len(legend)
    x_axis, y_axis = _axes(panel, (left, right), (bottom, top))
    parts = [
        text((left + right) / 2, y0 + 21, panel.title, anchor="middle", size=13, weight=600),
        *_bands(panel, x_axis, y_axis),
        *_grid(panel, x_axis, y_axis),
        f"<clipPath id='{clip}'><rect x='{left - 5:.1f}' y='{top - 5:.1f}' width='{right - left + 10:.1f}' "
        f"height='{bottom - top + 10:.1f}'/></clipPath><g clip-path='url(#{clip})'>",
        *(
            _line(line, x_axis, y_axis, colour % len(COLOURS))
            for line, colour in zip(panel.lines, panel.series(), strict=True)
        ),
        *(_box(box, x_axis, y_axis) for box in panel.boxes),
        "</g>",
        text((left + right) / 2, bottom + 32, panel.x_label, anchor="middle", fill=PALE),
        text(x0 + 15, (top + bottom) / 2, panel.y_label, anchor="middle", fill=PALE, turned=True),
        *_legend(panel, legend, left, bottom + BOTTOM + 6),
    ]
    return "\n".join(parts)


def _axes(panel: Panel, across: tuple[float, float], up: tuple[float, float]) -> tuple[Axis, Axis]:
    xs = [x for line in panel.lines for x in line.x]
    ys = [y for line in panel.lines for y in (*line.y, *(line.spread[0] if line.spread else ()))]
    ys += [y for line in panel.lines if line.spread for y in line.spread[1]]
    ys += [y for box in panel.boxes for y in (box.low, box.q1, box.q3, box.high, *box.beyond)]
    ys += panel.y_also
    ys += [edge for band in panel.bands if band.along == "y" for edge in (band.low, band.high)]
    ys += [0.0] if panel.y_zero else []
    if panel.x_names:
        xs = [-0.5, len(panel.x_names) - 0.5]
    return (
        fitted_axis(xs, *across, log=panel.x_log, tight=bool(panel.x_names)),
        fitted_axis(ys, *up, log=panel.y_log),
    )


def _bands(panel: Panel, x_axis: Axis, y_axis: Axis) -> list[str]:
    parts = []
    for band in panel.bands:
        if band.along == "x":
            x0, x1 = (min(max(x_axis.at(v), x_axis.start), x_axis.end) for v in (band.low, band.high))
            y0, y1 = y_axis.end, y_axis.start
        else:
            x0, x1 = x_axis.start, x_axis.end
            y1, y0 = (y_axis.at(v) for v in (band.low, band.high))
        parts.append(
            f"<rect class='band' x='{x0:.1f}' y='{y0:.1f}' width='{x1 - x0:.1f}' height='{y1 - y0:.1f}' "
            "fill='#000' opacity='0.07'/>"
        )
    return parts


def _grid(panel: Panel, x_axis: Axis, y_axis: Axis) -> list[str]:
    parts = []
    x_ticks = [(float(i), name) for i, name in enumerate(panel.x_names)] or [(v, number(v)) for v in x_axis.ticks()]
    for value, name in x_ticks:
        x = x_axis.at(value)
        parts.append(f"<path class='grid' d='M{x:.1f} {y_axis.start:.1f}V{y_axis.end:.1f}' stroke='{GRID}'/>")
        for line, words in enumerate(name.split("\n")):
            parts.append(text(x, y_axis.start + 15 + 13 * line, words, anchor="middle", fill=PALE if line else INK))
    for value in y_axis.ticks():
        y = y_axis.at(value)
        parts.append(f"<path class='grid' d='M{x_axis.start:.1f} {y:.1f}H{x_axis.end:.1f}' stroke='{GRID}'/>")
        parts.append(text(x_axis.start - 7, y + 4, number(value), anchor="end"))
    corner = f"M{x_axis.start:.1f} {y_axis.end:.1f}V{y_axis.start:.1f}H{x_axis.end:.1f}"
    parts.append(f"<path class='ink' d='{corner}' fill='none' stroke='{INK}'/>")
    return parts


def _line(line: Line, x_axis: Axis, y_axis: Axis, series: int) -> str:
    colour = COLOURS[series]
    path, dots, drawing = "", "", False
    for x, y in zip(line.x, line.y, strict=True):
        if not (x_axis.usable(x) and y_axis.usable(y)):
            drawing = False
            continue
        px, py = x_axis.at(x), y_axis.at(y)
        path += f"{'L' if drawing else 'M'}{px:.1f} {py:.1f}"
        drawing = True
        if line.markers:
            dots += _marker(px, py, series, hollow=line.dashed)
    style = f"stroke='{colour}' stroke-width='1.9' stroke-linejoin='round'{_dash(line)}"
    shadow = _shadow(line, x_axis, y_axis, series)
    return f"{shadow}<path class='s{series}' d='{path or 'M0 0'}' fill='none' {style}/>{dots}"


def _marker(x: float, y: float, series: int, *, hollow: bool) -> str:
    colour = COLOURS[series]
    style = f"fill='none' stroke='{colour}' stroke-width='1.8'" if hollow else f"fill='{colour}' stroke='white'"
    classes, width = (f"s{series}", "") if hollow else (f"s{series} halo", " stroke-width='0.8'")
    return f"<circle class='{classes}' cx='{x:.1f}' cy='{y:.1f}' r='3.2' {style}{width}/>"


def _shadow(line: Line, x_axis: Axis, y_axis: Axis, series: int) -> str:
    if not line.spread:
        return ""
    edges = [
        (x_axis.at(x), y_axis.at(low), y_axis.at(high))
        for x, low, high in zip(line.x, *line.spread, strict=True)
        if x_axis.usable(x) and y_axis.usable(low) and y_axis.usable(high)
    ]
    there = [f"{x:.1f} {low:.1f}" for x, low, _ in edges]
    back = [f"{x:.1f} {high:.1f}" for x, _, high in reversed(edges)]
    path = f"M{'L'.join(there + back)}Z" if edges else "M0 0"
    return f"<path class='s{series}' d='{path}' fill='{COLOURS[series]}' stroke='none' opacity='0.14'/>"


def _box(box: BoxMark, x_axis: Axis, y_axis: Axis) -> str:
    """Whiskers below the box, points beyond with some transparency, the note above all of them."""
    known = [box.low, box.q1, box.median, box.q3, box.high]
    if not all(y_axis.usable(value) or value == math.inf for value in known):
        return ""
    x, half = x_axis.at(box.x), 0.26 * abs(x_axis.at(1.0) - x_axis.at(0.0))
    low, q1, median, q3, high = (y_axis.end if value == math.inf else y_axis.at(value) for value in known)
    style = f"class='s{box.colour}' stroke='{COLOURS[box.colour]}' fill='{COLOURS[box.colour]}'"
    caps = f"M{x - 0.5 * half:.1f} {low:.1f}h{half:.1f}M{x - 0.5 * half:.1f} {high:.1f}h{half:.1f}"
    beyond = [y_axis.at(value) for value in box.beyond if y_axis.usable(value)]
    dots = "".join(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='1.8'/>" for y in beyond)
    return (
        f"<g {style}><path d='M{x:.1f} {low:.1f}V{q1:.1f}M{x:.1f} {q3:.1f}V{high:.1f}{caps}' stroke-width='1.3'/>"
        f"<rect x='{x - half:.1f}' y='{min(q1, q3):.1f}' width='{2 * half:.1f}' height='{max(abs(q1 - q3), 0.5):.1f}' "
        f"fill-opacity='0.22' stroke-width='1.3'/>"
        f"<path d='M{x - half:.1f} {median:.1f}h{2 * half:.1f}' stroke-width='2.6'/>"
        f"<g stroke='none' fill-opacity='0.55'>{dots}</g></g>"
        + text(x, min([high, *beyond]) - 7, box.note, anchor="middle", fill=PALE)
    )


def _dash(line: Line) -> str:
    return " stroke-dasharray='6 4'" if line.dashed else ""


def _legend_rows(labels: Sequence[str], width: float) -> list[list[str]]:
    """Labels in rows that fit."""
    rows: list[list[str]] = []
    left = 0.0
    for label in labels:
        needed = 34 + GLYPH * len(label)
        if not rows or left < needed:
            rows.append([])
            left = width
        rows[-1].append(label)
        left -= needed
    return rows


def _legend(panel: Panel, rows: list[list[str]], left: float, top: float) -> list[str]:
    marks = {}
    for line, colour in zip(panel.lines, panel.series(), strict=True):
        series = colour % len(COLOURS)
        marks[line.label] = f"class='s{series}' stroke='{COLOURS[series]}' stroke-width='2.4'{_dash(line)}"
    parts = []
    for number_, row in enumerate(rows):
        x, y = left, top + LEGEND_ROW * number_
        for label in row:
            style = marks.get(label, "class='band' stroke='#000' stroke-opacity='0.12' stroke-width='9'")
            parts.append(f"<path d='M{x:.1f} {y - 4:.1f}h18' {style}/>")
            parts.append(text(x + 23, y, label))
            x += 34 + GLYPH * len(label)
    return parts
