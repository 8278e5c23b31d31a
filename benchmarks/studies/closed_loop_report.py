"""The bands of closed loops as tables, a picture and JSON, which claims about an RMSE are measured against."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchmarks.measurements import Table
from benchmarks.studies.closed_loop import CONTROLLERS, DIFFERENCES, loop_suite_bands, quantities
from benchmarks.studies.discretisation import LOOP_DT_S
from benchmarks.studies.grid_convergence import ORDERS, RANGE_SAFETY
from benchmarks.svg_plot import Line, Panel, svg
from simcore.provenance import commit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.studies.closed_loop import LoopBand, LoopPath
    from benchmarks.studies.discretisation import Discretisation
    from benchmarks.studies.grid_convergence import GridBand

PICTURE = "closed_loop.svg"
TITLES = {
    "ifem": "I-FEM",
    "ifem-axis": "I-FEM, axis",
    "elm": "ELM",
    "elm minus ifem": "ELM minus I-FEM",
    "elm minus ifem-axis": "ELM minus I-FEM, axis",
}


def loop_json(paths: Sequence[LoopPath], chosen: Discretisation) -> dict[str, Any]:
    """What stands in convergence.json; null = unknown."""
    return {
        "commit": commit(),
        "discretisation": {
            "element_size_mm": chosen.element_size_mm,
            "spacing_mm": chosen.spacing_mm,
            "spread_mm": chosen.balls_mm[0],
            "dt_s": LOOP_DT_S,
        },
        "suites": {s: {q: short(b) for q, b in bands.items()} for s, bands in loop_suite_bands(paths).items()},
        "paths": {path.name: _path_json(path) for path in paths},
    }


def _path_json(path: LoopPath) -> dict[str, Any]:
    return {
        "suite": path.suite,
        "rmse_commanded_mm": {quantity: _band_json(path.band(quantity)) for quantity in quantities()},
        "rcm_max_mm": {
            name: {
                f"{s.name} {h:g}": short(path.runs[name, s.name, h].rcm_max_mm) for s in path.series for h in s.sizes_mm
            }
            for name in CONTROLLERS
        },
        "statuses": {
            name: {f"{s.name} {h:g}": path.runs[name, s.name, h].status for s in path.series for h in s.sizes_mm}
            for name in CONTROLLERS
        },
    }


def _band_json(band: LoopBand) -> dict[str, Any]:
    parts = None
    if band.parts is not None:
        parts = {
            name: {"order": short(part.order), "swings": part.swings, "default": short(part.default)}
            for name, part in band.parts.items()
        }
    values = {f"{name} {size:g}": short(value, 6) for (name, size), value in band.values.items()}
    return {"band": short(band.band), "parts": parts, "values": values}


def short(value: float | None, digits: int = 3) -> float | None:
    """A number for readers."""
    return None if value is None else float(f"{value:.{digits}g}")


# ---- tables


def loop_tables(paths: Sequence[LoopPath]) -> tuple[Table, Table, Table]:
    """Bands of the suites; RMSE and differences path by path; the RCM error beside it."""
    suites = loop_suite_bands(paths)
    carried = Table(
        "Closed loop: the widest band of a suite's paths, mm",
        ("suite", *(TITLES[quantity] for quantity in quantities())),
        tuple((suite, *(short(band) for band in bands.values())) for suite, bands in suites.items()),
    )
    columns = _sizes(paths[0])
    head = tuple(f"{name} {size:g}" for name, size in columns)
    bands = Table(
        "Closed loop: RMSE in every discretisation and the default's band, mm",
        ("path", "quantity", "default", *head, "band mesh", "band spacing", "band ball", "band"),
        tuple(_row(path, quantity, columns) for path in paths for quantity in quantities()),
    )
    rcm = Table(
        "Closed loop: largest RCM error, mm",
        ("path", "controller", "default", *head),
        tuple(
            (path.name, TITLES[name], *(path.runs[name, *key].rcm_max_mm for key in (_default(path), *columns)))
            for path in paths
            for name in CONTROLLERS
        ),
    )
    return carried, bands, rcm


def _default(path: LoopPath) -> tuple[str, float]:
    series = path.series[0]
    return series.name, series.sizes_mm[series.default]


def _sizes(path: LoopPath) -> list[tuple[str, float]]:
    """Every discretisation but the default, which each series has."""
    return [(s.name, h) for s in path.series for i, h in enumerate(s.sizes_mm) if i != s.default]


def _row(path: LoopPath, quantity: str, columns: Sequence[tuple[str, float]]) -> tuple[Any, ...]:
    band = path.band(quantity)
    parts = band.parts or {}
    shown = (_part(parts, series.name) for series in path.series)
    values = (band.values[key] for key in (_default(path), *columns))
    return (path.name, TITLES[quantity], *values, *shown, band.band)


def _part(parts: Mapping[str, GridBand], name: str) -> float | None:
    return parts[name].default if name in parts else None


def loop_markdown(paths: Sequence[LoopPath]) -> str:
    """The second part of convergence.md."""
    carried, bands, rcm = loop_tables(paths)
    return "\n".join(
        [
            "## Closed loops",
            "",
            "I-FEM with its default weight of the remote-centre rows, I-FEM with the axis through the entry, and the "
            f"packaged ELM, each undelayed, along {len(paths)} paths in steps of {1e3 * LOOP_DT_S:g} ms. Band: "
            "how far the RMSE against the commanded target may be from the limit, mesh, spacing and ball added up: "
            f"Roache's grid convergence index where an order between {ORDERS[0]:g} and {ORDERS[1]:g} is observed; "
            f"else, and for the two balls, {RANGE_SAFETY:g} times the data range (Eca and Hoekstra 2008). A dash: a "
            "run did not reach the end.",
            "",
            f"![RMSE in other discretisations]({PICTURE})",
            "",
            *(line for table in (carried, bands, rcm) for line in (f"### {table.title}", "", table.markdown())),
        ]
    )


def loop_picture(paths: Sequence[LoopPath]) -> str:
    """A row for each series, a column for each quantity: the change from the default over the size."""
    grid = []
    for series, label in zip(paths[0].series, ("h, mm", "spacing, mm", "radius of the ball, mm"), strict=True):
        row = []
        for quantity in quantities():
            lines = tuple(_line(path, quantity, series.name, series.sizes_mm) for path in paths)
            title = f"{TITLES[quantity]}{'' if quantity in DIFFERENCES else ', RMSE'}"
            row.append(Panel(title, label, "from the default, µm", lines))
        grid.append(row)
    return svg(grid, title="The same controllers, another discretisation", width=1600, height=280)


def _line(path: LoopPath, quantity: str, series: str, sizes_mm: Sequence[float]) -> Line:
    default = path.value(quantity, *_default(path))
    values = [path.value(quantity, series, size) for size in sizes_mm]
    known = [float("nan") if v is None or default is None else 1e3 * (v - default) for v in values]
    return Line(path.name, list(sizes_mm), known)
