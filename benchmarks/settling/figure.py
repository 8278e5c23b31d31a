"""What a tip error is paid with: each cell at its medians of RCM error and tip RMSE, a panel for each plant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchmarks.settling.plants import PLANTS
from benchmarks.settling.scores import BUDGET_MM
from benchmarks.svg_plot import Band, Line, Panel, svg

if TYPE_CHECKING:
    from collections.abc import Sequence

Json = dict[str, Any]

RCM = "rcm_max_mm"
BEYOND = 1e3  # mm, wider than any axis
ROWS, AXIS, ELM = 0, 2, 1  # colours


def pareto(report: Json) -> str | None:
    """The picture from the report's JSON; None without a cell that has both medians."""
    known = [s for s in report["cells"] if s["rmse_mm"]["median"] and s["beside"][RCM]["median"]]
    if not known:
        return None
    reach = [s["rmse_mm"]["median"] for s in known]
    wide = [s["beside"][RCM]["median"] for s in known]
    band = Band(f"above the budget of {BUDGET_MM:g} mm", BUDGET_MM, BEYOND)
    panels = [
        Panel(
            plant.title,
            "largest RCM error, mm",
            "tip RMSE, mm",
            tuple(_lines([s for s in known if s["plant"] == plant.name])),
            bands=(band,),
            x_log=min(wide) > 0.0,
            y_log=min(reach) > 0.0,
            y_also=(0.8 * min(reach), 1.25 * max(reach)),
        )
        for plant in PLANTS
        if any(s["plant"] == plant.name for s in known)
    ]
    said = "; ".join(f"{s['cell']} {s['beside'][RCM]['median']:.3g}, {s['rmse_mm']['median']:.3g}" for s in known)
    about = ("Tip error and RCM error of each cell", f"Medians over end points, mm, RCM error and RMSE: {said}")
    return svg([panels], width=480 * len(panels), height=430, name="p", about=about)


def _lines(scores: Sequence[Json]) -> list[Line]:
    """A line through the row weights of each delay, a dot for each other cell; a colour for each kind of controller,
    dashed and hollow where it is delayed."""
    lines = []
    for delay in sorted({s["delay_ms"] for s in scores if s["arm"] == "ifem"}):
        mine = [s for s in scores if s["arm"] == "ifem" and s["delay_ms"] == delay]
        rows = [s for s in mine if s["rows"].startswith("rows")]
        axis = [s for s in mine if not s["rows"].startswith("rows")]
        lines.append(_line(f"I-FEM, rows, {delay:g} ms", rows, delay, ROWS))
        lines.append(_line(f"I-FEM, axis, {delay:g} ms", axis, delay, AXIS))
    elm = [s for s in scores if s["arm"] == "elm"]
    return lines + [_line(f"ELM, {s['delay_ms']:g} ms", [s], s["delay_ms"], ELM) for s in elm]


def _line(label: str, scores: Sequence[Json], delay_ms: float, colour: int) -> Line:
    x = [s["beside"][RCM]["median"] for s in scores]
    return Line(label, x, [s["rmse_mm"]["median"] for s in scores], dashed=delay_ms > 0.0, colour=colour)
