"""`needlebench models`: the models of a service, and trainings on it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.cli.connection import report_submitted, service_client, url_option
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from service.client.client import Client
    from service.client.models import ModelInfo

_KINDS = click.Choice(["elm", "linear", "neighbours", "mlp"])


@click.group()
def models() -> None:
    """List, show, download and train the models of learned controllers on a service.

    \b
    All models:               needlebench models list
    One in full, as JSON:     needlebench models show elm
    Train one, and wait:      needlebench models train out/data.npz --nodes 50 --wait
    Steer by it:              needlebench submit sine --set controller.kind=elm --set controller.model=artefact:ID
    Without a service:        needlebench train --data out/data.npz --out out/elm.json
    """


@models.command("list")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
@url_option
def list_models(as_json: bool, url: str | None) -> None:
    """List the models, newest first, then the bundled ones. The error is that of Delta P on test rows, mm.

    \b
    All models:               needlebench models list
    """
    with service_client(url) as client:
        for one in client.models():
            click.echo(json.dumps(one.raw) if as_json else _line(one))


def _line(model: ModelInfo) -> str:
    rmse = " ".join(f"{value:.3f}" for value in model.test_rmse_mm or [])
    return f"{model.source:<9} {model.kind:<11}{rmse:<18}{model.name:<24}{model.reference}"


@models.command()
@click.argument("model", metavar="MODEL")
@url_option
def show(model: str, url: str | None) -> None:
    """Print a model as JSON: settings, provenance, errors, the jobs that steer by it.

    MODEL is an id: elm, linear or mlp for the bundled ones, else as `needlebench models list` prints it.

    \b
    A bundled one:            needlebench models show elm
    """
    with service_client(url) as client:
        info = client.model(model.removeprefix("artefact:"))
        click.echo(json.dumps(dict(info.raw), indent=2))


@models.command()
@click.argument("model", metavar="MODEL")
@click.option("--out", "path", metavar="FILE.json", type=click.Path(dir_okay=False, path_type=Path), required=True)
@click.option("--force", is_flag=True, help="Replace the file.")
@url_option
def fetch(model: str, path: Path, force: bool, url: str | None) -> None:
    """Download a model, to steer by it without a service.

    \b
    From another machine:     needlebench models fetch ID --out elm.json --url http://lab:8321
    And use it:               needlebench run sine --set controller.kind=elm --set controller.model=elm.json
    """
    from service.cli.results.output_file import free_to_write

    free_to_write(path, force=force)
    with service_client(url) as client:
        click.echo(client.model_file(model.removeprefix("artefact:"), path))


@models.command()
@click.argument("source", metavar="DATA")
@click.option("--kind", type=_KINDS, default="elm", show_default=True)
@click.option("--nodes", type=click.IntRange(1, 10_000), help="Of the elm; default 25.")
@click.option("--ridge", type=click.FloatRange(0, 1e6), help="Of elm and linear; default 1e-6.")
@click.option("--weights", "weight_range", type=click.FloatRange(1e-3, 100), help="Range of w and b of the elm.")
@click.option("--neighbours", type=click.IntRange(1, 1000), help="Of neighbours; default 10.")
@click.option("--hidden", help="Nodes of each hidden layer of the mlp; default 32,32.")
@click.option("--seed", type=click.IntRange(0, 2**31), help="Of the elm and the mlp; default 0.")
@click.option("--split", type=click.Choice(["sample", "trajectory"]), help="What is held out; default sample.")
@click.option("--samples", type=click.IntRange(2), help="Learn from only so many rows; default: all.")
@click.option("--name", help="Its name in lists.")
@click.option("--wait", is_flag=True, help="Show progress until it is trained, then print its reference.")
@url_option
@click.pass_context
def train(ctx: click.Context, /, source: str, kind: str, wait: bool, url: str | None, **options: Any) -> None:
    """Train a model on a service, as a job; prints the id of the job.

    DATA is a file from `needlebench dataset`, which is uploaded first, or artefact:ID.

    \b
    The paper's:              needlebench models train out/data.npz --wait
    Another seed:             needlebench models train artefact:ID --seed 7 --wait

    \b
    Exit code with --wait: 0 trained; 1 failed, cancelled or timed out; 2 bad input
    """
    from service.cli.learning import layers_of

    settings = {name: value for name, value in options.items() if value is not None}
    if "hidden" in settings:
        settings["hidden"] = layers_of(settings["hidden"])
    with service_client(url) as client:
        data = _data(client, source)
        job = client.train_model(data, kind=kind, **settings)
        done = report_submitted(client, job, wait=wait)
        if done is None:
            return
        if not done.success:
            click.echo(f"{done.state}: {(done.error or {}).get('message', '')}", err=True)
            ctx.exit(1)
        click.echo(_line(client.model((done.metrics or {})["model"])))


def _data(client: Client, source: str) -> str:
    """The reference of the data set; a file is uploaded."""
    if source.startswith("artefact:"):
        return source
    path = Path(source)
    if not path.is_file():
        raise ScenarioError([Problem("DATA", source, "is neither a file nor artefact:ID")])
    return client.upload(path, kind="dataset").reference
