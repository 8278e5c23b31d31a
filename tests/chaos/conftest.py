"""How much is tried, from which seed, and the table of what was measured."""

from __future__ import annotations

import os
import random
import sys
import textwrap
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

MOMENTS, SEED = "NEEDLEBENCH_CHAOS_MOMENTS", "NEEDLEBENCH_CHAOS_SEED"
REQUESTS, MESHES = "NEEDLEBENCH_CHAOS_REQUESTS", "NEEDLEBENCH_CHAOS_MESHES"
CLIENTS, SECONDS, JOBS = "NEEDLEBENCH_CHAOS_CLIENTS", "NEEDLEBENCH_CHAOS_SECONDS", "NEEDLEBENCH_CHAOS_JOBS"
_SHORT, _FEW, _FEW_MESHES, _SHORT_CAMPAIGN = "3", "400", "22", "30"
_ELSEWHERE = {
    "tests/acceptance/test_disk.py": "disk full, read-only, locked; the clock",
    "tests/service/api/test_hostile.py": "hostile input",
}
_table: list[tuple[str, str]] = []


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    linux = pytest.mark.skipif(sys.platform != "linux", reason="kills processes and reads the process table")
    for item in items:
        if "chaos" in item.path.parts:
            item.add_marker(pytest.mark.chaos)
            item.add_marker(pytest.mark.slow)
            item.add_marker(linux)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    rows = [*_table, *_elsewhere(terminalreporter)]
    if rows:
        terminalreporter.section("chaos")
        for name, found in rows:
            lines = textwrap.wrap(found, 100, break_long_words=False)
            for head, line in zip((name, *[""] * len(lines)), lines, strict=False):
                terminalreporter.line(f"{head:<42}{line}")


def _elsewhere(reporter: pytest.TerminalReporter) -> Iterator[tuple[str, str]]:
    """A row for each file of tests that belong to the table and need no figures."""
    for path, name in _ELSEWHERE.items():
        ended = {kind: reporter.stats.get(kind, []) for kind in ("passed", "failed", "error")}
        counts = {kind: sum(one.nodeid.startswith(path) for one in reports) for kind, reports in ended.items()}
        if any(counts.values()):
            yield name, ", ".join(f"{kind} {count}" for kind, count in counts.items() if count)


@pytest.fixture
def moments() -> int:
    """How often something is killed."""
    return int(os.environ.get(MOMENTS, _SHORT))


@pytest.fixture
def requests() -> int:
    """How many requests are generated."""
    return int(os.environ.get(REQUESTS, _FEW))


@pytest.fixture
def meshes() -> int:
    """How many mesh files are changed and read."""
    return int(os.environ.get(MESHES, _FEW_MESHES))


@pytest.fixture
def clients() -> int:
    """How many clients ask at the same time; without a number the test is left out."""
    if CLIENTS not in os.environ:
        pytest.skip("a measurement of minutes: make chaos")
    return int(os.environ[CLIENTS])


@pytest.fixture
def seconds() -> float:
    """How long they ask."""
    return float(os.environ.get(SECONDS, "60"))


@pytest.fixture
def campaign_jobs(request: pytest.FixtureRequest) -> int:
    """How many jobs a campaign has; without a number only those of the cheap kind are run, and few."""
    if JOBS not in os.environ and request.node.callspec.id != "50ms":
        pytest.skip("a measurement of minutes: make chaos")
    return int(os.environ.get(JOBS, _SHORT_CAMPAIGN))


@pytest.fixture
def chance() -> random.Random:
    """Where the random moments come from."""
    return random.Random(int(os.environ.get(SEED, "1")))


@pytest.fixture
def figures(request: pytest.FixtureRequest) -> Iterator[dict[str, object]]:
    """What a test measured, by name; a line of the table."""
    found: dict[str, object] = {}
    yield found
    _table.append((request.node.name, ", ".join(f"{name} {value}" for name, value in found.items())))
