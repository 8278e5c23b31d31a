"""The commands of learned controllers: make the data set, train a model, start a controller of your own."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.blas_threads import one_thread
from service.cli.results.output_file import free_to_write
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from simcore.learning import Regressor
    from simcore.rollout.dataset import Dataset

FILE = click.Path(dir_okay=False, path_type=Path)
EXAMPLES = {"controller": "controller.txt", "remote": "remote.txt", "remote-cpp": "remote_cpp.txt", "mesh": "mesh.msh"}
SCHEMA, LOOKS_AHEAD = "remote-schema", "mpc"


@click.command()
@click.option("--data", "source", metavar="FILE.npz", required=True, type=FILE, help="From `needlebench dataset`.")
@click.option("--out", "path", metavar="MODEL.json", required=True, type=FILE, help="The model.")
@click.option("--kind", type=click.Choice(["elm", "linear", "neighbours", "mlp"]), default="elm", show_default=True)
@click.option("--nodes", type=click.IntRange(1, 10_000), default=25, show_default=True, help="Of the elm.")
@click.option("--ridge", type=click.FloatRange(0, 1e6), default=1e-6, show_default=True, help="Of elm and linear.")
@click.option(
    "--weights", type=click.FloatRange(1e-3, 100), default=1.0, show_default=True, help="Range of w and b of the elm."
)
@click.option("--neighbours", type=click.IntRange(1, 1000), default=10, show_default=True, help="Of neighbours.")
@click.option("--hidden", default="32,32", show_default=True, help="Nodes of each hidden layer of the mlp.")
@click.option("--seed", type=click.IntRange(0, 2**31), default=0, show_default=True, help="Of the elm and the mlp.")
@click.option(
    "--split",
    type=click.Choice(["sample", "trajectory"]),
    default="sample",
    show_default=True,
    help="How 10 % are held out: single rows, as in the paper, or whole insertions.",
)
@click.option("--samples", type=click.IntRange(2), default=None, help="Learn from so many rows only; default: all.")
@click.option("--force", is_flag=True, help="Replace the file.")
def train(source: Path, path: Path, kind: str, split: str, samples: int | None, force: bool, **asked: Any) -> None:
    """Train the model of a learned controller and write it, with its errors and where it comes from.

    Inputs are the base's position P and the tip error e_p, the output is the base's move Delta P [paper]. The errors
    that are printed are those of Delta P before the robot's limits, not those of the tip: run the controller for these.

    \b
    The paper's:     needlebench train --data out/data.npz --out out/elm.json
    Another seed:    needlebench train --data out/data.npz --out out/elm7.json --seed 7
    To steer by it:  needlebench run sine --out out/sine --set controller.kind=elm --set controller.model=out/elm.json
    """
    one_thread()
    import hashlib

    from threadpoolctl import threadpool_limits

    from benchmarks.learning.training import train_model
    from simcore.rollout.artefacts import replace_atomically

    free_to_write(path, force=force)
    if kind == "mlp":
        from service.worker.network_trainer import require_scikit_learn

        require_scikit_learn()
    data = read_data(source)
    with source.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    with threadpool_limits(1):
        done = train_model(data, _regressor(kind, **asked), split=split, samples=samples, data_sha256=sha256)
    text = done.model.text().encode()
    replace_atomically(path, lambda file: file.write(text))
    provenance = done.model.provenance
    click.echo(f"RMSE of Delta P, mm    {'x':>8}{'y':>8}{'z':>8}")
    for side, rmse in (("train", done.train_rmse_mm), ("test", done.test_rmse_mm)):
        click.echo(f"  {side:<6}{provenance[f'{side}_rows']:>7} rows   " + "".join(f"{axis:8.4f}" for axis in rmse))
    click.echo(f"{path}: {kind}, {len(text) / 1e3:.0f} kB, SHA-256 {hashlib.sha256(text).hexdigest()}")


def read_data(source: Path) -> Dataset:
    """A data set that was named with --data. Raises ScenarioError."""
    from simcore.rollout.dataset import DatasetError, load_dataset

    try:
        return load_dataset(source)
    except DatasetError as error:
        message = str(error).removeprefix(str(source)).removeprefix(":").strip()
        raise ScenarioError([Problem("--data", str(source), message)]) from None


def _regressor(
    kind: str, *, nodes: int, ridge: float, weights: float, neighbours: int, hidden: str, seed: int
) -> Regressor:
    from service.worker.training_job import SETTINGS, new_regressor

    given: dict[str, Any] = {"nodes": nodes, "ridge": ridge, "weight_range": weights, "neighbours": neighbours}
    given |= {"hidden": layers_of(hidden), "seed": seed}
    return new_regressor(kind, {name: given[name] for name in SETTINGS[kind]})


def layers_of(text: str) -> list[int]:
    """'32,32' -> [32, 32]. Raises ScenarioError."""
    try:
        return [int(n) for n in text.split(",")]
    except ValueError:
        raise ScenarioError([Problem("--hidden", text, "must be whole numbers with commas, as in 32,32")]) from None


@click.command()
@click.argument("name", type=click.Choice([*EXAMPLES, LOOKS_AHEAD, SCHEMA]))
def example(name: str) -> None:
    """Print an example that works as it is, as a starting point.

    \b
    A controller of your own: needlebench example controller > mine.py
                              python mine.py
    One that looks ahead:     needlebench example mpc > mine.py
    In another process:       needlebench example remote > mine.py
    In another language:      needlebench example remote-cpp > mine.cpp
    What they say, as schema: needlebench example remote-schema
    A mesh of your own:       needlebench example mesh > barrel.msh

    The mesh is a barrel with a domed top, in millimetres, with the groups top, side, base and tissue. The needle
    enters at the top, the origin, and goes down along +z.
    """
    if name == SCHEMA:
        from simcore.remote.messages import schema_text

        click.echo(schema_text(), nl=False)
        return
    if name == LOOKS_AHEAD:
        spec = importlib.util.find_spec("needlebench.mpc")  # read, not run: it would import the simulator
        assert spec is not None
        assert spec.origin is not None
        click.echo(Path(spec.origin).read_text(encoding="utf-8"), nl=False)
        return
    click.echo((Path(__file__).parent / "examples" / EXAMPLES[name]).read_text(encoding="utf-8"), nl=False)
