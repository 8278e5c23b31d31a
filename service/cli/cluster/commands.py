"""`needlebench cluster`: the processes of a cluster, and the scripts that start them under Slurm."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click

from service.blas_threads import one_thread
from service.cli.cluster.options import cluster_address, insecure_option, tls_option

_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86_400}
FOLDER = click.Path(file_okay=False, path_type=Path)


class Duration(click.ParamType[int]):
    """Seconds from 90m, 2h, 1d or 3600s."""

    name = "DURATION"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Seconds from the text."""
        if isinstance(value, int):
            return value
        match = re.fullmatch(r"(\d{1,6})([smhd])", str(value))
        if match is None or int(match[1]) == 0:
            self.fail(f"{value!r} must be a number with s, m, h or d, as in 90m or 2h", param, ctx)
        return int(match[1]) * _UNITS[match[2]]


@click.group()
def cluster() -> None:
    """Run the insertions of paper, settle, dataset and campaign run on the machines of a cluster.

    Needs needlebench[cluster], the same commit and lock on all machines, and a disk that all of them share.

    \b
    Under Slurm:            needlebench cluster slurm --out cluster --nodes 10 --time 2h
                            sh cluster/start.sh
                            needlebench paper --cluster file:cluster/scheduler.json --out out/paper
    On this machine:        needlebench cluster scheduler --out cluster &
                            needlebench cluster worker file:cluster/scheduler.json &
    """


@cluster.command()
@click.option("--out", "folder", metavar="DIR", required=True, type=FOLDER, help="Folder for scheduler.json.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option(
    "--interface", metavar="NAME", help="Network to be reached at, as in ib0; default: that of the host name."
)
@click.option("--port", type=click.IntRange(0, 65_535), default=0, show_default=True, help="0 = any that is free.")
@tls_option
@insecure_option
def scheduler(folder: Path, certificates: Path | None, **options: Any) -> None:
    """Be the scheduler, and write its address into DIR/scheduler.json; until SIGTERM.

    With TLS key and certificate are in --tls, or in DIR/tls if there is one; `needlebench cluster slurm` makes them.

    \b
    For this machine:       needlebench cluster scheduler --out cluster
    For others, with TLS:   needlebench cluster scheduler --out cluster --host 0.0.0.0 --tls cluster/tls
    """
    one_thread()
    from service.cluster.address import TLS
    from service.cluster.processes import SchedulerOptions, serve_scheduler

    folder.mkdir(parents=True, exist_ok=True)
    beside = folder / TLS if (folder / TLS).is_dir() else None
    file = (folder / "scheduler.json").absolute()
    serve_scheduler(SchedulerOptions(file=file, certificates=certificates or beside, **options))


@cluster.command()
@click.argument("address")
@click.option("--lifetime", type=Duration(), help="Begin no new insertion after this time, as in 110m.")
@click.option("--patience", type=Duration(), default="10m", show_default=True, help="For a scheduler to come (back).")
@tls_option
@insecure_option
def worker(address: str, lifetime: int | None, patience: int, certificates: Path | None, insecure: bool) -> None:
    """Be a worker of the cluster at ADDRESS, one insertion at a time: start one for each core.

    It is refused if commit, lock or versions differ from those of the cluster.

    \b
    Of a file:              needlebench cluster worker file:cluster/scheduler.json
    Of an address:          needlebench cluster worker tls://10.0.0.5:8786 --tls cluster/tls
    """
    one_thread()
    from service.cluster.processes import WorkerOptions, work

    known = cluster_address(address, insecure, certificates)
    assert known is not None
    work(known, WorkerOptions(patience_s=patience, lifetime_s=lifetime))


@cluster.command()
@click.option("--out", "folder", metavar="DIR", required=True, type=FOLDER, help="Folder on the shared disk.")
@click.option("--nodes", type=click.IntRange(1, 10_000), required=True, help="Machines.")
@click.option("--cores", type=click.IntRange(1, 1024), help="Workers on each; default: whole machines, one a core.")
@click.option("--time", "time_s", type=Duration(), required=True, help="Of the jobs, as in 2h.")
@click.option(
    "--memory",
    "memory_mb",
    type=click.IntRange(500, 10**6),
    default=1000,
    show_default=True,
    help="MB a core, with --cores.",
)
@click.option(
    "--interface", metavar="NAME", help="Network of the scheduler, as in ib0; default: that of its host name."
)
@click.option(
    "--option", "lines", metavar="OPTION", multiple=True, help="More for sbatch, as in --partition=long. Repeatable."
)
def slurm(folder: Path, **options: Any) -> None:
    """Write the scripts that start a cluster under Slurm, with certificates of its own, into DIR.

    DIR must be on a disk that all machines share, under the same name, and holds the key: no other account can read it.
    This environment, by its path, is what runs everywhere. Before a worker signs on it compares commit, lock and
    versions with DIR/cluster.json, which is written now, and ends with a sentence in DIR/logs if they differ.

    \b
    Ten machines, 2 hours:    needlebench cluster slurm --out cluster --nodes 10 --time 2h
    16 cores of each:         needlebench cluster slurm --out cluster --nodes 10 --cores 16 --time 2h
    Start them:               sh cluster/start.sh
    More of them:             sbatch cluster/workers.sbatch
    Use them:                 needlebench paper --cluster file:cluster/scheduler.json --out out/paper
    In a partition:           needlebench cluster slurm ... --option --partition=long --option --account=mine
    """
    cluster_address("file:x", False, None)
    from service.cluster.identity import identity
    from service.cluster.slurm import SlurmCluster

    if str(identity()["commit"]).endswith("-dirty"):
        click.echo("needlebench: warning: this checkout has changes that are in no commit", err=True)
    start = SlurmCluster(folder=folder.absolute(), **options).write()
    click.echo(f"sh {start}")
