"""The code of the README and of the documentation runs, page by page, as a reader would type it."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tomllib
from typing import TYPE_CHECKING

import click
import pytest

from service.cli.main import main
from simcore.scenario.scenario import Scenario
from tests.docs.snippets import LANGUAGES, Snippet, pages, snippets
from tests.docs.sources import ROOT

if TYPE_CHECKING:
    from pathlib import Path

ALL = [snippet for page in pages() for snippet in snippets(page)]
MOST_NOT_RUN = 18  # of fifty
PATIENCE_S = 600.0
HERE = "127.0.0.1:8321"  # as the pages write it; a test has a port of its own
SERVES = re.compile(r"serves http://([\w.]+:\d+)")
NAMED = re.compile(r"(?:^|[|;(]\s*|&&\s*)needlebench\s+([^|;>)&#]*)")


def of(language: str) -> list[Snippet]:
    return [snippet for snippet in ALL if snippet.language == language]


def test_every_block_has_a_language_that_is_known() -> None:
    assert [str(snippet) for snippet in ALL if snippet.language not in LANGUAGES] == []


def test_blocks_that_are_not_run_are_few_and_say_why() -> None:
    not_run = [snippet for snippet in ALL if snippet.not_run is not None]
    assert len(not_run) <= MOST_NOT_RUN, [str(snippet) for snippet in not_run]
    assert all(len(str(snippet.not_run).split()) >= 3 for snippet in not_run)
    marks = sum(len(re.findall(r"^<!-- not run", page.read_text(), re.MULTILINE)) for page in pages())
    assert marks == len(not_run), "a mark stands directly above the block that it is about"


def test_a_failing_block_fails(tmp_path: Path) -> None:
    """Of both languages: otherwise nothing below says anything."""
    page = tmp_path / "page.md"
    for language, text in (("shell", "false"), ("shell", "false | cat"), ("python", "raise SystemExit(3)")):
        with pytest.raises(AssertionError, match=r"page\.md:1 fails"):
            run_block(Snippet(page, 1, language, text, None), tmp_path, environment(tmp_path), HERE)


# ---- what can be said without running


@pytest.mark.parametrize("snippet", of("shell"), ids=str)
def test_commands_and_their_options_exist(snippet: Snippet) -> None:
    for line in snippet.commands:
        for words in NAMED.findall(line):
            parse(shlex.split(words, comments=True))


def parse(words: list[str]) -> None:
    """Raises a UsageError for a command or an option that there is not."""
    command: click.Command = main
    context = click.Context(main, info_name="needlebench")
    while isinstance(command, click.Group):
        if not words or words[0].startswith("-"):
            return
        name, found, words = command.resolve_command(context, words)
        assert found is not None
        command, context = found, click.Context(found, info_name=name, parent=context)
    command.make_parser(context).parse_args(args=list(words))


@pytest.mark.parametrize("words", ["nosuch", "run line --nosuch", "campaign nosuch"])
def test_a_wrong_command_is_noticed(words: str) -> None:
    with pytest.raises(click.UsageError):
        parse(words.split())


@pytest.mark.parametrize("snippet", of("json"), ids=str)
def test_json_is_a_scenario(snippet: Snippet) -> None:
    Scenario.load(snippet.text)


@pytest.mark.parametrize("snippet", of("toml"), ids=str)
def test_toml_is_toml(snippet: Snippet) -> None:
    assert tomllib.loads(snippet.text)


# ---- the pages, run


def runnable(page: Path) -> list[Snippet]:
    return [s for s in snippets(page) if s.language in ("shell", "python", "json") and s.not_run is None]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="the shell of the pages is bash")
@pytest.mark.parametrize("page", [page for page in pages() if runnable(page)], ids=lambda page: page.name)
def test_a_page_runs_from_top_to_bottom(page: Path, tmp_path: Path) -> None:
    """In one folder; a JSON block is the file that a page calls mine.json."""
    blocks = runnable(page)
    if any("curl" in block.text for block in blocks) and shutil.which("curl") is None:
        pytest.skip("needs curl")
    folder = tmp_path / "work"
    folder.mkdir()
    variables, address = environment(tmp_path), HERE
    for block in blocks:
        if block.language == "json":
            (folder / "mine.json").write_text(json.dumps(json.loads(block.text)))
    with Services() as services:
        for block in blocks:
            if block.serves:
                address = services.start(folder, variables)
            elif block.language != "json":
                run_block(block, folder, variables, address)


def environment(tmp_path: Path) -> dict[str, str]:
    """With a `needlebench` and a `python` that are those of this checkout, and a data folder of its own."""
    binaries = tmp_path / "bin"
    binaries.mkdir(exist_ok=True)
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    module, _, function = scripts["needlebench"].partition(":")
    code = f"import sys; sys.argv[0] = 'needlebench'; from {module} import {function}; {function}()"
    for name, arguments in (("needlebench", ["-c", code]), ("python", [])):
        script = binaries / name
        script.write_text(f'#!/bin/sh\nexec {shlex.join([sys.executable, *arguments])} "$@"\n')
        script.chmod(0o755)
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NEEDLEBENCH_")}
    return {
        **kept,
        "PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "NEEDLEBENCH_DATA": str(tmp_path / "data"),
        "CI": "1",
    }


def run_block(block: Snippet, folder: Path, variables: dict[str, str], address: str) -> None:
    """Run it as a reader would; a failure shows the block and what it printed."""
    text = block.text.replace(HERE, address)
    shell = ["bash", "-eu", "-o", "pipefail", "-c", text]
    command = shell if block.language == "shell" else [sys.executable, "-c", text]
    done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, f"{block.page.name}:{block.line} fails\n{text}\n{done.stdout}\n{done.stderr}"


class Services:
    """The services that a page starts; they end with it."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[str]] = []

    def __enter__(self) -> Services:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=60)

    def start(self, folder: Path, variables: dict[str, str]) -> str:
        """Its address, as it prints it once it listens; any free port, so that tests can run side by side."""
        process = subprocess.Popen(
            ["needlebench", "serve", "--port", "0"],
            cwd=folder,
            env=variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._running.append(process)
        assert process.stdout is not None
        printed = []
        for line in process.stdout:
            printed.append(line)
            if found := SERVES.search(line):
                return found[1]
        raise AssertionError(f"the service did not start: {''.join(printed)}")
