"""A page that is open while its server is killed: it says so, and goes on by itself with the next server."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.server import Server, running_server, until
from tests.browser.browser import PROGRAM, chromium, opened

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]
RUNNER = "tests.browser.runner:run_job"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with running_server(tmp_path, runner=RUNNER, workers=1) as started:
        yield started


def test_the_page_outlives_its_server(server: Server) -> None:
    """The job is begun again; the plots of the attempt that died give way to those of the new one."""
    job = server.client.submit({"name": "lasting and killed"})
    port = int(server.url.rpartition(":")[2])
    with chromium() as browser, opened(browser, server.url, expected="net::ERR") as page:
        page.goto(f"/jobs/{job.id}")
        page.locator("#plot-error canvas").wait_for()
        page.evaluate("window.notReloaded = true")
        server.stop(signal.SIGKILL)
        page.locator("#away", has_text="does not respond").wait_for()
        page.get_by_role("button", name="Cancel").click()
        page.get_by_role("button", name="Yes").click()
        page.locator("#messages .away").wait_for()
        with running_server(server.data, runner=RUNNER, workers=1, port=port) as again:
            page.locator("#job[data-attempt='2'] .state.running").wait_for()
            page.locator("#away").wait_for(state="hidden")
            assert page.locator("#messages .away").count() == 0
            until(lambda: page.evaluate("document.querySelector('#job progress').value") > 0)
            assert page.evaluate("window.notReloaded")
            assert page.locator("#details th", has_text="crashed").count() == 1
            page.reload()
            page.locator("#plot-error canvas").wait_for()
            again.client.cancel(job.id)
            page.locator("#job .state.cancelled").wait_for()


def test_a_page_that_is_opened_later_draws_the_way_so_far(server: Server) -> None:
    job = server.client.submit({"name": "lasting with a way"})
    until(lambda: server.client.job(job.id).progress.step >= 40)
    with chromium() as browser, opened(browser, server.url) as page:
        page.goto(f"/jobs/{job.id}")
        page.locator("#plot-error canvas").wait_for()
        assert page.evaluate("JSON.parse(document.getElementById('plots').dataset.course).length") >= 3
    server.client.cancel(job.id)
