"""The commands that send meshes and models to a service, list and delete them."""

from __future__ import annotations

from pathlib import Path

import click

from service.cli_service import asked, client_of, url_option


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--kind", type=click.Choice(["mesh", "model"]), help="Default: by the suffix.")
@url_option
def upload(file: Path, kind: str | None, url: str | None) -> None:
    """Send FILE to a running service and print what scenarios call it: artefact:ID.

    A tissue mesh is a .msh, .vtu, .vtk, .mesh or .inp file, a model an .npz or .json. The service looks into it before
    it keeps it; the same content sent again is the same upload.

    \b
    A mesh of your own:       needlebench upload liver.msh
    Use it:                   needlebench submit mine.json --set tissue.mesh_file=artefact:ID
    """
    with client_of(url) as client:
        sent = asked(lambda: client.upload(file, kind=kind))
        click.echo(sent.reference)
        found = ", ".join(f"{name} {value}" for name, value in sent.content.items())
        click.echo(f"{sent.kind} {sent.name}, {sent.bytes} bytes: {found}", err=True)


@click.command()
@click.option("--delete", "deleted", metavar="ID", help="Delete this one; not while a queued or running job uses it.")
@url_option
def uploads(deleted: str | None, url: str | None) -> None:
    """List the meshes and models that were sent to a service, newest first; or delete one.

    \b
    What there is:            needlebench uploads
    Make room:                needlebench uploads --delete ID
    """
    with client_of(url) as client:
        if deleted is not None:
            asked(lambda: client.delete_upload(deleted.removeprefix("artefact:")))
            return
        for item in asked(client.uploads):
            click.echo(f"{item.reference}  {item.kind:<6}{item.bytes:>10}  {item.name}")
