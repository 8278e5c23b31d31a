"""`needlebench schedule`: campaigns by the clock."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from service.cli.campaign import campaign_request, grid_option, model_option, scenario_option
from service.cli.service import asked, client_of, url_option
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from service.client.client import Client

_catchup = click.Choice(["skip", "latest", "all"])
_overlap = click.Choice(["forbid", "allow", "replace"])


@click.group()
def schedule() -> None:
    """Run campaigns by the clock: nightly runs.

    \b
    Every night at two:       needlebench schedule add nightly "0 2 * * *" lin100-v1-quick --timezone Europe/Paris
    What there is:            needlebench schedule list
    What became of it:        needlebench schedule runs nightly
    """


@schedule.command()
@click.argument("name")
@click.argument("cron")
@click.argument("suite", required=False)
@grid_option
@scenario_option
@model_option
@click.option("--timezone", default="UTC", show_default=True, help="IANA time zone in which the line is read.")
@click.option("--catchup", type=_catchup, default="latest", show_default=True, help="Ticks missed while down.")
@click.option("--overlap", type=_overlap, default="forbid", show_default=True, help="While the last one still runs.")
@url_option
def add(
    name: str, cron: str, suite: str | None, timezone: str, catchup: str, overlap: str, url: str | None, **asks: Any
) -> None:
    """Run a suite or a grid whenever the clock matches CRON (minute hour day month weekday).

    \b
    Every night at two:       needlebench schedule add nightly "0 2 * * *" lin100-v1-quick --timezone Europe/Paris
    Mondays, a grid:          needlebench schedule add gains "0 6 * * 1" --scenario line --grid controller.gain=0.5,1
    """
    rules = {"timezone": timezone, "catchup": catchup, "overlap": overlap}
    request = {"name": name, "cron": cron, **rules, "campaign": campaign_request(suite, asks)}
    with client_of(url) as client:
        made = asked(lambda: client.add_schedule(request))
        click.echo(f"{made['id']}  next: {made['next_run_at']}")


@schedule.command("list")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
@url_option
def list_schedules(as_json: bool, url: str | None) -> None:
    """List the schedules.

    \b
    When does what run next:  needlebench schedule list
    """
    with client_of(url) as client:
        for one in asked(client.schedules):
            following = one["next_run_at"] or "paused"
            line = f"{one['id']}  {one['name']:<20}{one['cron']:<16}{one['timezone']:<16}next: {following}"
            click.echo(json.dumps(one) if as_json else line)


@schedule.command()
@click.argument("name")
@click.option("--limit", type=click.IntRange(1, 1000), default=20, show_default=True, help="At most so many.")
@url_option
def runs(name: str, limit: int, url: str | None) -> None:
    """Show what became of a schedule's ticks, newest first.

    \b
    Did it run last night:    needlebench schedule runs nightly --limit 3
    """
    with client_of(url) as client:
        for run_ in client.schedule_runs(_schedule_id(client, name), limit=limit):
            told = run_["campaign"] or run_["message"]
            click.echo(f"{run_['scheduled_for']}  {run_['outcome']:<8}  {told}")


@schedule.command()
@click.argument("name")
@url_option
def pause(name: str, url: str | None) -> None:
    """Fire no more ticks until it is resumed.

    \b
    While the lab moves:      needlebench schedule pause nightly
    """
    with client_of(url) as client:
        asked(lambda: client.change_schedule(_schedule_id(client, name), {"enabled": False}))


@schedule.command()
@click.argument("name")
@url_option
def resume(name: str, url: str | None) -> None:
    """Fire again from the next tick on.

    \b
    And go on:                needlebench schedule resume nightly
    """
    with client_of(url) as client:
        changed = asked(lambda: client.change_schedule(_schedule_id(client, name), {"enabled": True}))
        click.echo(f"next: {changed['next_run_at']}")


@schedule.command()
@click.argument("name")
@url_option
def trigger(name: str, url: str | None) -> None:
    """Run its campaign now.

    \b
    Not wait for the night:   needlebench schedule trigger nightly
    """
    with client_of(url) as client:
        run_ = asked(lambda: client.trigger_schedule(_schedule_id(client, name)))
        click.echo(f"{run_['outcome']}  {run_['campaign'] or run_['message']}")


@schedule.command()
@click.argument("name")
@url_option
def remove(name: str, url: str | None) -> None:
    """Forget a schedule and its history; the campaigns that it started stay.

    \b
    Only for a while:         needlebench schedule pause nightly
    For good:                 needlebench schedule remove nightly
    """
    with client_of(url) as client:
        client.delete_schedule(_schedule_id(client, name))


def _schedule_id(client: Client, name: str) -> str:
    """The id of a schedule by its name or id."""
    found = asked(client.schedules)
    for one in found:
        if name in (one["name"], one["id"]):
            return str(one["id"])
    there = ", ".join(one["name"] for one in found) or "none"
    raise ScenarioError([Problem("NAME", name, f"is no schedule; there are: {there}")])
