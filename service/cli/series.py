"""`needlebench series`: the time series of a result in other formats."""

from __future__ import annotations

from pathlib import Path

import click

FILE = "series.npz"


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--to", "kind", type=click.Choice(["csv", "json", "parquet"]), default="csv", show_default=True)
@click.option(
    "--out",
    "path",
    metavar="FILE",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write, instead of standard output; Parquet needs one.",
)
@click.option("--names", metavar="A,B,...", help="Only these arrays; default: all with one row a step.")
def series(result: Path, kind: str, path: Path | None, names: str | None) -> None:
    """Write the time series of RESULT, one row a step: its folder, or the series.npz in it.

    Vectors have a column for each component: tip_m_x, tip_m_y, tip_m_z. SI units, world frame; rotations are
    quaternions w, x, y, z. Row 0 is the initial state.

    \b
    A table to plot:     needlebench series results/demo > demo.csv
    For pandas:          needlebench series results/demo --to parquet --out demo.parquet
    What is asked for:   needlebench series results/demo --names t_s,tip_m,target_m --to json
    """
    from service.files import series_formats
    from simcore.errors import Problem, ScenarioError

    file = result / FILE if result.is_dir() else result
    if not file.is_file():
        raise ScenarioError([Problem("RESULT", str(result), f"is no folder with a {FILE}, and no such file")])
    if kind == "parquet" and path is None:
        raise ScenarioError([Problem("--to", kind, "is not for a terminal: name a file with --out")])
    try:
        arrays = series_formats.load(file, names.split(",") if names else None)
        if kind == "parquet" and path is not None:
            series_formats.write_parquet(arrays, path)
            return
        text = series_formats.as_csv(arrays) if kind == "csv" else series_formats.as_json(arrays) + "\n"
    except series_formats.DamagedSeriesError as error:
        raise ScenarioError([Problem("RESULT", str(file), str(error))]) from None
    except ValueError as error:
        raise ScenarioError([Problem("--names", names, str(error))]) from None
    if path is None:
        click.echo(text, nl=False)
    else:
        path.write_text(text, encoding="utf-8", newline="")
