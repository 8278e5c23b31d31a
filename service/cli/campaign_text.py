"""Texts of `needlebench campaign`: plans, progress, scores and the trend of a suite."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from service.client.campaigns import CampaignStatus
    from service.client.client import Client


BESIDE = {
    "rcm_max_mm": ("RCM mm", 2),
    "max_push_n": ("push N", 2),
    "max_lateral_n": ("lateral N", 2),
    "entry_drag_mm": ("drag mm", 2),
    "max_strain": ("strain", 2),
    "max_needle_stress_mpa": ("stress MPa", 0),
}  # as `benchmarks.paper.table` has it, in columns of a terminal; a command does not wait for the analyses
BESIDE_HEAD = "".join(f"{heading:>11}" for heading, _ in BESIDE.values())


def print_plan(plan: dict[str, Any]) -> None:
    """The result of a dry run."""
    band = f"{_minutes(plan['seconds_low'])} to {_minutes(plan['seconds_high'])}"
    time = f"about {_minutes(plan['seconds'])} ({band})"
    click.echo(f"{plan['suite']}: {plan['jobs']} insertions, {plan['steps']} steps, {time}")
    click.echo(f"sha256 {plan['suite_sha256']}")
    more = ", ..." if plan["jobs"] > len(plan["first"]) else ""
    click.echo(f"cases: {', '.join(plan['first'])}{more}")


def _minutes(seconds: float | None) -> str:
    if seconds is None:
        return "unknown time"
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def follow_campaign(client: Client, started: CampaignStatus) -> CampaignStatus:
    """The campaign when it has ended, with progress on stderr until then."""
    try:
        with _bar() if sys.stderr.isatty() else _lines() as show:
            return client.wait_campaign(started.id, progress=show)
    except KeyboardInterrupt:
        click.echo(f"the next service resumes it; to stop it: needlebench campaign cancel {started.id}", err=True)
        raise


@contextmanager
def _bar() -> Iterator[Callable[[CampaignStatus], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %  {task.fields[t]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("campaign", total=1.0, t="")
        yield lambda now: progress.update(task, completed=now.fraction, t=where(now))


@contextmanager
def _lines() -> Iterator[Callable[[CampaignStatus], None]]:
    shown = -1.0

    def show(now: CampaignStatus) -> None:
        nonlocal shown
        if now.fraction - shown >= 0.05 or now.terminal:
            shown = now.fraction
            click.echo(f"{100 * now.fraction:3.0f} %  {where(now)}", err=True)

    yield show


def where(now: CampaignStatus) -> str:
    """Its progress in words."""
    failed = sum(now.jobs.get(state, 0) for state in ("failed", "timed_out"))
    left = "" if now.terminal else f", {_minutes(now.eta_s)} left"
    removed = now.cases - sum(now.jobs.values())  # their results stay with the campaign
    done = f"{now.ended + removed} of {now.cases} insertions"
    more = f", the jobs of {removed} since removed" if removed else ""
    return f"{done}{f', {failed} failed' if failed else ''}{more}{left}"


def print_scores(results: dict[str, Any]) -> None:
    """A line for each group and arm; of a grid the arms against each other, and what the insertions warn of."""
    of_grid = "comparisons" in results
    wide = max([20, *(len(score["arm"]) + 2 for score in results["scores"])])
    head = f"{'group':<12}{'arm':<{wide}}{'n':>6}{'stable':>9}{'success':>9}{'median RMSE':>14}{'maximum':>12}"
    click.echo(f"{head}{BESIDE_HEAD}")
    for score in results["scores"]:
        marks = f"noise {score['noise']}" if of_grid else f"{score['young']} E, noise {score['noise']}"
        shares = f"{100 * score['stable']:>7.0f} %{100 * score['success']:>7.0f} %"
        errors = f"{millimetres(score['median_mm']):>14}{millimetres(score['max_mm']):>12}"
        paid = beside_text(score["beside"])
        name = f"{score['group']:<12}{score['arm']:<{wide}}"
        click.echo(f"{name}{score['insertions']:>6}{shares}{errors}{paid}  {marks}")
    if of_grid:
        print_profiles(results["profiles"])
        widest = results["comparisons"][-1]["group"] if results["comparisons"] else ""
        print_comparisons([one for one in results["comparisons"] if one["group"] == widest])
    print_failures(results["failures"])
    print_cautions(results["cautions"], results["counts"]["insertions"])


def print_profiles(profiles: dict[str, Any] | None) -> None:
    """The interquartile mean of each arm over the cases that all of them ran."""
    if profiles is None:
        return
    click.echo(
        f"\ninterquartile mean of the RMSE, with 95 % intervals, over the {profiles['cases']} cases that all arms ran"
    )
    for one in sorted(profiles["aggregates"], key=lambda one: (one["iqm_mm"] is None, one["iqm_mm"])):
        low, high = one["iqm_interval_mm"]
        interval = "" if low is None or high is None else f" [{low:.4f}, {high:.4f}]"
        click.echo(f"  {one['arm']:<28}{millimetres(one['iqm_mm'])}{interval}")


def print_comparisons(comparisons: list[dict[str, Any]]) -> None:
    """A block for each test: what was tested over how many of which unit, why there are not more, and what the error of
    each side may have been paid with."""
    if not comparisons:
        click.echo("there are no cases in common that differ in nothing else")
        return
    tests = ", ".join(dict.fromkeys(str(one["family"]) for one in comparisons))
    click.echo(f"\nmedian difference of the RMSE, first - second, with 95 % intervals; p by Holm over {tests} tests")
    click.echo(f"{'':<30}{BESIDE_HEAD}")
    for one in comparisons:
        low, high = one["difference_interval_mm"]
        interval = "" if low is None or high is None else f" [{low:+.4f}, {high:+.4f}]"
        difference = "failed" if one["difference_mm"] is None else f"{one['difference_mm']:+.4f} mm"
        click.echo(f"{one['group']:<12}{one['first']} - {one['second']}: {difference}{interval}; {test_text(one)}")
        for side in ("first", "second"):
            click.echo(f"  {one[side]:<28}{beside_text(one[f'beside_{side}'])}")
    for note in dict.fromkeys(note for one in comparisons for note in one["notes"]):
        click.echo(f"  note: {note}")


def test_text(one: Mapping[str, Any]) -> str:
    """The test, its p and what it counts, as in "sign test over 20 end points of 60 pairs: p = 0.0012"."""
    units = f"{one['clusters']} {one['unit']}{'' if one['clusters'] == 1 else 's'}"
    of = "" if one["pairs"] == one["clusters"] else f" of {one['pairs']} pairs"
    p = one["p_primary"] if one["p_holm"] is None else one["p_holm"]
    if p is None:
        return f"{units}{of}: no test"
    few = f" (to reach 0.05, {one['fewest']} are needed)" if one["clusters"] < one["fewest"] else ""
    return f"sign test over {units}{of}: p = {p:.2g}{few}"


def print_failures(failures: list[dict[str, Any]]) -> None:
    """How many insertions of each arm failed, by their status, with the message of one, on stderr."""
    kinds: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for one in failures:
        kinds.setdefault((one["arm"], one["status"]), []).append(one)
    for (arm, status), members in kinds.items():
        first = members[0]
        click.echo(
            f"needlebench: {len(members)} of {arm} failed, {status}: {first['id']}: {first['message']}", err=True
        )


def print_cautions(cautions: list[dict[str, Any]], insertions: int) -> None:
    """What the insertions warn of, each once, on stderr."""
    for one in cautions:
        more = "; ..." if one["cases"] > len(one["first"]) else ""
        where = f"{one['cases']} of {insertions} insertions ({'; '.join(one['first'])}{more})"
        click.echo(f"needlebench: warning: {where}: {one['text']}", err=True)


def trend_line(point: Mapping[str, Any]) -> str:
    """One run of a suite."""
    step = "" if point["step_ms"] is None else f"{point['step_ms']:.2f} ms"
    commit = (point["commit"] or "unknown")[:8]
    mark = "REGRESSION" if point["regression"] else ""
    ends = f"{point['successes']} of {point['cases']}"
    rmse, paid = millimetres(point["median_rmse_mm"]), beside_text(point["beside"])
    return f"{point['at'][:16]}  {commit:<9}{ends:<14}{rmse:<12}{paid}  {step:<10}{point['campaign']}  {mark}"


def beside_text(values: Mapping[str, float | None]) -> str:
    """What a small tip error may have been paid with, in the columns of BESIDE_HEAD."""
    found = [(values.get(name), digits) for name, (_, digits) in BESIDE.items()]
    return "".join(f"{'-' if value is None else f'{value:.{digits}f}':>11}" for value, digits in found)


def millimetres(value: float | None) -> str:
    """An error in mm; None, which ranks worse than any number, is that of a failed run."""
    return "failed" if value is None else f"{value:.4f} mm"


def print_trend(client: Client, done: CampaignStatus) -> bool:
    """Print the marks of the campaign against earlier runs of its suite. Returns whether something got worse."""
    mine = next((point for point in client.trend(done.suite) if point["campaign"] == done.id), None)
    if mine is None:
        return False
    for what in ("accuracy", "success", "time"):
        click.echo(f"{what:<10}{mine[what]:<8}{mine[what + '_why']}")
    return bool(mine["regression"])
