"""`needlebench campaign`: many insertions at once."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.cli.campaign_request import campaign_request, check_request
from service.cli.campaign_text import (
    BESIDE_HEAD,
    follow_campaign,
    print_comparisons,
    print_plan,
    print_scores,
    print_trend,
    trend_line,
    where,
)
from service.cli.cluster.campaign_here import folder_options, run_here
from service.cli.connection import data_option, service_client, url_option, with_field_errors
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.client.campaigns import CampaignStatus
    from service.client.client import Client

REGRESSION = 1
_file = click.Path(dir_okay=False, path_type=Path)
grid_option = click.option(
    "--grid",
    "axes",
    metavar="FIELD=V1,V2,...",
    multiple=True,
    help="Values of a scenario field or block, instead of a suite; every combination is run. Values are JSON or words, "
    "or those of a JSON list in a file: FIELD=@FILE.",
)
controller_option = click.option(
    "--controller",
    "controllers",
    metavar="NAME[:FIELD=V,...]",
    multiple=True,
    help="A controller to compare: a kind with its fields, or an installed plug-in with its settings. Repeatable.",
)
scenario_option = click.option(
    "--scenario", "source", metavar="SCENARIO", help="Scenario under the grid; default: all defaults."
)
model_option = click.option(
    "--model", default="default", show_default=True, help="Model of the suite's learned controllers."
)


@click.group()
def campaign() -> None:
    """Run suites and parameter grids on a service, compare them, follow their trend over commits.

    \b
    The named suites:         needlebench campaign suites
    What one would cost:      needlebench campaign run lin100-v2-quick --dry-run
    Run it, with a report:    needlebench campaign run lin100-v2-quick --report report.html
    A grid of your own:       needlebench campaign run --scenario line --grid controller.gain=0.5,1 --grid dt_s=0.01,0.1
    In a nightly job:         needlebench campaign run lin100-v2-quick --fail-on-regression
    """


@campaign.command()
@url_option
def suites(url: str | None) -> None:
    """List the named suites. Needs no service.

    \b
    What can be run by name:  needlebench campaign suites
    """
    if url is not None:
        with service_client(url) as client:
            titles = client.suites()
    else:
        from benchmarks.suites.catalogue import suite_names

        titles = suite_names()
    for name, title in titles.items():
        click.echo(f"{name:<24}{title}")


@campaign.command()
@click.argument("suite", required=False)
@controller_option
@grid_option
@scenario_option
@model_option
@click.option("--name", help="Its name in lists; default: the suite's name. The trend of a grid goes by its name.")
@click.option("--priority", type=click.IntRange(-100, 100), default=-10, show_default=True, help="Of its jobs.")
@click.option("--dry-run", is_flag=True, help="Only say how many jobs it would take and how long.")
@click.option("--detach", is_flag=True, help="Print the id and do not wait; needs a running service.")
@click.option("--csv", "csv_file", metavar="FILE", type=_file, help="Write a table, one line per insertion.")
@click.option("--report", "report_file", metavar="FILE", type=_file, help="Write the report page.")
@click.option("--fail-on-regression", is_flag=True, help="Exit with 1 if it is worse than earlier runs of the suite.")
@folder_options
@data_option
@url_option
@click.pass_context
def run(
    ctx: click.Context, /, suite: str | None, url: str | None, data: Path | None, detach: bool, **options: Any
) -> None:
    """Run a named suite, or controllers over a grid, and print scores, comparisons and warnings.

    Uses the service at --url, or the one on the data folder, or starts one that ends with the command; either way all
    is kept in the data folder, and after Ctrl-C or a crash the next service resumes it. Regressions are judged against
    earlier runs in that folder: accuracy by digests and paired tests, time against the same machine.

    \b
    A suite, with a report:   needlebench campaign run lin100-v2-quick --report report.html
    What it would cost:       needlebench campaign run lin100-v2 --dry-run
    Controllers on paths:     needlebench campaign run --controller ifem --controller elm --grid trajectory=@paths.json
    A grid, with a trend:     needlebench campaign run --scenario line --grid tissue.young_kpa=3,6.3 --name stiffness
    By cron or in CI:         needlebench campaign run lin100-v2-quick --fail-on-regression --csv table.csv

    \b
    Without a service:        needlebench campaign run lin100-v2 --out out/lin --workers 2
    On a cluster:             needlebench campaign run lin100-v2 --out out/lin --cluster file:cluster/scheduler.json

    With --out nothing is kept in the data folder: DIR has each insertion with its series as soon as it has ended, and
    campaign.parquet in the end; the same command goes on where it was interrupted. `needlebench bundle make DIR` and
    `dataset --from DIR` take it.

    \b
    Exit code: 0 done; 1 a regression (with --fail-on-regression), or jobs without a result
               2 bad input; 130 Ctrl-C
    """
    request = campaign_request(suite, options)
    for option, file in (("--csv", options["csv_file"]), ("--report", options["report_file"])):
        if file is not None and not file.absolute().parent.is_dir():  # reported now, not after all jobs have run
            raise ScenarioError([Problem(option, str(file), f"there is no folder {file.absolute().parent}")])
    if url is None and not detach:
        check_request(request)
    if run_here(ctx, request, {**options, "url": url, "data": data, "detach": detach}):
        return
    with _service(url, data, detach) as client:
        if options["dry_run"]:
            print_plan(client.plan_campaign(request))
            return
        started = client.start_campaign(request)
        click.echo(started.id)
        if detach:
            return
        done = follow_campaign(client, started)
        _save(client, done, options["csv_file"], options["report_file"])
        print_scores(client.campaign_results(done.id))
        worse = print_trend(client, done)
        lost = done.cases - done.jobs.get("finished", 0)
        if lost:
            click.echo(f"{lost} of {done.cases} jobs have no result", err=True)
        if lost or (worse and options["fail_on_regression"]):
            ctx.exit(REGRESSION)


@contextmanager
def _service(url: str | None, data: Path | None, detach: bool) -> Iterator[Client]:
    """A client of the service at `url`, or of that on the data folder, which is started if none is running."""
    if url is not None or detach:
        with service_client(url) as client:
            yield client
        return
    from service.client.client import Client
    from service.server.local_service import running_service
    from service.settings import DEFAULT_HOST, Settings

    settings = Settings.load(data=data, host=DEFAULT_HOST, port=0)
    with running_service(settings) as (address, _), Client(address, settings.api_key) as client, with_field_errors():
        yield client


def _save(client: Client, done: CampaignStatus, csv_file: Path | None, report_file: Path | None) -> None:
    if csv_file is not None:
        click.echo(f"table: {client.campaign_csv(done.id, csv_file)}", err=True)
    if report_file is not None:
        click.echo(f"report: {client.campaign_report(done.id, report_file)}", err=True)


@campaign.command("list")
@click.option("--suite", help="Only of this suite.")
@click.option("--limit", type=click.IntRange(1, 10_000), default=20, show_default=True, help="Most campaigns listed.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
@url_option
def list_(suite: str | None, limit: int, as_json: bool, url: str | None) -> None:
    """List campaigns, newest first.

    \b
    The latest ones:          needlebench campaign list
    Of one suite, as JSON:    needlebench campaign list --suite lin100-v2-quick --limit 100 --json
    """
    with service_client(url) as client:
        for one in list(client.campaigns(suite=suite, limit=limit)):
            line = f"{one.id}  {one.created_at[:19]}  {one.state:<10}{100 * one.fraction:3.0f} %  {one.name}"
            click.echo(json.dumps(one.raw) if as_json else line)


@campaign.command()
@click.argument("campaign_id", metavar="CAMPAIGN")
@click.option("--csv", "csv_file", metavar="FILE", type=_file, help="Write a table, one line per insertion.")
@click.option("--report", "report_file", metavar="FILE", type=_file, help="Write the report page.")
@click.option("--json", "as_json", is_flag=True, help="All scores and tests as JSON.")
@url_option
def show(campaign_id: str, csv_file: Path | None, report_file: Path | None, as_json: bool, url: str | None) -> None:
    """Show the progress and scores of a campaign; partial results while it runs.

    \b
    All campaigns:            needlebench campaign list
    One of them:              needlebench campaign show CAMPAIGN
    Everything, into files:   needlebench campaign show CAMPAIGN --csv table.csv --report report.html
    """
    with service_client(url) as client:
        now = client.campaign(campaign_id)
        results = client.campaign_results(campaign_id)
        if as_json:
            click.echo(json.dumps(results, indent=2))
        else:
            click.echo(f"{now.name}: {now.state}, {where(now)}")
            print_scores(results)
        _save(client, now, csv_file, report_file)


@campaign.command()
@click.argument("campaign_id", metavar="CAMPAIGN")
@url_option
def cancel(campaign_id: str, url: str | None) -> None:
    """Cancel a campaign; finished jobs are kept. Idempotent.

    \b
    One of them:              needlebench campaign cancel CAMPAIGN
    """
    with service_client(url) as client:
        client.cancel_campaign(campaign_id)
        done = client.wait_campaign(campaign_id)
        click.echo(f"{done.id} {done.state}: {where(done)}")


@campaign.command()
@click.argument("campaigns", metavar="CAMPAIGN [CAMPAIGN]", nargs=-1, required=True)
@click.option("--arms", metavar="A B", nargs=2, help="Two arms of one campaign; default: all of its arms.")
@click.option("--json", "as_json", is_flag=True, help="All tests as JSON.")
@url_option
def compare(campaigns: tuple[str, ...], arms: tuple[str, str] | None, as_json: bool, url: str | None) -> None:
    """Compare two campaigns, or the arms of one, by paired tests over the cases that differ in nothing else.

    \b
    Before and after:         needlebench campaign compare OLD NEW
    All arms of one:          needlebench campaign compare CAMPAIGN
    Two arms of one:          needlebench campaign compare CAMPAIGN --arms ifem elm
    """
    with service_client(url) as client:
        comparison = client.compare(campaigns, arms)
    if as_json:
        click.echo(json.dumps(comparison, indent=2))
        return
    if comparison["shared_cases"] is not None:
        click.echo(f"{comparison['same_digests']} of {comparison['shared_cases']} shared cases have the same digest")
    print_comparisons(comparison["comparisons"])


@campaign.command()
@click.argument("suite")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
@url_option
def trend(suite: str, as_json: bool, url: str | None) -> None:
    """Show a suite over commits and dates, regressions marked.

    \b
    Of a suite:               needlebench campaign trend lin100-v2-quick
    Of a grid, by its name:   needlebench campaign trend stiffness --json
    """
    with service_client(url) as client:
        points = client.trend(suite)
        if not points:
            click.echo(f"no campaign of {suite} has ended yet; to list campaigns: needlebench campaign list", err=True)
        if points and not as_json:
            click.echo(f"{'':<53}{BESIDE_HEAD}")
        for point in points:
            if as_json:
                click.echo(json.dumps(point))
                continue
            click.echo(trend_line(point))
