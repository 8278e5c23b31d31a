"""The command that checks a result by running it again."""

from __future__ import annotations

import json
import re
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from service.verify import Verdict
    from simcore.records import Observer


@click.command()
@click.argument("source", metavar="RESULT.json|JOB")
@click.option("--url", metavar="URL", envvar="NEEDLEBENCH_URL", help="Address of the service that has the job.")
@click.option("--json", "as_json", is_flag=True, help="The verdict as one JSON object.")
@click.pass_context
def verify(ctx: click.Context, source: str, url: str | None, as_json: bool) -> None:
    """Run a result again from its provenance, in this process, and say whether the same comes out.

    The verdict is `identical` (every bit of every state: the same digest), `equal` (the tip's path within 1e-6 mm,
    as on another processor) or `different`, with the first step and array that differ. What has changed since, such
    as the commit or a library, is listed. To tell more than identical or not, series.npz must lie beside the file.

    \b
    A file:                   needlebench verify results/first/result.json
    A job of a service:       needlebench verify 5f2b8c0d9e1a4b37
    In a script:              needlebench verify result.json --json | jq .verdict

    \b
    Exit code: 0 identical or equal, 1 different, 2 not a result
    """
    from service.verify import CannotVerify
    from simcore.errors import Problem, ScenarioError

    with ExitStack() as stack:
        bar: Observer | None = None
        if sys.stderr.isatty():
            from service.local_run import ProgressBar

            bar = stack.enter_context(ProgressBar())
        file = Path(source)
        try:
            verdict = _of_file(file, bar) if file.is_file() else _of_job(source, url, bar)
        except CannotVerify as error:
            raise ScenarioError([Problem("RESULT", source, str(error))]) from None
    click.echo(json.dumps(verdict.data())) if as_json else _tell(verdict)
    if not verdict.reproduced:
        ctx.exit(1)


def _of_file(path: Path, observer: Observer | None) -> Verdict:
    from service.verify import CannotVerify, load_series, verify
    from simcore.artefacts import SERIES

    try:
        result = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise CannotVerify(f"is not readable JSON: {error}") from None
    if not isinstance(result, dict):
        raise CannotVerify("this is no result: it is no JSON object")
    return verify(result, load_series(path.with_name(SERIES)), observer)


def _of_job(job_id: str, url: str | None, observer: Observer | None) -> Verdict:
    from service.cli_service import asked, client_of
    from service.verify import CannotVerify

    if not re.fullmatch("[0-9a-z]{1,32}", job_id):
        raise CannotVerify("is neither a file nor the id of a job")
    with client_of(url) as client:
        return asked(lambda: client.verify(job_id, observer))


def _tell(verdict: Verdict) -> None:
    texts = {
        "identical": "identical: every bit of every state",
        "equal": f"equal: the tip is within {verdict.tip_mm or 0:.1e} mm, not every bit is the same",
        "different": "different",
    }
    click.echo(texts[verdict.verdict])
    if verdict.status_before != verdict.status_now:
        click.echo(f"  status             {verdict.status_before} -> {verdict.status_now}")
    if verdict.verdict == "different" and verdict.tip_mm is not None:
        click.echo(f"  tip                up to {verdict.tip_mm:.6g} mm away")
    if (first := verdict.first) is not None:
        click.echo(f"  first difference   step {first.step}, {first.array}: {first.before:.17g} -> {first.now:.17g}")
        click.echo(f"  largest in it      {first.largest:.3g}")
    if verdict.note:
        click.echo(f"  {verdict.note}")
    click.echo(f"  digest             {verdict.digest_now}")
    for name, (then, now) in verdict.changed.items():
        click.echo(f"  {name:<18} {then} -> {now}")
