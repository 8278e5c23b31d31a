"""A service for as long as a command needs one: that of the data folder if it runs, else a process of our own."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.client.client import Client, ServiceError, UnreachableError
from service.files.endpoint import endpoint
from service.server.server import ServiceStartError, listen
from service.settings import DEFAULT_PORT, Settings

if TYPE_CHECKING:
    from collections.abc import Iterator

_STOP_S = 15.0
_PORTS_TRIED = 50


@contextmanager
def running_service(settings: Settings) -> Iterator[tuple[str, subprocess.Popen[str] | None]]:
    """The address of a service on this data folder: the one that runs already, else a process of our own."""
    present = _running(settings)
    if present is not None:
        click.echo("a service runs on this folder already: using it", err=True)
        yield present, None
        return
    process = _start(settings)
    try:
        yield _address(process, settings), process
    finally:
        _stop(process)


def _running(settings: Settings) -> str | None:
    url = endpoint(settings.data)
    if url is None:
        return None
    try:
        with Client(url, settings.api_key, timeout_s=5.0) as client:
            client.ready()
    except (UnreachableError, ServiceError):
        return None
    return url


def _start(settings: Settings) -> subprocess.Popen[str]:
    """The service as a process that ends with this one, however this one ends: it holds the other end of a pipe."""
    wanted = DEFAULT_PORT if settings.port is None else settings.port
    home = str(Path(__file__).resolve().parents[2])
    environment = {
        **os.environ,
        "NEEDLEBENCH_DATA": str(settings.data),
        "NEEDLEBENCH_HOST": settings.host,
        **({"NEEDLEBENCH_API_KEY": settings.api_key} if settings.api_key else {}),
        "NEEDLEBENCH_PORT": str(_free_port(settings.host, wanted)),
        "PYTHONPATH": os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH")])),
    }
    code = "from service.server.server import main; main()"
    return subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a Ctrl-C is for us alone: we end the service when we are done
    )


def _free_port(host: str, wanted: int) -> int:
    """The wanted port or the next that is free."""
    for port in range(wanted, min(wanted + _PORTS_TRIED, 65536)):
        try:
            with listen(host, port):
                if port != wanted:
                    click.echo(f"port {wanted} is taken: using {port}", err=True)
                return port
        except ServiceStartError:
            continue
    return 0


def _address(process: subprocess.Popen[str], settings: Settings) -> str:
    """What the service says once it listens. Raises ServiceStartError when it ends instead; it has said why."""
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    if not url:
        raise ServiceStartError(f"the service did not start on {settings.data} (exit code {process.wait()})")
    return url


def _stop(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.close()
    try:
        process.wait(timeout=_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
