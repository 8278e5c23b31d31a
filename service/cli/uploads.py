"""The commands that send meshes and models to a service, list and delete them."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from service.cli.service import asked, client_of, url_option


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--kind", type=click.Choice(["mesh", "model", "dataset"]), help="Default: by the suffix.")
@url_option
def upload(file: Path, kind: str | None, url: str | None) -> None:
    """Send FILE to a running service and print what scenarios call it: artefact:ID.

    A tissue mesh is a .msh, .vtu, .vtk, .mesh or .inp file, a model the .json of `needlebench train`, a data set the
    .npz of `needlebench dataset`. The service looks into it before it keeps it; the same content sent again is the same
    upload.

    \b
    A mesh of your own:       needlebench upload liver.msh
    Use it:                   needlebench submit mine.json --set tissue.mesh_file=artefact:ID
    A data set to learn from: needlebench upload data.npz
                              needlebench models train artefact:ID
    """
    with client_of(url) as client:
        sent = asked(lambda: client.upload(file, kind=kind))
        click.echo(sent.reference)
        told = {name: value for name, value in sent.content.items() if not isinstance(value, dict)}
        found = ", ".join(f"{name} {value}" for name, value in told.items())
        click.echo(f"{sent.kind} {sent.name}, {sent.bytes} bytes: {found}", err=True)


@click.command()
@click.option("--delete", "deleted", metavar="ID", help="Delete this one; not while a queued or running job uses it.")
@click.option("--pin", "pinned", metavar="ID", help="Keep this one whatever is cleared away.")
@click.option("--unpin", "unpinned", metavar="ID", help="Keep this one no longer.")
@url_option
def uploads(deleted: str | None, pinned: str | None, unpinned: str | None, url: str | None) -> None:
    """List the meshes, models and data sets that were sent to a service, newest first; or delete or keep one.

    \b
    What there is:            needlebench uploads
    Make room:                needlebench uploads --delete ID
    """
    with client_of(url) as client:
        asks = ((deleted, client.delete_upload), (pinned, client.pin_upload), (unpinned, client.unpin_upload))
        wanted = [(act, name.removeprefix("artefact:")) for name, act in asks if name is not None]
        for act, upload_id in wanted:
            asked(partial(act, upload_id))
        if wanted:
            return
        for item in asked(client.uploads):
            click.echo(f"{item.reference}  {item.kind:<6}{item.bytes:>10}  {item.name}")
