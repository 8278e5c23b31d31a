"""How many random moments are tried, from which seed, and the table of what was measured."""

from __future__ import annotations

import os
import random
import sys
from collections.abc import Iterator

import pytest

MOMENTS, SEED = "NEEDLEBENCH_CHAOS_MOMENTS", "NEEDLEBENCH_CHAOS_SEED"
REQUESTS = "NEEDLEBENCH_CHAOS_REQUESTS"
_SHORT, _FEW = "3", "400"
_table: list[tuple[str, str]] = []


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    linux = pytest.mark.skipif(sys.platform != "linux", reason="kills processes and reads the process table")
    for item in items:
        if "chaos" in item.path.parts:
            item.add_marker(pytest.mark.chaos)
            item.add_marker(pytest.mark.slow)
            item.add_marker(linux)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if _table:
        terminalreporter.section("chaos")
        for name, figures in _table:
            terminalreporter.line(f"{name:<28}{figures}")


@pytest.fixture
def moments() -> int:
    """How often something is killed."""
    return int(os.environ.get(MOMENTS, _SHORT))


@pytest.fixture
def requests() -> int:
    """How many requests are generated."""
    return int(os.environ.get(REQUESTS, _FEW))


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
