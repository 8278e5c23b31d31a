"""The processes of a cluster: a scheduler, and workers that come back to it when it was away."""

from __future__ import annotations

import asyncio
import json
import os
import platform
import signal
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click
import dask
from distributed import Scheduler, Status, Worker

from service.cluster import task
from service.cluster.address import on_this_machine
from service.cluster.certificates import security_of
from service.cluster.identity import difference, identity
from service.cluster.sign_on import RefusedError, prepare_scheduler, read_cluster
from service.worker.insertion_job import SERIES_RUNNER
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from service.cluster.address import ClusterAddress

_ENDED_BY_SCHEDULER = ("scheduler-close", "scheduler-remove-worker", "retire")
_LOOK_S = 0.5
_CLOSE_S = 5.0
_SIGN_ON_S = 300  # on a machine that has much else to do
_CONFIGURATION = {
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.worker-saturation": 1.0,  # what is queued waits at the scheduler, behind nobody
    "distributed.scheduler.worker-ttl": "10 minutes",  # compiling the kernels holds a worker's heartbeat up
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,  # receipts are all that it keeps
    "distributed.admin.system-monitor.gil.enabled": False,
}
_PAGES = "127.0.0.1:0"  # what Dask shows about itself, for this machine alone


@dataclass(frozen=True, kw_only=True)
class SchedulerOptions:
    """host, port: where it listens; port 0 = any. file: in which it writes its address. certificates: folder of key and
    certificate, None = plain TCP. insecure: plain TCP is wanted, though other machines reach it. interface: of the
    network, in place of the host."""

    host: str
    port: int
    file: Path
    certificates: Path | None
    insecure: bool = False
    interface: str | None = None

    def __post_init__(self) -> None:
        alone = self.interface is None and on_this_machine(self.host)
        if self.certificates is None and not self.insecure and not alone:
            reason = "would take code from whoever reaches it: name --tls DIR, or say --insecure"
            raise ScenarioError([Problem("--host", self.host, reason)])


def serve_scheduler(options: SchedulerOptions) -> None:
    """Be the scheduler until SIGTERM or SIGINT."""
    dask.config.set(_CONFIGURATION)
    asyncio.run(_scheduler(options))


async def _scheduler(options: SchedulerOptions) -> None:
    protocol = "tcp" if options.certificates is None else "tls"
    scheduler = Scheduler(
        host=None if options.interface else options.host,
        interface=options.interface,
        port=options.port,
        protocol=protocol,
        security=security_of(options.certificates) if options.certificates else None,
        dashboard=False,
        dashboard_address=_PAGES,
    )
    async with scheduler:
        refusal = await prepare_scheduler(read_cluster(options.file.parent) or identity(), scheduler)
        assert refusal is None, "the first identity is the cluster's"
        _write_address(options.file, scheduler)
        click.echo(f"scheduler at {scheduler.address}", err=True)
        try:
            await _until_signal(scheduler.finished())
        finally:
            options.file.unlink(missing_ok=True)


def _write_address(file: Path, scheduler: Scheduler) -> None:
    """The file as a whole: workers read it meanwhile."""
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    draft.write_text(json.dumps(scheduler.identity(), default=str, indent=1))
    draft.replace(file)


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """patience_s: for a scheduler to come (back). lifetime_s: after which no new insertion is begun; None = no end.
    runner: of the first cases, which is made ready before the worker signs on."""

    patience_s: float = 600.0
    lifetime_s: float | None = None
    runner: str = SERIES_RUNNER


def work(address: ClusterAddress, options: WorkerOptions) -> None:
    """Be a worker: until SIGTERM, until the scheduler has no more use for it, or until its lifetime is over.

    A scheduler that dies is waited for. Raises RefusedError, before it signs on, for code or versions that the cluster
    does not take; NoSchedulerError.
    """
    dask.config.set(_CONFIGURATION)
    file = address.file
    wanted = None if file is None else read_cluster(file.parent)
    if wanted is not None and (reason := difference(identity(), wanted)) is not None:
        raise RefusedError(f"this worker is refused: {reason}; install what the campaign runs")
    try:
        task.warm_up(options.runner)
        asyncio.run(_work(address, options))
    finally:
        task.end()
    sys.stdout.flush()


