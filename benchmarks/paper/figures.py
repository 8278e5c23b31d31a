"""The report's pictures, drawn from its JSON; without data for one, it is left out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from benchmarks.paper.table import ALL, GROUPS, QUIET_ARM, arm_name, in_order
from benchmarks.svg_plot import COLOURS, PALE, Axis, BoxMark, Line, Panel, fitted_axis, number, picture, svg, text

if TYPE_CHECKING:
    from collections.abc import Sequence

Json = dict[str, Any]

COLOUR_OF = {
    "ifem": 0,
    "elm": 1,
    "frozen": 2,
    "linear": 3,
    "neighbours": 4,
    "mlp": 5,
    "open_loop": 6,
    "rigid": 7,
    QUIET_ARM: 1,
}
SHORT = {
    QUIET_ARM: "quiet ELM",
    "frozen": "frozen J",
    "linear": "linear",
    "neighbours": "k-NN",
    "mlp": "MLP",
    "rigid": "rigid",
}
PAPER_ARMS = ("ifem", "elm", "open_loop", "rigid")
BINS_MM = (0.1, 0.25, 0.5, 1.0)  # upper bounds of the map's colours; the last colour is above
SHADES = ("#d3e5dc", "#93c7b4", "#4a9d8e", "#1d6f73", "#16384f")  # q0 ... q4
FAILED = "#b3261e"
SCALE = 5.4  # px of the map for a millimetre


# ---- errors as boxes


def conditions(report: Json) -> list[tuple[str, str]]:
    """(young, noise) of the scores, as they come: the primary condition first."""
    return list(dict.fromkeys((score["young"], score["noise"]) for score in report["scores"]))


def box_panels(report: Json, young: str, noise: str, *, arms: Sequence[str] | None = PAPER_ARMS) -> list[Panel]:
    """A panel for each group with a box for each controller (None: every one), all on the same logarithmic range."""
    scores = [s for s in report["scores"] if (s["young"], s["noise"]) == (young, noise) and s["box"]]
    scores = [s for s in scores if arms is None or s["arm"] in arms]
    ends = [v for s in scores for v in (s["box"]["low"], s["box"]["high"], *s["box"]["beyond"])]
    values = [v for v in ends if v is not None and v > 0.0]
    reach = (0.85 * min(values), 1.35 * max(values)) if values else ()
    panels = []
    for group in dict.fromkeys(s["group"] for s in scores):
        members = [s for s in scores if s["group"] == group]
        names = tuple(f"{SHORT.get(s['arm'], arm_name(s['arm']))}\n{_count(s)}" for s in members)
        boxes = tuple(
            box_mark(i, s["box"], COLOUR_OF.get(s["arm"], 2), s["box"]["beyond"]) for i, s in enumerate(members)
        )
        label = "RMSE, mm"
        panels.append(Panel(group, "", label, (), y_log=True, x_names=names, boxes=boxes, y_also=reach))
    return panels


def _count(score: Json) -> str:
    return f"n = {score['insertions']}" + (f"\n{score['failed']} failed" if score["failed"] else "")


def box_mark(place: int, box: Json, colour: int, beyond: Sequence[float]) -> BoxMark:
    """The box of a score, with its median written above; what is null in it is a failure and above everything."""
    names = ("low", "q1", "median", "q3", "high")
    low, q1, median, q3, high = (math.inf if box[name] is None else float(box[name]) for name in names)
    note = f"{median:.3g}" if math.isfinite(median) else "failed"
    return BoxMark(float(place), low, q1, median, q3, high, beyond, colour=colour, note=note)


def pictures(panels: Sequence[Panel], *, name: str, about: str, width: int = 340, height: int = 350) -> list[str]:
    """Each panel as a picture of its own, so that a narrow page can put one below the other."""
    return [
        svg([[panel]], width=width, height=height, name=f"{name}{i}", about=(panel.title, f"{about} {_said(panel)}"))
        for i, panel in enumerate(panels)
    ]


def _said(panel: Panel) -> str:
    """The medians of a panel's boxes in words."""
    names = (name.split("\n")[0] for name in panel.x_names)
    return "; ".join(f"{name} {box.note}" for name, box in zip(names, panel.boxes, strict=False))


def headline(report: Json) -> str | None:
    """The main figure alone: errors of the primary condition, three panels in one picture. None without any."""
    known = conditions(report)
    panels = box_panels(report, *known[0]) if known else []
    if not panels:
        return None
    said = " | ".join(f"{panel.title}: {_said(panel)}" for panel in panels)
    about = ("Tip error by controller", f"Box plots of the RMSE in mm on a logarithmic axis; medians: {said}")
    title = "Tip error of every insertion, RMSE in mm"
    return svg([panels], title=title, width=max(420, 330 * len(panels)), height=370, name="h", about=about)


# ---- the map of end points


