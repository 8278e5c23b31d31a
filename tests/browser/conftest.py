"""One browser and one service for the tests of a file, a fresh window for each; a file may have its own service."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.acceptance.server import Server, running_server
from tests.browser.browser import chromium, opened

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Its jobs are a quick stand-in."""
    folder = tmp_path_factory.mktemp("pages")
    with running_server(folder, runner="tests.browser.runner:run_job", workers=1) as started:
        yield started


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


@pytest.fixture
def page(browser: Browser, server: Server) -> Iterator[Page]:
    with opened(browser, server.url) as found:
        yield found
