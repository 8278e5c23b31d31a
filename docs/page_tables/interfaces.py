"""The interfaces as they describe themselves: the OpenAPI document and the help of the commands."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import click
from click.testing import CliRunner

from page_tables.markdown import table
from service.api.context import Service
from service.api.problem_codes import CODES
from service.app import create_app
from service.cli.main import main
from service.settings import Settings

WIDTH = 88


@cache
def openapi() -> dict[str, Any]:
    """The OpenAPI document of a service with the default settings, on a data folder that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        service = Service.open(Settings(data=Path(folder)))
        try:
            return create_app(service).openapi()
        finally:
            service.store.close()


def http_routes() -> str:
    """All operations, grouped by what they are about."""
    by_tag: dict[str, list[tuple[str, str, str]]] = {}
    for path, methods in openapi()["paths"].items():
        for method, operation in methods.items():
            row = (f"`{method.upper()} {path}`", operation.get("summary", ""), _scope(operation))
            by_tag.setdefault((operation.get("tags") or ["service"])[0], []).append(row)
    parts = [
        f"### {tag.capitalize()}\n\n{table(('request', 'what it does', 'scope'), rows)}" for tag, rows in by_tag.items()
    ]
    return "\n\n".join(parts)


def problem_codes() -> str:
    """Every kind of problem: its code, status and meaning."""
    rows = [(f"`{code}`", str(status), meaning) for code, (status, meaning) in CODES.items()]
    return table(("code", "status", "meaning"), rows)


def _scope(operation: dict[str, Any]) -> str:
    scopes = {scope for way in operation["security"] for named in way.values() for scope in named}
    return ", ".join(sorted(scopes)) or "open"


def help_text(command: str = "") -> str:
    """What `needlebench COMMAND --help` prints, as a block."""
    answer = CliRunner().invoke(main, [*command.split(), "--help"], prog_name="needlebench", terminal_width=WIDTH)
    if answer.exit_code:
        raise KeyError(command)
    return f"```text\n{answer.output.rstrip()}\n```"


def commands() -> str:
    """The help of every command and of those below it, each under a heading."""
    context = click.Context(main)
    parts = []
    for name in main.list_commands(context):
        parts.append(f"## needlebench {name}\n\n{help_text(name)}")
        command = main.get_command(context, name)
        if isinstance(command, click.Group):
            parts += [f"### needlebench {name} {below}\n\n{help_text(f'{name} {below}')}" for below in command.commands]
    return "\n\n".join(parts)
