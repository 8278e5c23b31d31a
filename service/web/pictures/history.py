"""Small multiples: a figure of a suite over its runs, its levels drawn and each step between them marked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from benchmarks.level_steps import LevelStep, level_steps
from benchmarks.paper.table import BESIDE
from benchmarks.svg_plot import Axis
from service.web.formatting import when
from service.web.pictures.frame import Ruler, text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from service.campaigns.trends import SuiteTrend, TrendRun

WIDTH, HEIGHT = 340, 150  # px
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 24, 12
SUCCESS = "Successful, %"


@dataclass(frozen=True, kw_only=True)
class Change:
    """A step: since which campaign and when, in words."""

    campaign: str
    worse: bool
    words: str


@dataclass(frozen=True, kw_only=True)
class Multiple:
    """One figure. sentence: what the picture shows."""

    heading: str
    svg: Markup
    sentence: str
    changes: list[Change]


def multiples(trend: SuiteTrend) -> list[Multiple]:
    """Error, success, what the error may have been paid with, time of a step: each that two runs or more have."""
    figures: dict[str, Callable[[TrendRun], float | None]] = {
        "RMSE, mm, median": lambda run: run.point.median_rmse_mm,
        SUCCESS: lambda run: 100.0 * run.point.successes / max(len(run.point.rmse_commanded_mm), 1),
        **{heading: _beside(metric) for metric, (heading, _) in BESIDE.items()},
        "Step, ms, median": lambda run: run.point.step_ms,
    }
    return [one for heading, figure in figures.items() if (one := _multiple(heading, trend.runs, figure))]


def _beside(metric: str) -> Callable[[TrendRun], float | None]:
    return lambda run: run.point.beside.get(metric)


def _multiple(heading: str, runs: Sequence[TrendRun], figure: Callable[[TrendRun], float | None]) -> Multiple | None:
    known = [(run, value) for run in runs if (value := figure(run)) is not None and math.isfinite(value)]
    if len(known) < 2:
        return None
    values = [value for _, value in known]
    steps = level_steps(values)
    changes = [_change(step, known[step.at][0], rising_is_worse=heading != SUCCESS) for step in steps]
    found = "; ".join(change.words for change in changes) or "no step"
    sentence = f"{len(values)} runs, {values[0]:.4g} first, {values[-1]:.4g} now: {found}."
    return Multiple(
        heading=heading, svg=_svg(heading, values, steps, changes, sentence), sentence=sentence, changes=changes
    )


def _change(step: LevelStep, run: TrendRun, *, rising_is_worse: bool) -> Change:
    worse = (step.after > step.before) == rising_is_worse
    words = f"{'worse' if worse else 'better'} since {when(run.point.at)}: {step.before:.4g} to {step.after:.4g}"
    return Change(campaign=run.campaign.id, worse=worse, words=words)


def _svg(
    heading: str, values: Sequence[float], steps: Sequence[LevelStep], changes: Sequence[Change], sentence: str
) -> Markup:
    across = Ruler.of([0.0, float(max(len(values) - 1, 1))], LEFT, WIDTH - RIGHT, log=False)
    shares = Axis(0.0, 100.0, HEIGHT - BOTTOM, TOP, False)  # over 100 % there is nothing
    up = Ruler(shares, {}) if heading == SUCCESS else Ruler.of(values, HEIGHT - BOTTOM, TOP, log=False)
    places = [(across.at(float(i)), up.at(value)) for i, value in enumerate(values)]
    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(heading)}: {escape(sentence)}">']
    for at, words in up.ticks()[::2]:
        parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(text(LEFT - 6, at + 4, words, "end"))
    parts.append(f'<path class="line dot-1" d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in places)}"/>')
    parts += [f'<circle class="dot-1" cx="{x:.1f}" cy="{y:.1f}" r="2.4"/>' for x, y in places]
    for step, change in zip(steps, changes, strict=True):
        x = (places[step.at - 1][0] + places[step.at][0]) / 2
        kind = "worse" if change.worse else "better"
        parts.append(f'<path class="step {kind}" d="M{x:.1f} {HEIGHT - BOTTOM}V4"/>')
        parts.append(text(x + 4, 14.0, f"{'▲' if step.after > step.before else '▼'} {kind}", "start"))
    edges = [0, *(step.at for step in steps), len(values)]
    levels = [steps[0].before, *(step.after for step in steps)] if steps else []
    for level, start, end in zip(levels, edges, edges[1:], strict=False):
        parts.append(f'<path class="level" d="M{places[start][0]:.1f} {up.at(level):.1f}H{places[end - 1][0]:.1f}"/>')
    return Markup("\n".join([*parts, "</svg>"]))
