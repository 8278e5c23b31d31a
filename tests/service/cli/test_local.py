"""The commands that need no service, with a run that costs nothing in place of the simulation."""

from __future__ import annotations

import subprocess
import sys
import types
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

from service.cli import main as cli
from simcore.scenario.presets import preset, preset_names
from simcore.scenario.scenario import Scenario
from tests.service.cli.invoked import invoke

if TYPE_CHECKING:
    from collections.abc import Callable


def test_help_teaches_and_lists_every_command() -> None:
    result = invoke("--help")
    assert result.exit_code == 0
    positions = [result.output.index(f"\n  {name} ") for name in cli._COMMANDS]
    assert positions == sorted(positions)
    assert "needlebench scenario demo > mine.json\n  needlebench run" in result.output.replace("    ", "  ")


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_import_no_numbers(option: str) -> None:
    code = f"""
import sys
from service.cli.main import main
try:
    main([{option!r}])
except SystemExit as ended:
    assert ended.code == 0
heavy = {{"numpy", "numba", "scipy", "rerun", "pydantic", "fastapi", "sqlalchemy", "rich"}} & set(sys.modules)
assert not heavy, heavy
"""
    root = Path(cli.__file__).parents[2]
    subprocess.run([sys.executable, "-c", code], cwd=root, check=True, stdout=subprocess.DEVNULL)


def test_the_module_runs_as_a_program() -> None:
    root = Path(cli.__file__).parents[2]
    command = [sys.executable, "-m", "service.cli", "--version"]
    done = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)
    assert done.stdout.startswith("needlebench ")


def test_an_unknown_command_is_told_what_there_is() -> None:
    result = invoke("rum")
    assert result.exit_code == 2
    assert "No such command 'rum'. Did you mean run? There are: demo, scenario, run" in result.stderr


@pytest.mark.parametrize("name", ["scenario", "run", "view"])
def test_every_command_has_help_with_an_example(name: str) -> None:
    result = invoke(name, "--help")
    assert result.exit_code == 0
    assert f"needlebench {name}" in result.output


def test_scenario_lists_the_built_in_ones() -> None:
    result = invoke("scenario")
    assert [line.split()[0] for line in result.stdout.splitlines()] == list(preset_names())


def test_scenario_prints_one_that_loads_again() -> None:
    result = invoke("scenario", "sine")
    assert Scenario.load(result.stdout) == preset("sine")


def test_scenario_with_an_unknown_name() -> None:
    result = invoke("scenario", "cosine")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith("needlebench: scenario = 'cosine': is not a built-in scenario")


def test_a_command_that_is_refused_by_click_keeps_its_message() -> None:
    result = invoke("run", "demo")
    assert result.exit_code == 2
    assert "Missing option '--out'" in result.stderr


def test_errors_of_other_commands_are_mapped_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def command(action: Callable[[], None]) -> click.Command:
        return click.Command("serve", callback=action)

    def crash() -> None:
        raise RuntimeError("boom")

    fake = types.SimpleNamespace(serve=command(crash))
    monkeypatch.setitem(sys.modules, "service.cli.service", fake)
    result = invoke("serve")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.startswith("needlebench: crashed: RuntimeError: boom")
