"""Line and box plots as SVG, without a plotting library: panels in a grid, linear and logarithmic axes, a legend each.

Every colour has a class beside it (`ink`, `pale`, `grid`, `paper`, `halo`, `band`, `s0` ... `s7`), so that the style
sheet of a page may replace it, in the dark for one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555", "#8c6d31")  # Okabe and Ito
INK, PALE, GRID = "#222222", "#666666", "#e4e4e4"
FONT = "font-family='system-ui, -apple-system, Segoe UI, Helvetica, Arial, sans-serif'"
LEFT, RIGHT, TOP, BOTTOM = 68, 14, 34, 44  # px around the axes of a panel
LEGEND_ROW, GLYPH = 16, 6.1  # px: height of a row, mean width of a letter at size 11
HEAD = 34  # px above the panels for the title of the whole


@dataclass(frozen=True)
class Line:
    """One curve; a point that is not finite (or not positive on a logarithmic axis) interrupts it. spread: lowest and
    highest value at each x, drawn as a shadow."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    markers: bool = True
    spread: tuple[Sequence[float], Sequence[float]] | None = None


@dataclass(frozen=True)
class BoxMark:
    """A box plot at a place on the x axis: quartiles, whiskers, points beyond. colour: number of the series. What is
    infinite is drawn at the top of the axis."""

    x: float
    low: float
    q1: float
    median: float
    q3: float
    high: float
    beyond: Sequence[float] = ()
    colour: int = 0
    note: str = ""


@dataclass(frozen=True)
class Band:
    """A grey strip across the panel between two values of x (or of y)."""

    label: str
    low: float
    high: float
    along: str = "x"


@dataclass(frozen=True)
class Panel:
    """One pair of axes. y_zero: the y axis begins at zero. x_names: texts in place of 0, 1, 2, ... on the x axis, a
    second line after a line feed. y_also: values that the y axis has to reach, so that panels can share a range."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    bands: tuple[Band, ...] = ()
    x_log: bool = False
    y_log: bool = False
    y_zero: bool = False
    x_names: tuple[str, ...] = ()
    boxes: tuple[BoxMark, ...] = ()
    y_also: tuple[float, ...] = ()


@dataclass(frozen=True)
class Axis:
    """Maps values to pixels; `start` may be larger than `end`, as on a vertical axis."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def usable(self, value: float) -> bool:
        """Whether the value has a place on this axis."""
        return math.isfinite(value) and (value > 0.0 or not self.log)

    def at(self, value: float) -> float:
        """Pixel of a value."""
        low, high, value = (math.log10(v) if self.log else v for v in (self.low, self.high, value))
        return self.start + (value - low) / (high - low) * (self.end - self.start)

    def ticks(self) -> list[float]:
        """Round values within the range."""
        return log_ticks(self.low, self.high) if self.log else linear_ticks(self.low, self.high)


def linear_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten, about `wanted` of them."""
    raw = (high - low) / wanted
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten; with 2 and 5 times them, or more, where less than three would fit; else multiples of one step."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    every = -(-len(decades) // 8)
    for steps in ((1.0,), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), tuple(range(1, 10))):
        values = [m * 10.0**d for d in decades if d % every == 0 for m in steps]
        kept = [v for v in values if low * 0.999 <= v <= high * 1.001]
        if len(kept) >= 3:
            return kept
    return linear_ticks(low, high, 4)


def fitted_axis(values: Sequence[float], start: float, end: float, *, log: bool, tight: bool = False) -> Axis:
    """An axis around the usable values, with some air; from zero where the values nearly reach it."""
    usable = [v for v in values if math.isfinite(v) and (v > 0.0 or not log)]
    low, high = (min(usable), max(usable)) if usable else (1.0, 10.0)
    if log:
        air = 1.0 if tight else max((high / low) ** 0.06, 1.06)
        low, high = (low / air, high * air) if high > low else (low / 2, high * 2)
        return Axis(low, high, start, end, True)
    if 0.0 < low < 0.4 * high:
        low = 0.0
    air = 0.0 if tight else 0.06 * (high - low)
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-30):
        air = 0.5 * abs(high) or 1.0
    beyond = high if high == 0.0 > low else high + air
    return Axis(low if low == 0.0 else low - air, beyond, start, end, False)


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


def picture(
    parts: Sequence[str], *, width: int, height: int, name: str = "c", about: tuple[str, str] | None = None
) -> str:
    """The SVG document around drawn parts. about: what it is and what it shows, for those who cannot see it."""
    labels = f" aria-labelledby='{name}-t {name}-d'" if about else ""
    head = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' height='{height}' "
        f"role='img'{labels} {FONT} font-size='11'>",
    ]
    if about:
        head += [f"<title id='{name}-t'>{escape(about[0])}</title>", f"<desc id='{name}-d'>{escape(about[1])}</desc>"]
    head.append(f"<rect class='paper' width='{width}' height='{height}' fill='white'/>")
    return "\n".join([*head, *parts, "</svg>"]) + "\n"


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
        *(_line(line, x_axis, y_axis, i % len(COLOURS)) for i, line in enumerate(panel.lines)),
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
            dots += (
                f"<circle class='s{series} halo' cx='{px:.1f}' cy='{py:.1f}' r='3.2' fill='{colour}' stroke='white' "
                "stroke-width='0.8'/>"
            )
    style = f"stroke='{colour}' stroke-width='1.9' stroke-linejoin='round'{_dash(line)}"
    shadow = _shadow(line, x_axis, y_axis, series)
    return f"{shadow}<path class='s{series}' d='{path or 'M0 0'}' fill='none' {style}/>{dots}"


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
    for i, line in enumerate(panel.lines):
        series = i % len(COLOURS)
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


def number(value: float) -> str:
    """A tick label: plain where that is short, else a power of ten."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e5:
        return f"{value:.6g}"
    mantissa, exponent = f"{value:.3e}".split("e")
    factor = f"{float(mantissa):g}"
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if factor == "1" else f"{factor}·10{raised}"


def text(
    x: float,
    y: float,
    words: str,
    *,
    anchor: str = "start",
    size: int = 11,
    weight: int = 400,
    fill: str = INK,
    turned: bool = False,
) -> str:
    """One line of text; nothing for no words."""
    if not words:
        return ""
    turn = f" transform='rotate(-90 {x:.1f} {y:.1f})'" if turned else ""
    shade = {INK: "class='ink' ", PALE: "class='pale' "}.get(fill, "")
    style = f"{shade}text-anchor='{anchor}' font-size='{size}' font-weight='{weight}' fill='{fill}'"
    return f"<text x='{x:.1f}' y='{y:.1f}' {style}{turn}>{escape(words)}</text>"
