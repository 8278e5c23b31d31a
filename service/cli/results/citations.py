"""`needlebench cite`: what to write in a paper that uses it."""

from __future__ import annotations

from pathlib import Path

import click

from simcore.errors import Problem, ScenarioError


@click.command()
@click.argument("sources", metavar="[SUITE|BUNDLE.zip]...", nargs=-1)
@click.option("--bibtex", is_flag=True, help="As BibTeX entries.")
def cite(sources: tuple[str, ...], bibtex: bool) -> None:
    """Print how to cite needlebench: version and commit of this installation, and the paper that it reproduces.

    Each SUITE is cited with the digest of its cases, each BUNDLE with its id, its suite and the commit that ran it:
    with these a reader knows that the cases are the same. A bundle is checked first.

    \b
    The software:            needlebench cite
    With what was run:       needlebench cite lin100-v2 mismatch-v1
    Results that travel:     needlebench cite paper.zip
    For a bibliography:      needlebench cite lin100-v2 --bibtex >> references.bib
    """
    from benchmarks.bundles.canonical import BundleError
    from service.local.citation import as_bibtex, as_text, cited_bundle, cited_suite, software

    try:
        items = [cited_bundle(Path(one)) if Path(one).is_file() else cited_suite(one) for one in sources]
    except BundleError as error:
        path, _, text = str(error).partition(": ")
        raise ScenarioError([Problem("BUNDLE", path, text)]) from None
    click.echo(as_bibtex(software(), items) if bibtex else as_text(software(), items))
