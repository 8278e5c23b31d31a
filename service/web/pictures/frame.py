"""Axes of a picture on the pages, in the colours of the style sheet."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import escape

from benchmarks.svg_plot import Axis, fitted_axis, number
from service.web.pictures.scale import WIDE

LEFT, RIGHT, TOP, BOTTOM = 66, 14, 12, 46  # px around the axes
MOST_NAMES = 12  # values without an order that still fit below an axis
SHAPES = (  # around (0, 0); the colours are dot-1 to dot-6 of the style sheet
    "M-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0 -9 0Z",
    "M-4 -4h8v8h-8Z",
    "M0 -5.5L5 3.8h-10Z",
    "M0 -5.8L5.8 0L0 5.8L-5.8 0Z",
    "M-5 -3.8h10L0 5.5Z",
    "M-1.7 -5h3.4v3.3h3.3v3.4h-3.3v3.3h-3.4v-3.3h-3.3v-3.4h3.3Z",
)
Value = float | str


@dataclass(frozen=True)
class Ruler:
    """An axis of numbers, or of names at equal distances."""

    axis: Axis
    names: Mapping[str, int]

    @classmethod
    def of(cls, values: Sequence[Value], start: float, end: float, *, log: bool | None = None) -> Ruler:
        """Around these values, from one pixel to another. log: None chooses by how far they are apart."""
        if all(isinstance(value, int | float) for value in values):
            numbers = [float(value) for value in values]
            wide = min(numbers) > 0.0 and max(numbers) >= WIDE * min(numbers)
            return cls(fitted_axis(numbers, start, end, log=wide if log is None else log), {})
        names = {name: i for i, name in enumerate(sorted({str(value) for value in values}))}
        return cls(Axis(-0.5, len(names) - 0.5, start, end, False), names)

    def at(self, value: Value) -> float:
        """Pixel of a value."""
        return self.axis.at(float(self.names[str(value)]) if self.names else float(value))

    def ticks(self) -> list[tuple[float, str]]:
        """(pixel, text) of what stands beside the axis."""
        if not self.names:
            return [(self.axis.at(value), number(value)) for value in self.axis.ticks()]
        step = -(-len(self.names) // MOST_NAMES)
        return [(self.axis.at(i), _short(name)) for name, i in self.names.items() if i % step == 0]


def rulers(xs: Sequence[Value], ys: Sequence[Value], width: int, height: int) -> tuple[Ruler, Ruler]:
    """The two axes of a picture of this size, px."""
    return Ruler.of(xs, LEFT, width - RIGHT), Ruler.of(ys, height - BOTTOM, TOP)


def frame(across: Ruler, up: Ruler, headings: tuple[str, str], width: int, height: int) -> list[str]:
    """Grid, ticks and headings as SVG."""
    bottom, right, middle = height - BOTTOM, width - RIGHT, (TOP + height - BOTTOM) / 2
    parts = [f'<path class="grid" d="M{at:.1f} {bottom}V{TOP}"/>' for at, _ in across.ticks()]
    parts += [f'<path class="grid" d="M{LEFT} {at:.1f}H{right}"/>' for at, _ in up.ticks()]
    parts += [text(at, bottom + 16, name, "middle") for at, name in across.ticks()]
    parts += [text(LEFT - 7, at + 4, name, "end") for at, name in up.ticks()]
    turned = f' transform="rotate(-90 14 {middle:.1f})"'
    return [
        *parts,
        f'<path class="frame" d="M{LEFT} {TOP}V{bottom}H{right}"/>',
        text((LEFT + right) / 2, height - 8, headings[0], "middle"),
        text(14, middle, headings[1], "middle", turned),
    ]


def text(x: float, y: float, words: str, place: str = "start", more: str = "") -> str:
    """A line of text. place: start, middle or end of it at x."""
    return f'<text x="{x:.1f}" y="{y:.1f}" class="{place}"{more}>{escape(words)}</text>'


def _short(name: str) -> str:
    with contextlib.suppress(ValueError, AttributeError):  # not the JSON of a block
        name = str(json.loads(name).get("kind", name))
    return name if len(name) <= 14 else f"{name[:13]}…"
