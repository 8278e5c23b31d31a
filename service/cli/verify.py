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
    from service.local.verify import Verdict
    from simcore.rollout.records import Observer


@click.command()
@click.argument("source", metavar="RESULT.json|JOB")
@click.option("--url", metavar="URL", envvar="NEEDLEBENCH_URL", help="Address of the service that has the job.")
@click.option(
    "--data",
    metavar="DIR",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Data folder of the service whose job it is, or whose uploads the result names.",
)
@click.option("--json", "as_json", is_flag=True, help="The verdict as one JSON object.")
@click.pass_context
def verify(ctx: click.Context, source: str, url: str | None, data: Path | None, as_json: bool) -> None:
    """Run a result again from its provenance, in this process, and compare.

    The verdict is `identical` (every bit of every state: the same digest), `equal` (the tip's path within 1e-6 mm,
    as with another library) or `different`, with the first step and array that differ. Changes since then, such as
    the commit or a library, are listed. A result of a plug-in is refused where its code or the files that its settings
    name are not those that ran. To say more than identical or not, series.npz must be beside the file.

    \b
    A file:                   needlebench verify results/first/result.json
    A job of a service:       needlebench verify 5f2b8c0d9e1a4b37
    Of a stopped service:     needlebench verify 5f2b8c0d9e1a4b37 --data ./data
    In a script:              needlebench verify result.json --json | jq .verdict

    \b
    Exit code: 0 identical or equal, 1 different, 2 not a result, or not the code that ran
    """
    from service.local.verify import CannotVerifyError
    from simcore.errors import Problem, ScenarioError

    with ExitStack() as stack:
        bar: Observer | None = None
        if sys.stderr.isatty():
            from service.local.run import ProgressBar

            bar = stack.enter_context(ProgressBar())
        file = Path(source)
        try:
            verdict = _of_file(file, data, bar) if file.is_file() else _of_job(source, url, data, bar)
        except CannotVerifyError as error:
            raise ScenarioError([Problem("RESULT", source, str(error))]) from None
    click.echo(json.dumps(verdict.data())) if as_json else _print_verdict(verdict)
    if not verdict.reproduced:
        ctx.exit(1)


def _of_file(path: Path, data: Path | None, observer: Observer | None) -> Verdict:
    from service.local.verify import CannotVerifyError, load_series, uploads_beside, verify
    from simcore.rollout.artefacts import SERIES

    try:
        result = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise CannotVerifyError(f"is not readable JSON: {error}") from None
    if not isinstance(result, dict):
        raise CannotVerifyError("is not a result: it is not a JSON object")
    uploads = uploads_beside(path) if data is None else data / "uploads"
    return verify(result, load_series(path.with_name(SERIES)), observer, uploads=uploads, beside=path.absolute().parent)


def _of_job(job_id: str, url: str | None, data: Path | None, observer: Observer | None) -> Verdict:
    """By the service at `url`; of a data folder by the service that runs on it, or from its files if there is none."""
    from service.cli.connection import service_client
    from service.local.verify import CannotVerifyError

    if not re.fullmatch("[0-9a-z]{1,32}", job_id):
        raise CannotVerifyError("is neither a file nor the id of a job")
    if data is not None:
        from service.files.endpoint import endpoint
        from service.files.lock import LockHeldError, file_lock

        try:
            with file_lock(data / "server.lock"):
                return _of_folder(job_id, data, observer)
        except LockHeldError:
            url = endpoint(data)
    with service_client(url) as client:
        return client.verify(job_id, observer)


def _of_folder(job_id: str, data: Path, observer: Observer | None) -> Verdict:
    """A job of a data folder on which no service runs."""
    from service.local.verify import CannotVerifyError, load_series, verify
    from service.settings import Settings
    from service.store.database import open_database
    from service.store.job import UnknownJobError
    from service.store.jobs import Store
    from simcore.rollout.artefacts import SERIES

    settings = Settings.load(data=data, host="127.0.0.1")
    if not settings.database.is_file():
        raise CannotVerifyError(f"{data} is not a data folder: it has no {settings.database.name}")
    store = Store(open_database(settings.database))
    try:
        job = store.get(job_id)
    except UnknownJobError as error:
        raise CannotVerifyError(str(error)) from None
    finally:
        store.close()
    if job.result is None:
        raise CannotVerifyError(f"job {job_id} is {job.state}: it has no result")
    return verify(job.result, load_series(data / job.folder / SERIES), observer, uploads=settings.uploads)


def _print_verdict(verdict: Verdict) -> None:
    from service.local.verify import ROUNDING

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
    if verdict.verdict != "identical" and any(name in verdict.changed for name in ROUNDING):
        told = "the kernels or the BLAS are for another processor than then, which alone changes no bit"
        click.echo(f"needlebench: note: {told}", err=True)
    for name, (then, now) in verdict.changed.items():
        click.echo(f"  {name:<18} {then} -> {now}")
