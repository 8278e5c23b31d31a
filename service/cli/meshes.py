"""The command that says what a mesh file holds, before anything is simulated with it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from simcore.mesh.summary import MeshSummary


@click.command()
@click.argument("file")
@click.option("--unit-mm", type=click.FloatRange(1e-3, 1e4), help="Unit of length of the file; default: guessed.")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
def mesh(file: str, unit_mm: float | None, as_json: bool) -> None:
    """Show what a mesh file holds: extents, nodes, quality, sets, and places to enter.

    FILE is a .msh, .vtu, .vtk, .mesh or .inp file with linear tetrahedra. Lengths are in mm; the unit of the file is
    guessed from its extents. Nothing is simulated.

    \b
    A file of your own:  needlebench mesh liver.msh
    In metres:           needlebench mesh liver.msh --unit-mm 1000
    For a program:       needlebench mesh liver.msh --json

    Exit code: 0 it can be used, 2 it cannot.
    """
    from simcore.mesh.summary import summary_of

    summary = summary_of(file, unit_mm)
    click.echo(json.dumps(summary.as_json(), indent=2) if as_json else as_text(file, summary))


def as_text(file: str, summary: MeshSummary) -> str:
    """The summary as people read it, with the changes that use the file; names cannot act upon the terminal."""
    from simcore.mesh.reading import printable

    guess = ", guessed from the extents" if summary.unit_guessed else ""
    sets = [
        f"{name} ({held} nodes)" if isinstance(held, int) else f"{name}: {held}" for name, held in summary.sets.items()
    ]
    rows = [
        ("unit", f"{summary.unit_mm:g} mm{guess}"),
        ("extents", f"{_point(summary.low_mm)} to {_point(summary.high_mm)} mm"),
        ("size", f"{summary.nodes} nodes, {summary.tetrahedra} tetrahedra of {summary.element_mm:g} mm on average"),
        ("quality", f"worst {summary.shape_worst:g}, mean {summary.shape_mean:g} (1 = regular, 0 = flat)"),
        ("flat sides", ", ".join(summary.flat_sides) or "none"),
        *[("sets" if i == 0 else "", one) for i, one in enumerate(sets or ["none"])],
        *[("by number" if i == 0 else "", one) for i, one in enumerate(summary.other_names)],
        *[("left out" if i == 0 else "", one) for i, one in enumerate(summary.left_out)],
        *[
            ("enter at" if i == 0 else "", f"{_point(e.entry_mm)}, inward {_point(e.inward)}, {e.depth_mm:.4g} mm deep")
            for i, e in enumerate(summary.entries)
        ],
    ]
    return "\n".join([*(f"{name:<12}{printable(text)}" for name, text in rows), "", _changes(file, summary)])


def _changes(file: str, summary: MeshSummary) -> str:
    """Options for `needlebench run` that use the file and its first place to enter."""
    options = [f"tissue.mesh_file={file}"]
    if summary.unit_mm != 1.0:
        options.append(f"tissue.mesh_unit_mm={summary.unit_mm:g}")
    held = next(
        (name for name, nodes in summary.sets.items() if isinstance(nodes, int) and nodes < summary.nodes), None
    )
    options.append(f"'tissue.fixed_sets={json.dumps([held or 'NAME'], ensure_ascii=not (held or '').isprintable())}'")
    if summary.entries:
        entry = summary.entries[0]
        target = [e + 0.5 * entry.depth_mm * n for e, n in zip(entry.entry_mm, entry.inward, strict=True)]
        options += [f"'trajectory.entry_mm={_point(entry.entry_mm)}'", f"'trajectory.target_mm={_point(target)}'"]
    return "use it with\n" + " \\\n".join(f"  --set {option}" for option in options)


def _point(values: list[float]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"
