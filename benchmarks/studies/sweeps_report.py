"""The sweeps as tables, CSV and pictures."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import astuple, dataclass, fields
from typing import TYPE_CHECKING

from benchmarks.measurements import Figure, Part, Table, figure
from benchmarks.svg_plot import Line, Panel, svg
from simcore.scenario.scenario import StraightTrajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.observed_run import ObservedRun
    from simcore.scenario.scenario import Scenario

MEASURES = (  # field of VariantRow, title, unit
    ("tip_max_mm", "largest tip difference", "mm"),
    ("entry_mean_n", "mean lateral force at the entry", "N"),
    ("push_mean_n", "mean axial force on the base", "N"),
    ("lateral_mean_n", "mean of sum |λ lateral|", "N"),
)
TITLES = {
    "mesh": "Mesh size",
    "beams": "Beams",
    "dt": "Time step",
    "spacing": "Spacing of the constraint points",
    "spread": "Radius over which a point force is spread",
    "coupling": "Coupling along the needle: compliant with a free or a held tip, or hard points and a held tip",
    "faces": "Fixed faces",
    "tolerance": "Solver tolerance",
}


@dataclass(frozen=True)
class VariantRow:
    """One variant. Differences are to the sweep's reference at the same time; means and maxima are over the depth."""

    sweep: str
    variant: str
    place: float
    default: bool
    reference: bool
    status: str
    steps: int
    tip_end_mm: float
    tip_max_mm: float
    rmse_commanded_mm: float | None
    entry_mean_n: float
    entry_max_n: float
    push_mean_n: float
    push_apart_n: float
    lateral_mean_n: float
    lateral_max_n: float
    lambda_ratio: float | None
    min_det_f: float | None
    iterations: float


def study_part(
    base: Scenario,
    source_run: ObservedRun,
    sweeps: Sequence[tuple[str, str, bool, bool]],
    rows: list[VariantRow],
    depth_runs: dict[str, ObservedRun],
) -> Part:
    """Everything that is written. sweeps: name, label of the axis, logarithmic, named values."""
    tables = [_table(name, [row for row in rows if row.sweep == name]) for name, *_ in sweeps]
    files = {
        "sweeps.md": _markdown(base, source_run, tables),
        "sweeps.csv": _csv(rows),
        "sweeps.svg": _picture(sweeps, rows),
        "sweeps_depth.svg": _depth_picture(base, depth_runs),
    }
    return Part(tuple(_figure(name, rows) for name, *_ in sweeps), tuple(tables), files)


def _figure(name: str, rows: list[VariantRow]) -> Figure:
    """Largest tip difference: of the default from the finest; where the default is the reference, of any variant."""
    mine = [row for row in rows if row.sweep == name]
    default = next(row for row in mine if row.default)
    if default.reference or name == "tolerance":
        return figure(f"sweeps.{name}.tip_mm", "mm", [max(row.tip_max_mm for row in mine)], note="of any variant")
    return figure(f"sweeps.{name}.tip_mm", "mm", [default.tip_max_mm], note="default from the finest")


def _table(name: str, rows: list[VariantRow]) -> Table:
    columns = (
        "variant", "status", "tip end mm", "tip max mm", "entry mean N", "entry max N", "push mean N", "push diff N",
        "sum λ mean N", "sum λ max N", "λ ratio", "min det F", "iterations",
    )  # fmt: skip
    return Table(
        TITLES[name],
        columns,
        tuple(
            (
                _label(row), row.status, row.tip_end_mm, row.tip_max_mm, row.entry_mean_n, row.entry_max_n,
                row.push_mean_n, row.push_apart_n, row.lateral_mean_n, row.lateral_max_n, row.lambda_ratio,
                row.min_det_f, row.iterations,
            )
            for row in rows
        ),
    )  # fmt: skip


def _label(row: VariantRow) -> str:
    marks = [mark for mark, on in (("default", row.default), ("reference", row.reference)) if on]
    return f"{row.variant} ({', '.join(marks)})" if marks else row.variant


def _markdown(base: Scenario, source_run: ObservedRun, tables: list[Table]) -> str:
    rmse = source_run.metrics["rmse_commanded_mm"]
    head = [
        "# One parameter at a time",
        "",
        f"Base poses of an I-FEM run along `{base.name}` with the default discretisation ("
        f"{source_run.metrics['steps']} steps, {source_run.status}, RMSE {'-' if rmse is None else f'{rmse:.3f}'} mm),"
        " replayed in every variant; at another time step they are interpolated. Tip and push differences are to the"
        " variant marked as reference, at the same"
        " time. Entry: lateral force at the constraint point nearest to the entry. Push: axial force of the robot on"
        " the base. λ: lateral constraint forces; their ratio is sum |λ| / |sum λ|, large where neighbouring points"
        " fight each other. Means and maxima are over the insertion, sampled every millimetre. Fixed faces: y = both"
        " faces across y, x = both across x, x0 = x_min alone, z = the back.",
        "",
        "![differences over each parameter](sweeps.svg)",
        "",
        "![forces over depth for each mesh](sweeps_depth.svg)",
        "",
    ]
    return "\n".join(head) + "\n".join(f"\n## {table.title}\n\n{table.markdown()}" for table in tables)


def _csv(rows: list[VariantRow]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(VariantRow)])
    writer.writerows(astuple(row) for row in rows)
    return text.getvalue()


def _series(mine: Sequence[VariantRow], measure: str, *, apart: bool) -> Line:
    """A measure over the sweep's values; apart: without lines between them, where there is nothing between two."""
    points = [(row.place, float(getattr(row, measure))) for row in mine]
    if apart:
        points = [one for point in points for one in (point, (point[0], math.nan))]
    return Line("", [x for x, _ in points], [y for _, y in points])


def _picture(sweeps: Sequence[tuple[str, str, bool, bool]], rows: list[VariantRow]) -> str:
    """A row of panels for each sweep, a column for each measure."""
    grid = []
    for name, x_label, log, named in sweeps:
        mine = [row for row in rows if row.sweep == name]
        names = tuple(row.variant for row in mine) if named else ()
        grid.append(
            [
                Panel(
                    TITLES[name].partition(":")[0] if column == 0 else title,
                    x_label,
                    f"{title}, {unit}" if column == 0 else unit,
                    (_series(mine, measure, apart=named),),
                    x_log=log,
                    y_zero=True,
                    x_names=names,
                )
                for column, (measure, title, unit) in enumerate(MEASURES)
            ]
        )
    return svg(grid, title="The same base poses, another discretisation", width=1280, height=250)


def _depth_picture(base: Scenario, runs: dict[str, ObservedRun]) -> str:
    assert isinstance(base.trajectory, StraightTrajectory)
    speed = base.trajectory.speed_mm_s
    panels = []
    for name, title in (
        ("insertion_force_n", "Axial force on the base"),
        ("entry_force_n", "Lateral force at the entry"),
        ("lateral_sum_n", "sum |λ lateral|"),
    ):
        lines = [
            Line(f"h = {label} mm", (speed * run.series["t_s"]).tolist(), run.series[name].tolist(), markers=False)
            for label, run in runs.items()
        ]
        panels.append(Panel(title, "commanded depth, mm", "N", tuple(lines)))
    return svg([panels], title="Forces over depth for each mesh size", width=1280, height=360)