async def _work(address: ClusterAddress, options: WorkerOptions) -> None:
    end_s = None if options.lifetime_s is None else time.monotonic() + options.lifetime_s
    stop = _stop_event()
    while not stop.is_set():
        worker = await _signed_on(address, options.patience_s, stop)
        if worker is None:
            return
        reason = await _until_over(worker, stop, end_s)
        if "refused" in reason:
            raise RefusedError(reason)
        if reason.startswith(_ENDED_BY_SCHEDULER) or reason in ("stopped", "lifetime"):
            return
        click.echo(f"the scheduler is gone ({reason}); waiting for it", err=True)


class _Worker(Worker):
    """Remembers why it was closed."""

    reason = ""

    async def close(  # type: ignore[override]  # as Dask's own is one
        self, timeout: float = 30, executor_wait: bool = True, nanny: bool = True, reason: str = "scheduler-close"
    ) -> str | None:
        """As Dask does; without a reason it is the scheduler that asks for it."""
        self.reason = self.reason or reason
        return await super().close(timeout=timeout, executor_wait=executor_wait, nanny=nanny, reason=reason)


async def _signed_on(address: ClusterAddress, patience_s: float, stop: asyncio.Event) -> _Worker | None:
    """A worker that the scheduler has let in; None when it is to stop. Raises NoSchedulerError."""
    from service.cluster.connection import NoSchedulerError

    deadline = time.monotonic() + patience_s
    while not stop.is_set():
        if (endpoint := address.endpoint()) is not None:
            worker = _Worker(
                endpoint,
                nthreads=1,
                name=f"{platform.node()}-{os.getpid()}-{time.time_ns() % 10**6}",
                security=security_of(address.tls_folder()),
                local_directory=tempfile.gettempdir(),
                memory_limit=0,
                death_timeout=_SIGN_ON_S,
                dashboard=False,
                dashboard_address=_PAGES,
            )
            if await _started(worker, lambda: stop.is_set() or address.endpoint() != endpoint):
                return worker
        if time.monotonic() > deadline:
            raise NoSchedulerError(f"no scheduler answers at {address.text} for {patience_s:g} s")
        await asyncio.sleep(_LOOK_S)
    return None


async def _started(worker: _Worker, pointless: Callable[[], bool]) -> bool:
    """Whether the scheduler has let it in. pointless: looked at meanwhile; a scheduler that was killed leaves its file,
    and at that address nobody answers."""

    async def start() -> None:
        await worker

    starting = asyncio.ensure_future(start())
    while not starting.done():
        await asyncio.wait({starting}, timeout=_LOOK_S)
        if pointless():
            starting.cancel()
    try:
        await starting
    except (OSError, TimeoutError, RuntimeError, ValueError, asyncio.CancelledError):
        with suppress(Exception):
            await worker.close(timeout=_CLOSE_S, reason="not-started")
        return False
    return True


async def _until_over(worker: _Worker, stop: asyncio.Event, end_s: float | None) -> str:
    """Why it ended."""
    while worker.status in (Status.running, Status.paused):
        over = end_s is not None and time.monotonic() > end_s
        if over and worker.status == Status.running:
            worker.status = Status.paused  # ends what it is at, and begins nothing
        if stop.is_set() or (over and not task.current.busy):
            task.current.give_back()
            await worker.close(timeout=_CLOSE_S, executor_wait=False, reason="stopped" if stop.is_set() else "lifetime")
            return worker.reason
        with suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), _LOOK_S)
    await worker.finished()  # type: ignore[no-untyped-call]
    return worker.reason


def _stop_event() -> asyncio.Event:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        with suppress(NotImplementedError):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
    return stop


async def _until_signal(finished: Any) -> None:
    stop = asyncio.ensure_future(_stop_event().wait())
    over = asyncio.ensure_future(finished)
    await asyncio.wait({stop, over}, return_when=asyncio.FIRST_COMPLETED)
    stop.cancel()
    over.cancel()
