"""`needlebench schedule`: campaigns at set times."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from service.cli.campaign_request import campaign_request
from service.cli.campaigns import controller_option, grid_option, model_option, scenario_option
from service.cli.connection import service_client, url_option
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from service.client.client import Client

_catchup = click.Choice(["skip", "latest", "all"])
_overlap = click.Choice(["forbid", "allow", "replace"])


@click.group()
def schedule() -> None:
    """Run campaigns at set times, such as every night.

    \b
    Every night at two:       needlebench schedule add nightly "0 2 * * *" lin100-v2-quick --timezone Europe/Paris
    All schedules:            needlebench schedule list
    The runs of one:          needlebench schedule runs nightly
    """


@schedule.command()
@click.argument("name")
@click.argument("cron")
@click.argument("suite", required=False)
@controller_option
@grid_option
@scenario_option
@model_option
@click.option("--timezone", default="UTC", show_default=True, help="IANA time zone of the cron line.")
@click.option("--catchup", type=_catchup, default="latest", show_default=True, help="Ticks while the service was down.")
@click.option("--overlap", type=_overlap, default="forbid", show_default=True, help="If the last campaign still runs.")
@url_option
def add(
    name: str, cron: str, suite: str | None, timezone: str, catchup: str, overlap: str, url: str | None, **options: Any
) -> None:
    """Run a suite or a grid at the times that CRON gives (minute hour day month weekday).

    \b
    Every night at two:       needlebench schedule add nightly "0 2 * * *" lin100-v2-quick --timezone Europe/Paris
    Mondays, a grid:          needlebench schedule add gains "0 6 * * 1" --scenario line --grid controller.gain=0.5,1
    """
    rules = {"timezone": timezone, "catchup": catchup, "overlap": overlap}
    request = {"name": name, "cron": cron, **rules, "campaign": campaign_request(suite, options)}
    with service_client(url) as client:
        added = client.add_schedule(request)
        click.echo(f"{added['id']}  next: {added['next_run_at']}")


@schedule.command("list")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
@url_option
def list_schedules(as_json: bool, url: str | None) -> None:
    """List the schedules.

    \b
    With their next runs:     needlebench schedule list
    """
    with service_client(url) as client:
        for one in client.schedules():
            following = one["next_run_at"] or "paused"
            line = f"{one['id']}  {one['name']:<20}{one['cron']:<16}{one['timezone']:<16}next: {following}"
            click.echo(json.dumps(one) if as_json else f"{line}  ({one['words']})")


@schedule.command()
@click.argument("name")
@click.option("--limit", type=click.IntRange(1, 1000), default=20, show_default=True, help="Most items listed.")
@url_option
def runs(name: str, limit: int, url: str | None) -> None:
    """List the runs of a schedule, newest first.

    \b
    Did it run last night:    needlebench schedule runs nightly --limit 3
    """
    with service_client(url) as client:
        for run_ in client.schedule_runs(_schedule_id(client, name), limit=limit):
            detail = run_["campaign"] or run_["message"]
            click.echo(f"{run_['scheduled_for']}  {run_['outcome']:<8}  {detail}")


@schedule.command()
@click.argument("name")
@url_option
def pause(name: str, url: str | None) -> None:
    """Pause a schedule until it is resumed.

    \b
    While the lab moves:      needlebench schedule pause nightly
    """
    with service_client(url) as client:
        client.change_schedule(_schedule_id(client, name), {"enabled": False})


@schedule.command()
@click.argument("name")
@url_option
def resume(name: str, url: str | None) -> None:
    """Resume a schedule, from its next tick on.

    \b
    Afterwards:               needlebench schedule resume nightly
    """
    with service_client(url) as client:
        changed = client.change_schedule(_schedule_id(client, name), {"enabled": True})
        click.echo(f"next: {changed['next_run_at']}")


@schedule.command()
@click.argument("name")
@url_option
def trigger(name: str, url: str | None) -> None:
    """Run the campaign of a schedule now.

    \b
    Without waiting:          needlebench schedule trigger nightly
    """
    with service_client(url) as client:
        run_ = client.trigger_schedule(_schedule_id(client, name))
        click.echo(f"{run_['outcome']}  {run_['campaign'] or run_['message']}")


@schedule.command()
@click.argument("name")
@url_option
def remove(name: str, url: str | None) -> None:
    """Delete a schedule and its history; the campaigns that it started are kept.

    \b
    Only pause it:            needlebench schedule pause nightly
    Delete it:                needlebench schedule remove nightly
    """
    with service_client(url) as client:
        client.delete_schedule(_schedule_id(client, name))


def _schedule_id(client: Client, name: str) -> str:
    """The id of a schedule by its name or id."""
    known = client.schedules()
    for one in known:
        if name in (one["name"], one["id"]):
            return str(one["id"])
    names = ", ".join(one["name"] for one in known) or "none"
    raise ScenarioError([Problem("NAME", name, f"is not a schedule; there are: {names}")])
