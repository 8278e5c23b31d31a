"""`needlebench leaderboard`: a static site from bundles."""

from __future__ import annotations

from pathlib import Path

import click

from service.blas_threads import one_thread
from simcore.errors import Problem, ScenarioError


@click.command()
@click.argument(
    "files", metavar="BUNDLE.zip...", nargs=-1, required=True, type=click.Path(dir_okay=False, path_type=Path)
)
@click.option(
    "--out",
    metavar="DIR",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the site; new or empty.",
)
@click.option("--title", default="Leaderboard", show_default=True, help="Heading of its pages.")
@click.option("--force", is_flag=True, help="Replace the leaderboard that the folder holds.")
def leaderboard(files: tuple[Path, ...], out: Path, title: str, force: bool) -> None:
    """Make a static site from bundles: a board for each set of tasks, with everything that its figures rest on.

    Every bundle is checked to the last byte first. Arms are ranked by the interquartile mean of their RMSE over the
    tasks that all of them ran, with bootstrap intervals, performance profiles and paired tests; beside it are success,
    the worst 5 %, what the error was paid with, the time of a command, and who verified the bundle when. Failures rank
    behind everything. The site has the bundles and their recordings within; it needs no scripts, no network and no
    server: open index.html, or copy the folder to any web server.

    Records of `needlebench bundle verify` are found beside their bundles (BUNDLE.verification.json); others can stand
    among the files.

    \b
    Of all that lie here:    needlebench leaderboard *.zip --out site
    With another's record:   needlebench leaderboard mine.zip checked-by-them.json --out site
    Again, with a new one:   needlebench leaderboard *.zip --out site --force

    \b
    Exit code: 0 made   2 a bundle was changed, or the folder holds something else
    """
    one_thread()
    from benchmarks.bundles.canonical import BundleError
    from service.local.leaderboard_site import write_site

    if all(path.suffix == ".json" for path in files):
        raise ScenarioError([Problem("BUNDLE", str(files[0]), "is a record alone: give the bundle too")])
    try:
        write_site(files, out, title=title, replace=force, say=lambda text: click.echo(text, err=True))
    except BundleError as error:
        path, _, text = str(error).partition(": ")
        raise ScenarioError([Problem("BUNDLE", path, text)]) from None
    click.echo(out / "index.html")
