"""What a plot is made of: curves, boxes and bands in a pair of axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Line:
    """One curve; a point that is not finite (or not positive on a logarithmic axis) interrupts it. spread: lowest and
    highest value at each x, drawn as a shadow. dashed: with hollow markers. colour: number of the series, None = the
    line's place in its panel."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    colour: int | None = None
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

    def series(self) -> list[int]:
        """The number of each line's colour."""
        return [i if line.colour is None else line.colour for i, line in enumerate(self.lines)]
