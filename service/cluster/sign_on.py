"""Who may take part: a worker of another commit, other versions or the wrong shape is refused with a sentence."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import platform
from typing import TYPE_CHECKING, Any

from distributed.diagnostics.plugin import WorkerPlugin

from service.cluster.identity import Identity, difference, identity
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from pathlib import Path

    from distributed import Scheduler, Worker

TOPIC = "needlebench-refused"
CLUSTER = "cluster.json"  # beside a scheduler's file: whom the cluster takes
_FAILURES = 1_000_000  # Dask counts a death against every task that a worker held (distributed#5234); we count our own


class RefusedError(NeedlebenchError):
    """A worker, or a campaign, is of another identity than the cluster."""


class SignOn(WorkerPlugin):
    """Looks at a worker that Dask lets in, and sends it away if it may not take part."""

    name = "needlebench-sign-on"

    def __init__(self, wanted: Identity) -> None:
        self._wanted = wanted

    def setup(self, worker: Worker) -> None:
        """Close the worker soon, with a sentence for whoever runs the campaign."""
        reason = objection(self._wanted, threads=worker.state.nthreads)
        if reason is None:
            return
        sentence = f"worker {worker.name} on {platform.node()} is refused: {reason}"
        worker.log_event(TOPIC, sentence)
        loop = asyncio.get_running_loop()
        loop.call_later(0.5, lambda: loop.create_task(worker.close(reason=sentence, executor_wait=False)))


def objection(wanted: Identity, *, threads: int = 1) -> str | None:
    """Why this process may not work for a campaign of that identity; None if it may."""
    if threads != 1:
        return f"it has {threads} threads; start workers with --nthreads 1, one for each core"
    if multiprocessing.current_process().daemon:
        return "it may not start processes; start workers with --no-nanny, or with `needlebench cluster worker`"
    return difference(identity(), wanted)


async def prepare_scheduler(wanted: Identity, dask_scheduler: Scheduler | None = None) -> str | None:
    """On the scheduler: no stealing, deaths not counted there. Why it does not take the campaign; None if it does.

    The first campaign on a scheduler decides whom it takes; later ones must be of the same identity.
    """
    assert dask_scheduler is not None, "Dask hands it in"
    dask_scheduler.allowed_failures = _FAILURES
    if (stealing := dask_scheduler.extensions.get("stealing")) is not None:
        await stealing.stop()
    known: Identity = dask_scheduler.__dict__.setdefault("needlebench_identity", dict(wanted))
    return difference(known, wanted)


def write_cluster(folder: Path, wanted: Identity) -> None:
    """Write down whom a cluster takes."""
    (folder / CLUSTER).write_text(json.dumps({"identity": wanted}, indent=1) + "\n")


def read_cluster(folder: Path) -> Identity | None:
    """Whom the cluster of a scheduler's file takes; None if that is not written down."""
    try:
        found: dict[str, Any] = json.loads((folder / CLUSTER).read_bytes())
        return dict(found["identity"])
    except FileNotFoundError:
        return None
