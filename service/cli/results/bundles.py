"""`needlebench bundle`: results that travel, checked and run again elsewhere."""

from __future__ import annotations

import json
import secrets
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.blas_threads import one_thread
from service.cli.connection import data_option, url_option
from service.cli.results.output_file import free_to_write
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.bundles.check import Bundle
    from benchmarks.bundles.verification import CaseVerification, Verification

FILE = click.Path(dir_okay=False, path_type=Path)
DIFFERENT, NOT_RUN = 1, 3
id_option = click.option(
    "--id", "wanted_id", metavar="SHA256", help="The id that the bundle must have, or its first 8 digits and more."
)


@click.group()
def bundle() -> None:
    """Put the results of an experiment into one archive that others can check and run again.

    A bundle holds suite, arms with their code and files, all results, and chosen cases with their series and
    recordings. Its id is the SHA-256 of its manifest, which has the SHA-256 of everything else: who has the id has the
    whole. It names no machine, no path and nobody.

    \b
    Make one:                needlebench bundle make out/paper --out paper.zip
    Is it whole:             needlebench bundle check paper.zip --id 3f2a90c1
    Is it true:              needlebench bundle verify paper.zip --sample 5
    Show several:            needlebench leaderboard *.zip --out site
    """


@bundle.command()
@click.argument("source", metavar="CAMPAIGN|FOLDER")
@click.option("--out", "path", metavar="FILE.zip", required=True, type=FILE, help="The bundle.")
@click.option("--name", help="Name of the suite; default: that of the campaign or the experiment.")
@click.option(
    "--sample",
    "count",
    type=click.IntRange(0, 1000),
    default=3,
    show_default=True,
    help="Cases with their full series and recordings, chosen by the seed; each is run again now.",
)
@click.option("--seed", type=click.IntRange(0, 10**9), default=0, show_default=True, help="Of that choice.")
@click.option(
    "--source",
    "given",
    metavar="NAME=PLACE:FACTORY",
    multiple=True,
    help="Code of a plug-in that is not installed: mine=mine.py:make, or the folder of a package. Repeatable.",
)
@click.option("--force", is_flag=True, help="Replace the file.")
@data_option
@url_option
def make(
    source: str, path: Path, name: str | None, force: bool, data: Path | None, url: str | None, **options: Any
) -> None:
    """Make a bundle of an experiment that is over, and print its id.

    FOLDER is what `needlebench paper` or `settle` left, the folder of a `needlebench run`, or a folder of such folders.
    CAMPAIGN is the id of a campaign: of the service at --url, or of a data folder, for which a service is started if
    none runs.

    The bundle is closed (others can run all of it again, the source of plug-ins is within) or, if a controller in
    another process steered, open. Paths of this machine are taken out. Chosen cases are run again, so make it where the
    insertions ran; their files stay in FOLDER/bundled, and a second bundle of the same folder has the same bytes.

    \b
    A rerun of the paper:    needlebench bundle make out/paper --out paper.zip
    A campaign:              needlebench bundle make 5f2b8c0d9e1a4b37 --out mine.zip --sample 5
    A few runs:              needlebench bundle make results --name "first tries" --out tries.zip
    A plug-in from a file:   needlebench bundle make results --out mine.zip --source mine=mine.py:make

    \b
    Exit code: 0 made   1 crash   2 bad input, or code and files that are not those that ran
    """
    one_thread()
    from service.cli.results.insertion_source import insertions_of
    from service.local.bundle_making import Chosen, draft_bundle
    from service.local.bundle_source import given_source

    free_to_write(path, force=force)
    given = [given_source(text) for text in options["given"]]
    scratch = path.with_name(f"{path.name}.parts")
    with insertions_of(source, scratch, data=data, url=url, name=name) as insertions, _refusals("bundle"):
        draft = draft_bundle(insertions, Chosen(options["count"], options["seed"]), given, _say)
        manifest = draft.manifest
        without = manifest.chosen.asked - len(manifest.chosen.cases)
        _say(
            f"{manifest.suite.cases} cases, {len(manifest.arms)} arms, {len(manifest.chosen.cases)} with all series: "
            f"{draft.bytes / 1e6:.1f} MB"
        )
        if without and len(manifest.chosen.cases) < manifest.suite.cases:
            _say(f"warning: {without} of {manifest.chosen.asked} chosen cases cannot be run again")
        draft.write(path)
    click.echo(manifest.id)


@bundle.command()
@click.argument("path", metavar="BUNDLE.zip", type=FILE)
@id_option
@click.option("--json", "as_json", is_flag=True, help="The manifest as JSON.")
def check(path: Path, wanted_id: str | None, as_json: bool) -> None:
    """Check every byte of a bundle, and that its parts say the same; show what it says. Nothing in it is executed.

    \b
    Is it whole:             needlebench bundle check paper.zip
    Is it the one I mean:    needlebench bundle check paper.zip --id 3f2a90c1
    In a script:             needlebench bundle check paper.zip --json | jq .suite

    \b
    Exit code: 0 whole   2 changed, cut off, not a bundle, or with another id
    """
    with _opened(path, wanted_id) as opened:
        click.echo(json.dumps(opened.manifest.data(), indent=2) if as_json else _about(opened))


