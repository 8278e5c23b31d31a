"""The commands that need no service: list scenarios, run one in this process, view a recording, write its series."""

from __future__ import annotations

import json
import sys
import uuid
from pathlib import Path
from typing import Any

import click

WITHOUT_SUCCESS = 3
SERIES = "series.npz"


@click.command()
@click.argument("name", required=False)
@click.option("--fields", is_flag=True, help="Print every field with default, range and source, as a Markdown table.")
def scenario(name: str | None, fields: bool) -> None:
    """List the built-in scenarios, or print the one called NAME as JSON with every field and its value.

    A value of null is derived from other fields, as the spacing of the constraint points is.

    \b
    The built-in ones:            needlebench scenario
    A file to change and run:     needlebench scenario demo > mine.json
    Every field, with its range:  needlebench scenario --fields
    """
    from simcore.scenario.parameters import markdown_table
    from simcore.scenario.presets import preset_names, start

    if fields:
        click.echo(markdown_table())
        return
    if name is not None:
        click.echo(json.dumps(start(name), indent=2))
        return
    names = preset_names()
    for known, text in names.items():
        click.echo(f"{known:<{max(map(len, names)) + 2}}{text}")


@click.command()
@click.argument("source", metavar="SCENARIO")
@click.option(
    "--out",
    "folder",
    metavar="DIR",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for result.json, series.npz and recording.rrd; created if needed.",
)
@click.option(
    "--set",
    "changes",
    metavar="PATH=VALUE",
    multiple=True,
    help="Change one field; VALUE is JSON, else a string. Repeatable, applied left to right.",
)
@click.option(
    "--waypoints",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Follow the smooth curve from the entry through the points of a .csv file: x_mm, y_mm, z_mm, one row a point.",
)
@click.option("--force", is_flag=True, help="Replace the result that the folder holds.")
@click.option(
    "--controller-command",
    "command",
    metavar="COMMAND",
    help="For controller.kind = remote: start this beside the run; {address} in it is where the run waits.",
)
def run(
    source: str, folder: Path, changes: tuple[str, ...], waypoints: Path | None, force: bool, command: str | None
) -> None:
    """Run one insertion in this process and write its result.

    SCENARIO is a JSON file, the name of a built-in scenario, or - for JSON on standard input. Fields that it leaves
    out have their defaults. The files are written when the run has ended: all of them or none.

    \b
    A built-in one:             needlebench run demo --out results/demo
    Softer tissue, no feedback: needlebench run demo --out results/soft \\
                                  --set tissue.young_kpa=3 --set controller.kind=open_loop
    Metrics only, no recording: needlebench run demo --out results/quick --set recording.enabled=false
    Along points of your own:   needlebench run line --out results/mine --waypoints points.csv
    From another program:       generate | needlebench run - --out results/generated

    Setting a kind replaces its block by the defaults of that kind: set the kind first, then its fields.

    \b
    A controller in another program, any language (see `needlebench example remote`):
      needlebench run line --out results/mine --set controller.kind=remote \\
        --controller-command "python mine.py {address}"
    Without --controller-command the run waits for it: start it yourself.

    \b
    Exit code: 0 completed and successful
               3 completed without success, or not converged: see status in result.json
               2 bad scenario or folder, 1 crash, 130 Ctrl-C: nothing is written
    """
    from service.cli.result_table import print_report
    from service.local.remote import controller_beside
    from service.local.run import output_folder, run_into
    from simcore.scenario.presets import with_changes
    from simcore.scenario.scenario import Scenario
    from simcore.scenario.waypoint_file import with_waypoints

    data = with_changes(read_source(source), list(changes))
    chosen = Scenario.load(with_waypoints(data, waypoints) if waypoints else data)
    told = chosen.warnings()
    for warning in told:
        click.echo(f"needlebench: warning: {warning}", err=True)
    with output_folder(folder, replace=force) as partial, controller_beside(chosen, command):
        result, incomplete = run_into(partial, chosen, recording_id=uuid.uuid4().hex)
    found = [warning for warning in result["warnings"] if warning not in told]
    for warning in [*found, incomplete] if incomplete else found:
        click.echo(f"needlebench: warning: {warning}", err=True)
    print_report(result, folder)
    if result["status"] != "completed" or not result["metrics"]["success"]:
        click.get_current_context().exit(WITHOUT_SUCCESS)


def read_source(source: str) -> dict[str, Any]:
    """The scenario's JSON object, before defaults. Raises ScenarioError."""
    from simcore.errors import Problem, ScenarioError
    from simcore.scenario.presets import preset_names, start
    from simcore.scenario.suggestions import did_you_mean

    if source != "-" and not Path(source).is_file():
        if source in preset_names():
            return start(source)
        known = ", ".join(preset_names())
        meant = did_you_mean(source, preset_names())
        raise ScenarioError([Problem("SCENARIO", source, f"is neither a file nor a built-in scenario: {known}{meant}")])
    try:
        data = json.loads(sys.stdin.buffer.read() if source == "-" else Path(source).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError([Problem("SCENARIO", source, f"is not readable JSON: {error}")]) from None
    if not isinstance(data, dict):
        raise ScenarioError([Problem("SCENARIO", source, "must hold a JSON object")])
    return data


class Size(click.ParamType[tuple[int, int]]):
    """WIDTHxHEIGHT in pixels."""

    name = "WIDTHxHEIGHT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """(width, height) from the text."""
        if isinstance(value, tuple):
            return value
        width, _, height = str(value).lower().partition("x")
        if not (width.isdigit() and height.isdigit() and 200 <= int(width) <= 8000 and 200 <= int(height) <= 8000):
            self.fail(f"{value!r} must be WIDTHxHEIGHT in pixels, each 200 to 8000, as in 1600x900", param, ctx)
        return int(width), int(height)


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--screenshot",
    "picture",
    metavar="PNG",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Make a picture instead of opening a window; needs no display.",
)
@click.option("--at", "at_s", type=float, help="Simulated time of the picture in seconds; default: the end.")
@click.option("--size", type=Size(), default="1600x900", show_default=True, help="Window that is pictured, in pixels.")
def view(file: Path, picture: Path | None, at_s: float | None, size: tuple[int, int]) -> None:
    """Open the recording FILE in the Rerun viewer, until its window is closed; or make a picture of it.

    The viewer listens on 127.0.0.1 only and sends no usage data. In the window: drag to turn, space to play.

    \b
    Open a run:      needlebench view results/demo/recording.rrd
    For a document:  needlebench view results/demo/recording.rrd --screenshot demo.png --at 8
    """
    from service.recording import viewer

    if picture is not None:
        from service.recording.screenshot import screenshot

        screenshot(file, picture, at_s=at_s, size=size)
        click.echo(picture)
        return
    click.get_current_context().exit(viewer.show(file))


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

    file = result / SERIES if result.is_dir() else result
    if not file.is_file():
        raise ScenarioError([Problem("RESULT", str(result), f"is no folder with a {SERIES}, and no such file")])
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
