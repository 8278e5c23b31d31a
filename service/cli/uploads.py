"""The commands that upload meshes, models, data sets and poses to a service, list, pin and delete them."""

from __future__ import annotations

from pathlib import Path

import click

from service.cli.connection import service_client, url_option


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--kind", type=click.Choice(["mesh", "model", "dataset", "poses"]), help="Default: by the suffix.")
@url_option
def upload(file: Path, kind: str | None, url: str | None) -> None:
    """Upload FILE to a running service and print how scenarios refer to it: artefact:ID.

    A tissue mesh is a .msh, .vtu, .vtk, .mesh or .inp file, a model the .json of `needlebench train`, a data set the
    .npz of `needlebench dataset`, the poses of a replay a .npy array with 7 columns. The service checks it before
    storing it; the same content is the same upload.

    \b
    A mesh of your own:       needlebench upload liver.msh
    Use it:                   needlebench submit mine.json --set tissue.mesh_file=artefact:ID
    The log of a robot:       needlebench upload poses.npy
    A data set to learn from: needlebench upload data.npz
                              needlebench models train artefact:ID
    """
    with service_client(url) as client:
        sent = client.upload(file, kind=kind)
        click.echo(sent.reference)
        content = {name: value for name, value in sent.content.items() if not isinstance(value, dict)}
        counts = ", ".join(f"{name} {value}" for name, value in content.items())
        click.echo(f"{sent.kind} {sent.name}, {sent.bytes} bytes: {counts}", err=True)


@click.command()
@click.option("--delete", "deleted", metavar="ID", help="Delete this one; not while a queued or running job uses it.")
@click.option("--pin", "pinned", metavar="ID", help="Keep this one when old uploads are removed.")
@click.option("--unpin", "unpinned", metavar="ID", help="Allow this one to be removed again.")
@url_option
def uploads(deleted: str | None, pinned: str | None, unpinned: str | None, url: str | None) -> None:
    """List the meshes, models, data sets and poses of a service, newest first; or delete, pin or unpin one.

    \b
    All uploads:              needlebench uploads
    Delete one:               needlebench uploads --delete ID
    """
    with service_client(url) as client:
        actions = ((deleted, client.delete_upload), (pinned, client.pin_upload), (unpinned, client.unpin_upload))
        chosen = [(act, name.removeprefix("artefact:")) for name, act in actions if name is not None]
        for act, upload_id in chosen:
            act(upload_id)
        if chosen:
            return
        for item in client.uploads():
            click.echo(f"{item.reference}  {item.kind:<6}{item.bytes:>10}  {item.name}")
