"""`needlebench campaign run --out DIR`: a campaign without a service, on this machine or on a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.blas_threads import one_thread
from service.cli.cluster.options import cluster_address, cluster_options
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.cases import Suite

WITHOUT_RESULT = 1
_LINES = 100  # of progress, of a whole campaign
_OF_A_SERVICE = ("url", "data", "detach", "csv_file", "fail_on_regression")


def folder_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of a campaign that runs without a service."""
    folder = click.option(
        "--out",
        "folder",
        metavar="DIR",
        type=click.Path(file_okay=False, path_type=Path),
        help="Run without a service, into this folder; the same command goes on where it was interrupted.",
    )
    workers = click.option(
        "--workers",
        type=click.IntRange(1, 64),
        default=2,
        show_default=True,
        help="With --out: processes, one thread each.",
    )
    commit = click.option(
        "--any-commit", is_flag=True, help="With --out: go on with a folder that another commit began."
    )
    return folder(workers(cluster_options(commit(command))))


def run_here(ctx: click.Context, request: dict[str, Any], options: dict[str, Any]) -> bool:
    """Run it in its folder, if one is named, and say what came of it; False for a campaign of a service.

    Raises ScenarioError, also for options that do not go together.
    """
    path: Path | None = options["folder"]
    if path is None:
        if options["cluster_text"] is not None:
            message = "needs --out DIR: campaigns of a service run on its own workers"
            raise ScenarioError([Problem("--cluster", options["cluster_text"], message)])
        return False
    for name in _OF_A_SERVICE:
        if options[name]:
            flag = f"--{name.removesuffix('_file').replace('_', '-')}"
            raise ScenarioError([Problem(flag, str(options[name]), "is for campaigns of a service, not for --out DIR")])
    one_thread()
    from service.admission.campaign_planner import CampaignRequest, suite_of

    suite = suite_of(CampaignRequest.model_validate(request))
    if options["dry_run"]:
        click.echo(f"{suite.name}: {len(suite.cases)} insertions\nsha256 {suite.sha256}")
        return True
    _run(ctx, suite, request, path, options)
    return True


def _run(ctx: click.Context, suite: Suite, request: dict[str, Any], path: Path, options: dict[str, Any]) -> None:
    from service.local.campaign_run import outcomes_in, run_campaign, size_bytes
    from service.local.case_runner import Where

    address = cluster_address(options["cluster_text"], options["insecure"], options["certificates"])
    where = Where(options["workers"], address)
    done = run_campaign(suite, request, path, where, any_commit=options["any_commit"], ended=_say_progress)
    if (page := options["report_file"]) is not None:
        from service.campaigns.report import page_of_outcomes
        from service.local.paper_folder import write_text
        from simcore.provenance import machine

        found = outcomes_in(path)
        text = page_of_outcomes(found, name=suite.name, axes=request.get("grid"), provenance=machine())
        write_text(page, text)
        click.echo(f"report: {page}", err=True)
    size, files = size_bytes(path)
    click.echo(
        f"{len(suite.cases)} insertions, {done.fresh} of them now: {size / 1e6:.1f} MB in {files} files", err=True
    )
    click.echo(done.table)
    if done.failed:
        click.echo(f"{done.failed} of {len(suite.cases)} have no result", err=True)
        ctx.exit(WITHOUT_RESULT)


def _say_progress(done: int, of: int) -> None:
    if done % max(1, of // _LINES) == 0 or done == of:
        click.echo(f"{done} of {of} insertions", err=True)