def maps(report: Json) -> list[str]:
    """The far face for each steered controller and stiffness without noise: colour = worst error, cross = failed."""
    face = report["face_mm"]
    spots = [s for s in report["spots"] if s["noise"] == "off" and s["arm"] in ("ifem", "elm")]
    if not face or not spots:
        return []
    kinds = sorted({(s["young"], s["arm"]) for s in spots}, key=lambda k: (k[0] != "constant", k[0], k[1] != "ifem"))
    return [
        _map([s for s in spots if (s["young"], s["arm"]) == kind], face, report["entry_mm"], kind, f"m{i}")
        for i, kind in enumerate(kinds)
    ]


def _map(spots: list[Json], face: list[float], entry: list[float] | None, kind: tuple[str, str], name: str) -> str:
    left, top = 34, 44
    width, height = round(SCALE * face[0]) + left + 14, round(SCALE * face[1]) + top + 40
    x_axis = Axis(0.0, face[0], left, left + SCALE * face[0], False)
    y_axis = Axis(0.0, face[1], top + SCALE * face[1], top, False)
    failed = sum(s["failed"] for s in spots)
    count = sum(s["insertions"] for s in spots)
    title = f"{arm_name(kind[1])}, {kind[0]} E"
    parts = [
        text(left, 18, title, size=13, weight=600),
        text(left, 34, f"{failed} of {count} failed", fill=PALE),
        f"<rect class='ink' x='{left}' y='{top}' width='{x_axis.end - left:.1f}' height='{y_axis.start - top:.1f}' "
        "fill='none' stroke='#222222'/>",
    ]
    for edge, axis in ((face[0], x_axis), (face[1], y_axis)):
        for value in (0.0, edge / 2, edge):
            x, y, anchor = (
                (axis.at(value), y_axis.start + 15, "middle")
                if axis is x_axis
                else (left - 6, axis.at(value) + 4, "end")
            )
            parts.append(text(x, y, number(value), anchor=anchor, fill=PALE))
    parts.append(text((left + x_axis.end) / 2, y_axis.start + 31, "x, mm; y upwards", anchor="middle", fill=PALE))
    if entry:
        x, y = x_axis.at(entry[0]), y_axis.at(entry[1])
        parts.append(
            f"<path class='ink' d='M{x - 9:.1f} {y:.1f}h18M{x:.1f} {y - 9:.1f}v18' stroke='#222222' fill='none'/>"
            f"<circle class='ink' cx='{x:.1f}' cy='{y:.1f}' r='6' fill='none' stroke='#222222'/>"
        )
    parts += [_spot(s, x_axis, y_axis) for s in spots]
    said = f"{len(spots)} end points on a face of {face[0]:g} by {face[1]:g} mm, {failed} of {count} insertions failed."
    return picture(parts, width=width, height=height, name=name, about=(title, said))


def _spot(spot: Json, x_axis: Axis, y_axis: Axis) -> str:
    x, y, worst = x_axis.at(spot["x_mm"]), y_axis.at(spot["y_mm"]), spot["worst_mm"]
    if spot["failed"]:
        words = f"end point {spot['end_point']}: {spot['failed']} of {spot['insertions']} failed"
        shape = f"<path class='failed' d='M{x - 4:.1f} {y - 4:.1f}l8 8m0-8l-8 8' stroke='{FAILED}' stroke-width='2.6'/>"
    else:
        words = f"end point {spot['end_point']}: error at most {worst:.3f} mm"
        shade = shade_of(worst)
        shape = f"<circle class='q{shade}' cx='{x:.1f}' cy='{y:.1f}' r='4.6' fill='{SHADES[shade]}'/>"
    return f"<g><title>{escape(words)}</title>{shape}</g>"


def shade_of(error_mm: float) -> int:
    """Number of the map's colour."""
    return sum(error_mm > bound for bound in BINS_MM)


# ---- time


def timing_bars(report: Json) -> str | None:
    """A step's parts in a row, with the quartiles of their sum; None without a timing pass."""
    costs = [c for c in report["timing"]["costs"] if c["total"]["median_ms"] is not None]
    if not costs:
        return None
    left, row, width = 142, 44, 720
    height = 16 + row * len(costs) + 42
    axis = fitted_axis([0.0, 1.12 * max(c["total"]["q3_ms"] for c in costs)], left, width - 20, log=False, tight=True)
    base = 16 + row * len(costs)
    parts = []
    for value in axis.ticks():
        x = axis.at(value)
        parts.append(f"<path class='grid' d='M{x:.1f} 10V{base}' stroke='#e4e4e4'/>")
        parts.append(text(x, base + 16, number(value), anchor="middle"))
    parts.append(text((left + width) / 2, base + 34, "ms a step, median", anchor="middle", fill=PALE))
    for i, cost in enumerate(costs):
        parts += _bar(cost, axis, left, 20 + row * i)
    said = "; ".join(f"{c['way']} {c['total']['median_ms']:.2f} ms" for c in costs)
    return picture(parts, width=width, height=height, name="t", about=("Computation time of one step", said))


