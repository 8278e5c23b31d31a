"""The options that name a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.cluster.address import ClusterAddress

FOLDER = click.Path(file_okay=False, path_type=Path)
insecure_option = click.option(
    "--insecure", is_flag=True, help="Plain TCP to other machines; whoever is there can run code."
)
tls_option = click.option(
    "--tls", "certificates", metavar="DIR", type=FOLDER, help="Folder with key.pem and certificate.pem."
)


def cluster_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of a command whose insertions may run on a cluster."""
    for option in reversed(
        (
            click.option(
                "--cluster",
                "cluster_text",
                metavar="ADDRESS",
                help="Run on a Dask cluster: tls://HOST:PORT, file:SCHEDULER.json, or tcp:// on this machine.",
            ),
            insecure_option,
            tls_option,
        )
    ):
        command = option(command)
    return command


def cluster_address(text: str | None, insecure: bool, certificates: Path | None) -> ClusterAddress | None:
    """What the options name; None without --cluster. Raises ScenarioError."""
    from importlib.util import find_spec

    from service.cluster.address import FIELD, ClusterAddress

    if text is None:
        return None
    if find_spec("distributed") is None:
        raise ScenarioError([Problem(FIELD, text, "needs Dask: pip install 'needlebench[cluster]'")])
    return ClusterAddress(text, insecure, certificates)
