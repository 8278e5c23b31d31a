"""A remote controller beside a run of the command line: started with it, or said where it is waited for."""

from __future__ import annotations

import shlex
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from simcore.errors import Problem, ScenarioError
from simcore.scenario.scenario import Remote

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simcore.scenario.scenario import Scenario

PATIENCE_S = 5.0  # for a controller to end by itself after the run
ADDRESS = "{address}"


@contextmanager
def controller_beside(scenario: Scenario, command: str | None) -> Iterator[None]:
    """While the run lasts, the command runs, if there is one; it is ended after the run if it does not end itself.

    Raises ScenarioError for a command without a remote controller, and for one that cannot be started.
    """
    settings = scenario.controller
    if not isinstance(settings, Remote):
        if command is not None:
            raise ScenarioError([Problem("--controller-command", command, "needs --set controller.kind=remote")])
        yield
        return
    if command is None:
        limit = f"{settings.connect_timeout_s:g} s"
        click.echo(f"needlebench: waiting for a controller at {settings.address}, at most {limit}", err=True)
        yield
        return
    process = _started(command, settings.address)
    try:
        yield
    finally:
        _ended(process)


def _started(command: str, address: str) -> subprocess.Popen[bytes]:
    """What it prints goes to standard error."""
    parts = [part.replace(ADDRESS, address) for part in shlex.split(command, posix=sys.platform != "win32")]
    try:
        return subprocess.Popen(parts, stdin=subprocess.DEVNULL, stdout=sys.stderr.fileno())
    except (OSError, IndexError, ValueError) as error:
        raise ScenarioError([Problem("--controller-command", command, f"cannot be started: {error}")]) from None


def _ended(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.terminate()
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
