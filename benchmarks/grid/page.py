"""The page of a grid's report: one file without scripts or network, in the looks of the paper's report."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from benchmarks.paper.figures import COLOUR_OF, box_mark, pictures
from benchmarks.paper.page import render
from benchmarks.paper.table import REFERENCES, arm_name
from benchmarks.svg_plot import Line, Panel

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Json = dict[str, Any]
WIDE = 30.0  # ratio of the largest to the smallest value from which an axis is logarithmic


def html(report: Json) -> str:
    """The page. report: what `grid_report.document` returns, or its JSON read back."""
    names = {(field["path"], str(value)): name for field in report["fields"] for value, name in _named(field)}
    groups = dict.fromkeys(score["group"] for score in report["scores"])
    return render(
        "grid.html.j2",
        report=report,
        varied=[field for field in report["fields"] if not field["repeats"] and not field["of_arm"]],
        several_arms=len(report["arms"]) > 1,
        repeats=next((len(field["values"]) for field in report["fields"] if field["repeats"]), 1),
        best=_best(report["points"]),
        groups=[(group, [s for s in report["scores"] if s["group"] == group]) for group in groups],
        profile=pictures(profile_panels(report["profiles"]), name="p", about="Share of cases.", width=640, height=340),
        effects=[_effect(effect, f"e{i}-", names) for i, effect in enumerate(report["effects"])],
        names=names,
        references=REFERENCES,
    )


def _named(field: Json) -> list[tuple[Any, str]]:
    return list(zip(field["values"], field["names"], strict=True))


def _best(points: list[Json]) -> Json | None:
    """The point with the smallest median error of those that never failed; None of one point alone."""
    known = [point for point in points if point["median_mm"] is not None and not point["failed"]]
    return min(known, key=lambda point: float(point["median_mm"])) if len(points) > 1 and known else None


def profile_panels(profiles: Json | None) -> list[Panel]:
    """The share of cases within each error, a line for each arm, its interval as a shadow."""
    if profiles is None or not profiles["levels_mm"]:
        return []
    lines = tuple(
        Line(
            arm_name(one["arm"]),
            profiles["levels_mm"],
            one["share"],
            markers=False,
            spread=(one["share_low"], one["share_high"]),
        )
        for one in profiles["aggregates"]
    )
    return [Panel("Performance profiles", "RMSE, mm", "share of cases", lines, x_log=True, y_zero=True)]


def _effect(effect: Json, name: str, names: Mapping[tuple[str, str], str]) -> Json:
    panels = _lines(effect) if effect["numeric"] else _boxes(effect)
    path = effect["field"]
    groups = [(names[path, value], [s for s in effect["scores"] if s["group"] == value]) for value in effect["values"]]
    contrasts = [
        {**c, "first": names[path, c["first"]], "second": names[path, c["second"]]} for c in effect["contrasts"]
    ]
    return {
        **effect,
        "contrasts": contrasts,
        "groups": groups,
        "pictures": pictures(panels, name=name, about="RMSE in mm;"),
    }


def _lines(effect: Json) -> list[Panel]:
    """Median over the values, a line for each controller, quartiles as a shadow."""
    lines = []
    for arm in dict.fromkeys(s["arm"] for s in effect["scores"]):
        mine = [s for s in effect["scores"] if s["arm"] == arm and s["median_mm"] is not None]
        if mine:
            spread = [s["q1_mm"] for s in mine], [s["q3_mm"] or s["median_mm"] for s in mine]
            x = [json.loads(s["group"]) for s in mine]
            lines.append(Line(arm_name(arm), x, [s["median_mm"] for s in mine], spread=spread))
    if not lines:
        return []
    x_log, y_log = _wide(v for line in lines for v in line.x), _wide(v for line in lines for v in line.y)
    return [Panel("Median RMSE", effect["field"], "RMSE, mm", tuple(lines), x_log=x_log, y_log=y_log, y_zero=not y_log)]


def _wide(values: Iterable[float]) -> bool:
    """Whether they need a logarithmic axis."""
    known = sorted(values)
    return known[0] > 0.0 and known[-1] >= WIDE * known[0]


def _boxes(effect: Json) -> list[Panel]:
    """A box for each value; where several controllers ran at each, a panel for each controller."""
    panels = []
    known = [s for s in effect["scores"] if s["box"]]
    alone = len({s["group"] for s in known}) == len(known)
    for arm in [None] if alone else dict.fromkeys(s["arm"] for s in known):
        mine = [s for s in known if arm is None or s["arm"] == arm]
        colours = [COLOUR_OF.get(s["arm"], 2) for s in mine]
        boxes = [box_mark(i, s["box"], colours[i], s["box"]["beyond"]) for i, s in enumerate(mine)]
        names = tuple(f"{_short(s['group'])}\nn = {s['insertions']}" for s in mine)
        title = "RMSE" if arm is None else arm_name(arm)
        panels.append(Panel(title, "", "RMSE, mm", (), y_log=True, x_names=names, boxes=tuple(boxes)))
    return panels


def _short(text: str) -> str:
    name = arm_name(text)
    return name if len(name) <= 16 else f"{name[:15]}…"
