"""The result of a run as a table on a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.display import flat, shown, size_text
from service.worker.attempt import KINDS

if TYPE_CHECKING:
    from rich.table import Table


def print_report(result: dict[str, Any], folder: Path) -> None:
    """Metrics, timings, digest and files of a finished run, on standard output."""
    from rich.console import Console
    from rich.table import Table

    scenario = result.get("provenance", {}).get("scenario", {})
    good = result["status"] == "completed" and result["metrics"].get("success")
    click.echo(f"{scenario.get('name', 'run')}: {result['status']}{'' if good else ', without success'}")
    if result.get("message"):
        click.echo(result["message"])
    values = Table.grid(padding=(0, 2))
    values.add_column()
    values.add_column(justify="right")
    for group in ("metrics", "solver"):
        for key, value in flat(result.get(group, {})):
            values.add_row(f"  {key}", shown(value))
    rows = {part: data for part, data in result.get("timing", {}).items() if isinstance(data, dict)}
    for key, value in result.get("timing", {}).items():
        if key not in rows:
            values.add_row(f"  {key}", shown(value))
    console = Console(highlight=False)
    console.print(values, "")
    console.print(_timing(rows), "")
    click.echo(f"  digest {result['digest']}")
    for path in [folder / name for name in KINDS if (folder / name).exists()]:
        click.echo(f"  {path} ({size_text(path.stat().st_size)})")
    if (folder / "recording.rrd").exists():
        click.echo(f"Look at it: needlebench view {folder / 'recording.rrd'}")


def _timing(rows: dict[str, dict[str, Any]]) -> Table:
    """A row for each part of a step, a column for each statistic."""
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    statistics = list(next(iter(rows.values()), {}))
    table.add_column()
    for _ in statistics:
        table.add_column(justify="right")
    table.add_row("  step time", *statistics)
    for part, data in rows.items():
        table.add_row(f"  {part}", *(shown(data.get(name)) for name in statistics))
    return table
