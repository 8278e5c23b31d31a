"""What all tests share: the plugin of `tests/verification.py`, no deadlines, and a Ctrl-C that works."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

from tests.budget import examples

if TYPE_CHECKING:
    from collections.abc import Generator

pytest_plugins = ["tests.verification"]

settings.register_profile(
    "untimed",  # a busy machine makes no test fail
    settings.default,
    deadline=None,
    max_examples=examples(100),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job; a child would ignore it too
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_xdist_auto_num_workers() -> int:
    """One process more than cores: a fifth of the time goes into waiting for servers, browsers and clocks."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, so that the workers of a parallel run end together.

    The tests of a file stay in one worker and share its servers; the pages of the documentation know nothing of each
    other and are given out one by one.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
    for item in items:
        alone = item.path.name == "test_snippets.py" and item.get_closest_marker("slow")
        item.add_marker(pytest.mark.xdist_group(item.name if alone else str(item.path)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """What a test logged may hold text that no worker of a parallel run can send: half a surrogate pair."""
    report = yield
    report.sections = [(name, text.encode(errors="backslashreplace").decode()) for name, text in report.sections]
    return report
