"""The command line, invoked in this process."""

from __future__ import annotations

from typing import Any

from click.testing import CliRunner, Result

from service.cli.main import main


def invoke(*arguments: str, **options: Any) -> Result:
    return CliRunner().invoke(main, list(arguments), prog_name="needlebench", **options)