@bundle.command()
@click.argument("path", metavar="BUNDLE.zip", type=FILE)
@click.option(
    "--sample", "count", type=click.IntRange(1, 100_000), default=3, show_default=True, help="Cases that are run again."
)
@click.option(
    "--seed", type=click.IntRange(0, 10**9), help="Of their choice; default: drawn now, so that nobody can foresee it."
)
@click.option("--by", metavar="NAME", help="Who verifies, for the record: a person or a laboratory.")
@click.option(
    "--record",
    metavar="FILE.json",
    type=FILE,
    help="Where the record goes; default: BUNDLE.verification.json, which `needlebench leaderboard` finds.",
)
@click.option(
    "--run-plugin-code",
    "run_code",
    is_flag=True,
    help="Execute code of plug-ins out of the bundle where it is not installed here: it can do whatever you can.",
)
@id_option
@click.pass_context
def verify(
    ctx: click.Context, /, path: Path, wanted_id: str | None, record: Path | None, seed: int | None, **options: Any
) -> None:
    """Check a bundle, run some of its cases again out of it, and write down what came out.

    Each case is `identical` (every bit of every state), `equal` (the tip's path, or without a series every measure,
    within 1e-6), `different`, with the place, or `not run`, with the reason. The cases are chosen by a seed among all,
    not only among those whose series are in the bundle. Another commit or machine than then is said first.

    \b
    Three cases:             needlebench bundle verify paper.zip
    More, for a leaderboard: needlebench bundle verify paper.zip --sample 20 --by "Our laboratory"
    The same cases again:    needlebench bundle verify paper.zip --seed 83412
    With the plug-ins in it: needlebench bundle verify mine.zip --run-plugin-code

    \b
    Exit code: 0 all identical or equal   1 a case is different
               2 not a whole bundle       3 no case could be run
    """
    one_thread()
    from benchmarks.bundles.verification import record_of
    from service.local.bundle_verification import verify_bundle

    chosen = secrets.randbelow(10**6) if seed is None else seed
    with _opened(path, wanted_id) as opened:
        click.echo(f"bundle {opened.id}, {opened.manifest.suite.name}: seed {chosen}")
        _say_changes(opened)
        verification = verify_bundle(
            opened, seed=chosen, count=options["count"], by=options["by"], run_code=options["run_code"], say=_say_case
        )
    _keep(verification, record or record_of(path))
    if verification.counts["different"]:
        ctx.exit(DIFFERENT)
    if verification.result == "not run":
        ctx.exit(NOT_RUN)


def _keep(verification: Verification, record: Path) -> None:
    from service.local.paper_folder import write_text

    counts = ", ".join(f"{count} {result}" for result, count in sorted(verification.counts.items()))
    write_text(record, verification.text())
    click.echo(f"{counts}; written to {record}")


def _say(text: str) -> None:
    click.echo(f"needlebench: {text}" if text.startswith("warning") else text, err=True)


def _say_case(case: CaseVerification) -> None:
    click.echo(f"{case.result:<11}{case.id}{f': {case.where}' if case.where else ''}")


def _say_changes(opened: Bundle) -> None:
    """What is not as it was, in a line each; that another commit or processor runs is said in words."""
    from service.local.bundle_verification import changes_since

    for cases, name, then, now in changes_since(opened):
        what = f"other {'code' if name == 'commit' else name} than then"
        click.echo(f"{what}, for {cases} of {opened.manifest.suite.cases} cases: {name} {then} -> {now}")


@contextmanager
def _opened(path: Path, wanted_id: str | None) -> Iterator[Bundle]:
    from benchmarks.bundles.check import open_bundle

    with _refusals("BUNDLE"), open_bundle(path, wanted_id=wanted_id) as opened:
        yield opened


@contextmanager
def _refusals(_field: str) -> Iterator[None]:
    """Raises ScenarioError for a bundle that is refused: bad input of the command."""
    from benchmarks.bundles.canonical import BundleError

    try:
        yield
    except BundleError as error:
        path, _, text = str(error).partition(": ")
        raise ScenarioError([Problem(_field, path, text)] if text else [Problem(_field, None, path)]) from None


def _about(opened: Bundle) -> str:
    """What a bundle is, in a few lines."""
    manifest = opened.manifest
    code = ", ".join(f"{(one.commit or 'unknown')[:12]} ({one.cases} cases, {one.cpu})" for one in manifest.origins)
    lines = [
        f"bundle     {opened.id}",
        f"suite      {manifest.suite.name}, {manifest.suite.cases} cases, SHA-256 {manifest.suite.sha256}",
        f"division   {manifest.division}",
        f"code       {code or 'no case says'}",
        *(f"arm        {_arm(opened, one.id)}" for one in manifest.arms),
        f"failed     {manifest.failed} of {manifest.suite.cases}",
        f"full       {len(manifest.chosen.cases)} cases by seed {manifest.chosen.seed}",
        *(f"warning    {one.text} ({one.cases} cases)" for one in manifest.warnings),
        f"whole      {len(manifest.files) + 1} files, every byte checked",
    ]
    return "\n".join(lines)


def _arm(opened: Bundle, arm_id: str) -> str:
    record = opened.arm(arm_id)
    assert record is not None
    edition = record.arm().edition
    return f"{record.controller}{f' {edition}' if edition else ''}, {record.cases} cases, {record.settings[:120]}"
