"""The bands of the discretisation as a table, a picture and JSON, which suites and claims read."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.measurements import Part, Table, figure
from benchmarks.studies.closed_loop import loop_suite_bands
from benchmarks.studies.closed_loop_report import PICTURE, loop_json, loop_markdown, loop_picture, loop_tables
from benchmarks.svg_plot import Line, Panel, svg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.studies.closed_loop import LoopPath
    from benchmarks.studies.discretisation import Discretisation
    from benchmarks.studies.grid_convergence import GridBand

SCHEMA = "needlebench/convergence/1"
TITLES = {
    "tip_end_mm": "tip at the end",
    "tip_path_mm": "tip along the path (RMS)",
    "entry_force_n": "mean entry force, first 12 mm",
    "push_n": "mean push",
}


@dataclass(frozen=True)
class QuantityBand:
    """Of one quantity along one path. parts: by series, "mesh" and "spacing". apart: distance of each discretisation,
    (series, size in mm), from the default. size: of the default's value where a share of it makes sense."""

    parts: Mapping[str, GridBand]
    apart: Mapping[tuple[str, float], float]
    size: float | None

    @property
    def default(self) -> float:
        """Of the default from the limit: mesh and spacing added up."""
        return sum(part.default for part in self.parts.values())

    def as_json(self) -> dict[str, Any]:
        """With the orders that were observed, null where there was none."""
        return {
            "band": _short(self.default),
            "share": None if not self.size else _short(self.default / self.size),
            "value": None if self.size is None else _short(self.size),
            "parts": {
                name: {
                    "order": None if part.order is None else _short(part.order),
                    "swings": part.swings,
                    "finest": _short(part.finest),
                    "default": _short(part.default),
                }
                for name, part in self.parts.items()
            },
            "apart": {f"{name} {size:g}": _short(value) for (name, size), value in self.apart.items()},
        }


@dataclass(frozen=True)
class PathBands:
    """Of one path, up to a depth that all discretisations reach. statuses: of their runs."""

    name: str
    depth_mm: float
    statuses: Mapping[str, str]
    bands: Mapping[str, QuantityBand]


def band_part(
    dt_s: float,
    paths: Sequence[PathBands],
    suites: Mapping[str, Sequence[str]],
    loops: Sequence[LoopPath],
    chosen: Discretisation,
) -> Part:
    """Everything that is written. suites: the paths whose worst band each carries. loops: the closed loops."""
    table = _table(paths)
    worst = suite_bands(paths, suites)
    document = {
        "schema": SCHEMA,
        "dt_s": dt_s,
        "band_mm": max(bands["tip_path_mm"] for bands in worst.values()),
        "suites": worst,
        "paths": {
            path.name: {
                "depth_mm": path.depth_mm,
                "statuses": dict(path.statuses),
                "quantities": {name: band.as_json() for name, band in path.bands.items()},
            }
            for path in paths
        },
        "closed_loop": loop_json(loops, chosen),
    }
    files = {
        "convergence.json": json.dumps(document, indent=1, allow_nan=False) + "\n",
        "convergence.md": f"{_markdown(dt_s, table, worst)}\n{loop_markdown(loops)}",
        "convergence.svg": _picture(paths),
        PICTURE: loop_picture(loops),
    }
    figures = [figure(f"convergence.{s}.tip_path_mm", "mm", [bands["tip_path_mm"]]) for s, bands in worst.items()]
    figures += [
        figure(f"convergence.{suite}.{quantity.replace(' ', '_')}_mm", "mm", [] if band is None else [band])
        for suite, bands in loop_suite_bands(loops).items()
        for quantity, band in bands.items()
    ]
    return Part(tuple(figures), (table, *loop_tables(loops)), files)


def suite_bands(paths: Sequence[PathBands], suites: Mapping[str, Sequence[str]]) -> dict[str, dict[str, float]]:
    """By suite and quantity the widest band of its paths; of forces the share of their value."""
    by_name = {path.name: path for path in paths}
    return {
        suite: {
            quantity.replace("_n", "_share"): max(_claimed(by_name[name].bands[quantity]) for name in names)
            for quantity in TITLES
        }
        for suite, names in suites.items()
    }


def _claimed(band: QuantityBand) -> float:
    return _short(band.default if not band.size else band.default / band.size)


def _short(value: float) -> float:
    return float(f"{value:.3g}")


def _table(paths: Sequence[PathBands]) -> Table:
    rows = []
    for path in paths:
        for quantity, band in path.bands.items():
            mesh, spacing = band.parts["mesh"], band.parts["spacing"]
            share = 100.0 * band.default / band.size if band.size else None
            rows.append(
                (
                    path.name, TITLES[quantity], quantity.rsplit("_", 1)[1].upper().replace("MM", "mm"), band.size,
                    _order(mesh), mesh.default, _order(spacing), spacing.default, band.default, share,
                )
            )  # fmt: skip
    columns = (
        "path", "quantity", "unit", "value", "order h", "band h", "order spacing", "band spacing", "band", "%",
    )  # fmt: skip
    return Table("Bands of the default discretisation", columns, tuple(rows))


def _order(part: GridBand) -> str:
    if part.swings:
        return "swings"
    return "-" if part.order is None else f"{part.order:.2f}"


def _markdown(dt_s: float, table: Table, worst: Mapping[str, Mapping[str, float]]) -> str:
    columns = next(iter(worst.values())).keys()
    suites = Table("", ("suite", *columns), tuple((name, *bands.values()) for name, bands in worst.items()))
    return "\n".join(
        [
            "# Convergence",
            "",
            "Base poses of I-FEM on the default discretisation, replayed open loop in three meshes and three spacings, "
            f"steps of {1e3 * dt_s:g} ms. Band: how far the default may be from the limit, the change to the finest"
            " plus Roache's grid convergence index of the finest, mesh and spacing added up. Where the results swing,"
            " the largest difference between any two; an observed order outside 0.5 to 2 is not believed: order 1,"
            " safety factor 3.",
            "",
            "![differences from the default](convergence.svg)",
            "",
            f"## {table.title}",
            "",
            table.markdown(),
            "## What a suite carries: the widest band of its paths",
            "",
            suites.markdown(),
        ]
    )


def _picture(paths: Sequence[PathBands]) -> str:
    """A row for mesh and spacing each, a column for each quantity: distance from the default over the size."""
    grid = []
    for series, label in (("mesh", "h, mm"), ("spacing", "spacing, mm")):
        row = []
        for quantity, title in TITLES.items():
            lines = []
            for path in paths:
                apart = {size: value for (name, size), value in path.bands[quantity].apart.items() if name == series}
                lines.append(Line(path.name, list(apart), list(apart.values())))
            unit = "mm" if quantity.endswith("mm") else "N"
            row.append(Panel(title, label, f"from the default, {unit}", tuple(lines), y_zero=True))
        grid.append(row)
    return svg(grid, title="The same base poses, another discretisation", width=1280, height=280)
