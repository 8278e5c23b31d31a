"""The command `needlebench`: which commands there are, and what an error means to the shell.

Commands are imported when they are run, so that help and version cost no more than a Python start.
"""

from __future__ import annotations

import contextlib
import difflib
import importlib
import os
import sys
import traceback
from typing import Any

import click

INTERRUPTED = 130
BROKEN_PIPE = 141
_COMMANDS = {  # name -> (module, what it does); the order is that of the help
    "demo": ("service", "Start a service, run one insertion on it, show the result."),
    "scenario": ("local", "List the built-in scenarios, or print one as JSON."),
    "run": ("local", "Run one insertion in this process."),
    "view": ("local", "Open a recording in the viewer, or make a picture of it."),
    "serve": ("service", "Start the HTTP service."),
    "submit": ("jobs", "Submit a scenario to a service."),
    "upload": ("uploads", "Upload a tissue mesh, a model or a data set to a service."),
    "uploads": ("uploads", "List the uploads of a service; delete or pin one."),
    "jobs": ("jobs", "List the jobs of a service."),
    "show": ("jobs", "Show one job of a service, its events or its log."),
    "cancel": ("jobs", "Cancel a job of a service."),
    "dataset": ("results.datasets", "Run the insertions that learned controllers are trained on, or take others."),
    "paper": ("paper", "Rerun the paper: data set, ELM, insertions, statistics, report."),
    "settle": ("paper", "Run the experiment that settles the claim on curved paths."),
    "train": ("learning", "Train the model of a learned controller."),
    "models": ("models", "List the models of a service, or train one."),
    "mesh": ("meshes", "Show what a mesh file holds: extents, quality, sets, places to enter."),
    "example": ("learning", "Print an example to start from, such as a controller of your own."),
    "edit": ("jobs", "Change name, tags and note of a job."),
    "retry": ("jobs", "Run a failed or cancelled job of a service again."),
    "pin": ("jobs", "Keep a job when old ones are removed."),
    "unpin": ("jobs", "Allow a pinned job to be removed."),
    "recording": ("recording", "Open or download the recording of a job."),
    "series": ("local", "Write the time series of a result as CSV, JSON or Parquet."),
    "verify": ("verify", "Run a result again and compare."),
    "bundle": ("results.bundles", "Put the results of an experiment into one archive; check one, run it again."),
    "leaderboard": ("results.leaderboards", "Make a static site from bundles."),
    "cite": ("results.citations", "Say how to cite needlebench, suites and bundles."),
    "gc": ("operations", "Remove old jobs with their files, and unused uploads."),
    "backup": ("backups", "Back up a data folder while its service works."),
    "restore": ("backups", "Put a backup in the place of a data folder's database."),
    "doctor": ("operations", "Check this installation: versions, cache, disk, port, viewer, data folder."),
    "key": ("keys", "Create, list and revoke the API keys of a data folder."),
    "campaign": ("campaigns", "Run suites and parameter grids, compare them, show their trend."),
    "cluster": ("cluster.commands", "Start the processes of a cluster, or write the scripts for Slurm."),
    "schedule": ("schedules", "Run campaigns at set times."),
    "bench": ("bench", "Measure speed and convergence, or compare two measurements."),
}
_EPILOG = """
\b
See it work, from nothing to a recording:
  needlebench demo

\b
One run in this process, with your own changes:
  needlebench scenario demo > mine.json
  needlebench run mine.json --out results/first --set tissue.young_kpa=4.5
  needlebench view results/first/recording.rrd

\b
A service that runs jobs for you, in a second terminal:
  needlebench serve
  needlebench submit mine.json --wait
  needlebench jobs

\b
Exit codes of run, submit --wait and demo:
  0 successful   3 completed without success, or not converged
  2 bad input    1 crash (where: needlebench --debug ...)   130 Ctrl-C
  141 whoever read the output has closed it
"""


class Commands(click.Group):
    """A group that imports a command when it is run, and turns errors into one line and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  (click's signature)
        """The names of the commands, in the order of the help."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002  (click's signature)
        """Import a command; None for an unknown one."""
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"service.cli.{_COMMANDS[cmd_name][0]}")
        command = getattr(module, cmd_name)
        return command if isinstance(command, click.Command) else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, with a list of the commands in the message about an unknown one."""
        if args and args[0] not in _COMMANDS and not args[0].startswith("-"):
            close = difflib.get_close_matches(args[0], _COMMANDS, n=1)
            meant = f" Did you mean {close[0]}?" if close else ""
            ctx.fail(f"No such command {args[0]!r}.{meant} There are: {', '.join(_COMMANDS)}.")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  (click's)
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in _COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; an error becomes a line on stderr and an exit code."""
        _let_any_text_through()
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except BrokenPipeError:
            _drop_output()
            ctx.exit(BROKEN_PIPE)
        except KeyboardInterrupt:
            click.echo("needlebench: interrupted", err=True)
            ctx.exit(INTERRUPTED)
        except Exception as error:  # noqa: BLE001  (whatever goes wrong becomes an exit code)
            ctx.exit(_report(error, debug=bool(ctx.params.get("debug"))))


def _let_any_text_through() -> None:
    """A locale without some characters shows escapes in their place."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, ValueError):  # replaced by a test or a program
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


def _drop_output() -> None:
    """Whoever read the output is gone, as `head` is: what is left of it goes nowhere, without a word."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _report(error: Exception, *, debug: bool) -> int:
    """Say on stderr what went wrong; the exit code that goes with it."""
    from simcore.errors import NeedlebenchError, ScenarioError

    if debug:
        traceback.print_exception(error, file=sys.stderr)
    if isinstance(error, ScenarioError):
        for problem in error.problems:
            click.echo(f"needlebench: {problem}", err=True)
        return 2
    if isinstance(error, NeedlebenchError):
        click.echo(f"needlebench: {error}", err=True)
    elif isinstance(error, ModuleNotFoundError):
        click.echo(f"needlebench: this command needs the package {error.name}, which is not installed.", err=True)
        click.echo("A core installation runs insertions without recordings; pip install needlebench has all.", err=True)
    elif not debug:
        text = str(error).strip().split("\n")[0]
        click.echo(f"needlebench: crashed: {type(error).__name__}: {text}", err=True)
        click.echo("To see where: needlebench --debug ... or NEEDLEBENCH_DEBUG=1", err=True)
    return 1


def _print_version(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from service.version import installed_version

        click.echo(f"needlebench {installed_version()}")
        ctx.exit()


@click.command(
    cls=Commands,
    epilog=_EPILOG,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Print the version and exit.",
)
@click.option("--debug", is_flag=True, envvar="NEEDLEBENCH_DEBUG", help="Show the traceback of a crash.")
def main(debug: bool) -> None:
    """Reproducible benchmarks for robotic needle steering in deforming tissue.

    Simulates a flexible needle that a robot steers through a deforming block of soft tissue, measures how well it
    follows its path, and records everything for viewing.
    """