def _bar(cost: Json, axis: Axis, left: int, top: int) -> list[str]:
    parts = [text(left - 10, top + 17, cost["way"], anchor="end")]
    begun = 0.0
    for part, colour in (("plant", 6), ("jacobian", 0), ("command", 1)):
        ended = begun + (cost[part]["median_ms"] or 0.0)
        x, wide = axis.at(begun), axis.at(ended) - axis.at(begun)
        parts.append(
            f"<rect class='s{colour}' x='{x:.1f}' y='{top}' width='{wide:.1f}' height='24' fill='{COLOURS[colour]}' "
            f"stroke='none' fill-opacity='0.75'><title>{part} {cost[part]['median_ms'] or 0.0:.3f} ms</title></rect>"
        )
        begun = ended
    low, high, end = axis.at(cost["total"]["q1_ms"]), axis.at(cost["total"]["q3_ms"]), axis.at(begun)
    parts.append(
        f"<path class='ink' d='M{low:.1f} {top + 12}H{high:.1f}M{low:.1f} {top + 7}v10M{high:.1f} {top + 7}v10' "
        "stroke='#222222' fill='none'/>"
    )
    parts.append(text(max(end, high) + 7, top + 16, f"{cost['total']['median_ms']:.2f} ms", weight=600))
    return parts


# ---- seeds and learning


def seed_panels(report: Json) -> list[Panel]:
    """One box a group of the medians of the ELM seeds."""
    scores = [s for s in report["seeds"]["scores"] if s["median_mm"] is not None]
    groups = in_order({s["group"] for s in scores}, (*GROUPS, ALL))
    boxes = []
    for i, group in enumerate(groups):
        values = [s["median_mm"] for s in scores if s["group"] == group]
        boxes.append(box_mark(i, report["seeds"]["boxes"][group], COLOUR_OF["elm"], values))
    names = tuple(groups)
    return (
        [Panel("ELM seeds", "", "median RMSE, mm", (), y_zero=True, x_names=names, boxes=tuple(boxes))] if boxes else []
    )


def learning_panels(report: Json) -> list[Panel]:
    """Error over nodes and over samples: median line, range of the seeds as a shadow."""
    panels = []
    for curve, label in (("nodes", "hidden nodes"), ("samples", "training samples")):
        steps = [s for s in report["learning"] if s["curve"] == curve]
        lines = []
        for measure in dict.fromkeys(s["measure"] for s in steps):
            mine = [s for s in steps if s["measure"] == measure and s["median_mm"] is not None]
            x = [float(s["value"]) for s in mine]
            spread = ([s["low_mm"] for s in mine], [s["high_mm"] or s["median_mm"] for s in mine])
            lines.append(Line(measure, x, [s["median_mm"] for s in mine], spread=spread))
        if lines:
            panels.append(Panel(f"Error over {label}", label, "error, mm", tuple(lines), x_log=True, y_log=True))
    return panels


# ---- sensitivity


def sensitivity_dots(report: Json) -> list[str]:
    """A picture for each group: a row for each setting with the medians of I-FEM, ELM and open loop."""
    rows = report["sensitivity"]
    pictures = []
    for i, group in enumerate(in_order({row["group"] for row in rows}, (*GROUPS, ALL))):
        mine = [row for row in rows if row["group"] == group]
        values = [row[name] for row in mine for name in ("ifem_mm", "elm_mm", "open_loop_mm") if row[name]]
        if values:
            pictures.append(_dots(mine, values, group, f"v{i}"))
    return pictures


def _dots(rows: list[Json], values: list[float], group: str, name: str) -> str:
    left, width, row_height, top = 164, 500, 19, 34
    base = top + row_height * len(rows)
    axis = fitted_axis(values, left, width - 16, log=True)
    parts = [text(left, 18, group, size=13, weight=600)]
    for value in axis.ticks():
        x = axis.at(value)
        parts.append(f"<path class='grid' d='M{x:.1f} {top - 6}V{base}' stroke='#e4e4e4'/>")
        parts.append(text(x, base + 15, number(value), anchor="middle"))
    parts.append(text((left + width) / 2, base + 32, "median RMSE, mm", anchor="middle", fill=PALE))
    for i, row in enumerate(rows):
        y = top + row_height * (i + 0.5)
        parts.append(text(left - 10, y + 4, f"{row['parameter']} {row['value']}", anchor="end"))
        if row["ifem_mm"] and row["elm_mm"]:
            a, b = axis.at(row["ifem_mm"]), axis.at(row["elm_mm"])
            parts.append(f"<path class='pale' d='M{a:.1f} {y:.1f}H{b:.1f}' stroke='#666666' stroke-opacity='0.5'/>")
        for arm in ("open_loop", "elm", "ifem"):
            if value := row[f"{arm}_mm"]:
                faint = " opacity='0.35'" if arm in row["nominal"] else ""
                series = COLOUR_OF[arm]
                words = f"<title>{escape(arm_name(arm))} {value:.3f} mm</title>"
                parts.append(
                    f"<circle class='s{series}' cx='{axis.at(value):.1f}' cy='{y:.1f}' r='4.2' "
                    f"fill='{COLOURS[series]}' stroke='none'{faint}>{words}</circle>"
                )
    said = f"Median RMSE of I-FEM, ELM and open loop in {len(rows)} settings."
    about = (f"Sensitivity, {group}", said)
    return picture(parts, width=width, height=base + 44, name=name, about=about)
